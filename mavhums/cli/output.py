"""What the commands print: nothing that a terminal would obey, and nothing that it cannot show."""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

import click

from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.text import printable

__all__ = ["complain", "say", "say_json", "sound_output"]

_BEYOND_ASCII = re.compile(r"[^\x00-\x7e]")
_TOLD = (ExitCode.EMERGENCY, ExitCode.DEGRADED)


def say(text: str, *, err: bool = False) -> None:
    """Print lines; what a terminal would obey is replaced."""
    click.echo("\n".join(printable(line) for line in text.split("\n")), err=err)


def say_json(text: str) -> None:
    r"""Print JSON; characters that the output cannot carry, or a terminal would obey, become ``\uXXXX``."""
    encoding = sys.stdout.encoding or "ascii"

    def escaped(match: re.Match[str]) -> str:
        letter = match[0]
        with suppress(UnicodeEncodeError):
            letter.encode(encoding)
            if letter.isprintable():
                return letter
        return json.dumps(letter)[1:-1]

    click.echo(_BEYOND_ASCII.sub(escaped, text))


def complain(error: MavhumsError) -> None:
    """Say on standard error what went wrong, and the remedy."""
    say(f"mavhums: {error.problem}", err=True)
    if error.remedy:
        say(f"  remedy: {error.remedy}", err=True)


@contextmanager
def sound_output() -> Iterator[None]:
    """Let no output end a command in a traceback.

    A character that the output cannot carry becomes a question mark. An output that cannot be written ends
    the command with one line and exit code 1; what was found of an emergency is still told by the code. An
    output that nobody reads any more ends it in silence.
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
    """Let what is left of a stream go nowhere, so that the interpreter does not try to write it again."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
    with suppress(OSError):
        stream.flush()
