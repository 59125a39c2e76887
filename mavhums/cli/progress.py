"""Shows progress on a terminal; shows nothing if the output is a file or a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["reading", "steps"]


@contextmanager
def reading(log: Path) -> Iterator[Callable[[int], None] | None]:
    """Show how much of a log has been read, on a terminal and for long-running logs."""
    if not sys.stderr.isatty() or not log.is_file() or log.stat().st_size < 4 << 20:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(log.name, total=log.stat().st_size)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def steps(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show the number of completed steps, on a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
