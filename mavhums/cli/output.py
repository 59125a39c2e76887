"""Prints output without control characters, and progress; no error of the output is a traceback."""

from __future__ import annotations

import io
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.output import printable

if TYPE_CHECKING:
    from mavhums.show.blocks import Block


def open_closed_streams() -> None:
    """Open the null device in place of streams that were closed; a file would take their numbers."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8", closefd=False))  # noqa: SIM115


_BEYOND_ASCII = re.compile(r"[^\x00-\x7e]")
_FINDINGS = (ExitCode.EMERGENCY, ExitCode.DEGRADED)


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


def draw(blocks: Iterable[Block]) -> None:
    """Draw blocks on the standard output."""
    from rich.console import Console

    from mavhums.show import terminal

    terminal.draw(blocks, Console())


def complain(error: MavhumsError) -> None:
    """Print an error and its remedy on standard error."""
    say(f"mavhums: {error.problem}", err=True)
    if error.remedy:
        say(f"  remedy: {error.remedy}", err=True)


class _Output(io.RawIOBase):
    """The raw standard output; after its first error it takes and discards the rest, and the command goes on.

    What a command finds, keeps and exits with does not depend on who reads its output.
    """

    error: OSError | None = None

    def __init__(self, stream: Any) -> None:
        self._stream = stream  # it would close its file with its end
        self._raw: Any = _raw(stream)

    def write(self, data: Any, /) -> int:
        if self.error is None:
            try:
                return int(self._raw.write(data) or 0)
            except OSError as error:
                self.error = error
        return len(data)

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def isatty(self) -> bool:
        return bool(self._raw.isatty())


def output_error() -> OSError | None:
    """Return why the standard output has failed; None if it has not."""
    raw = _raw(sys.stdout)
    return raw.error if isinstance(raw, _Output) else None


@contextmanager
def sound_output() -> Iterator[None]:
    """Prevent a traceback from any output error.

    A character that the output cannot encode becomes a question mark. An output that cannot be written gives
    one line and exit code 1, or the code of an emergency or degradation if found. An output that no process
    reads any more, or that was closed from the start, changes nothing else.
    """
    before = sys.stdout, sys.stderr
    open_closed_streams()
    for name in ("stdout", "stderr"):
        _harden(name)
    code: object = 0
    try:
        try:
            yield
        except SystemExit as stop:
            code = stop.code
        except OSError as error:
            say(f"mavhums: {error.filename or 'input or output'}: {error.strerror}", err=True)
            code = ExitCode.ERROR
        sys.stdout.flush()
        failure = output_error()
        if failure is not None and not isinstance(failure, BrokenPipeError):
            say(f"mavhums: cannot write the standard output: {failure.strerror}", err=True)
            code = code if code in _FINDINGS else ExitCode.ERROR
    finally:
        sys.stdout, sys.stderr = before
    sys.exit(code)  # type: ignore[arg-type]


def _raw(stream: Any) -> object:
    """Return what a text stream writes to at last; without buffering it has nothing between."""
    buffer = getattr(stream, "buffer", None)
    return getattr(buffer, "raw", buffer)


def _harden(name: str) -> None:
    stream = getattr(sys, name)
    if isinstance(_raw(stream), io.RawIOBase):
        stream.flush()
        buffer = io.BufferedWriter(_Output(stream))
        stream = io.TextIOWrapper(buffer, stream.encoding, line_buffering=stream.line_buffering)
        setattr(sys, name, stream)
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="replace")


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
