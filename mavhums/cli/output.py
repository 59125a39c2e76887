"""Prints the commands' output without control and unprintable characters, and their progress."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

import click

from mavhums.core import startup
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.output import printable

_BEYOND_ASCII = re.compile(r"[^\x00-\x7e]")
_TOLD = (ExitCode.EMERGENCY, ExitCode.DEGRADED)


def say(text: str, *, err: bool = False) -> None:
    """Print lines; replace the control characters of a terminal."""
    click.echo("\n".join(printable(line) for line in text.split("\n")), err=err)


def say_json(content: object, *, nl: bool = True) -> None:
    r"""Print JSON, of a content or as a text; unprintable and control characters become ``\uXXXX``."""
    text = content if isinstance(content, str) else json.dumps(content, ensure_ascii=False)
    encoding = sys.stdout.encoding or "ascii"

    def escaped(match: re.Match[str]) -> str:
        letter = match[0]
        with suppress(UnicodeEncodeError):
            letter.encode(encoding)
            if letter.isprintable():
                return letter
        return json.dumps(letter)[1:-1]

    click.echo(_BEYOND_ASCII.sub(escaped, text), nl=nl)


def complain(error: MavhumsError) -> None:
    """Print an error and its remedy on standard error."""
    say(f"mavhums: {error.problem}", err=True)
    if error.remedy:
        say(f"  remedy: {error.remedy}", err=True)


@contextmanager
def sound_output() -> Iterator[None]:
    """Prevent a traceback from any output error.

    A character that the output cannot encode becomes a question mark. An output that cannot be written ends
    the command with one line and exit code 1, or with the code of an emergency or degradation if found. An
    output that no process reads any more ends the command without a message.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    code: object = 0
    try:
        try:
            yield
        except SystemExit as stop:
            code = stop.code
        sys.stdout.flush()
    except BrokenPipeError:
        _abandon(sys.stdout)
        code = code or ExitCode.ERROR
    except OSError as error:
        _abandon(sys.stdout)
        with suppress(OSError):
            say(
                f"mavhums: cannot write {error.filename or 'the standard output'}: {error.strerror}", err=True
            )
        code = code if code in _TOLD else ExitCode.ERROR
    sys.exit(code)  # type: ignore[arg-type]


def _abandon(stream: TextIO) -> None:
    """Discard the rest of a stream, so that the interpreter does not write it again."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
    with suppress(OSError):
        stream.flush()


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


def announce_compiling() -> None:
    """Print on standard error why the first call takes longer; on a terminal with a count."""
    count = 0

    def tell() -> None:
        nonlocal count
        count += 1
        if count == 1:
            text = "mavhums: compiling its inner loops for this machine, once; it takes some twenty seconds"
            say(f"{text} (ahead of time: mavhums warm-up)", err=True)
        if sys.stderr.isatty():
            click.echo(f"\r  {count} loops", nl=False, err=True)

    startup.on_compile(tell)
