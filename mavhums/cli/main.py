"""The command line. Commands are imported when they run, and their own modules only then."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Mapping
from importlib import import_module
from types import FrameType
from typing import Final, Never

import click

from mavhums.cli.output import complain, say, sound_output
from mavhums.core.about import __version__
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.startup import collect_seldom

_HOMES: Final[Mapping[str, Mapping[str, str]]] = {
    "Judge": {"analyse": "analyse", "report": "analyse", "serve": "serve", "live": "live", "mcp": "serve"},
    "Look": {"inspect": "tools", "check": "tools", "export": "tools"},
    "Over flights": {"trend": "fleet", "fleet": "fleet"},
    "Set up": {"profile": "tools"},
    "Models": {"model": "tools", "train": "learn", "precedents": "learn", "study": "learn"},
}
"""The module of each command, by the heading of the help."""

_LONGEST: Final = 60  # a line of 80 columns holds that beside the name


class _Commands(click.Group):
    """The commands under their headings, each imported when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands' names in the order of the help."""
        return [name for homes in _HOMES.values() for name in homes]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; None if there is none of this name."""
        home = next((homes[cmd_name] for homes in _HOMES.values() if cmd_name in homes), None)
        return getattr(import_module(f"mavhums.cli.{home}"), cmd_name) if home else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under their headings, the most used first."""
        width = max(map(len, self.list_commands(ctx)))
        for heading, homes in _HOMES.items():
            commands = {name: self.get_command(ctx, name) for name in homes}
            with formatter.section(heading):
                formatter.write_dl(
                    [
                        (name.ljust(width), command.get_short_help_str(_LONGEST))
                        for name, command in commands.items()
                        if command
                    ]
                )


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True},
)
@click.version_option(__version__, prog_name="mavhums")
def cli() -> None:
    """Health of a UAV's servos and control surfaces from the log it already records.

    \b
    Start here:
      mavhums analyse flight.tlog                  the verdict per actuator
      mavhums analyse flight.tlog --rrd flight.rrd the same, and a Rerun recording
      mavhums report flight.tlog -o report.html    the same as one HTML file
      mavhums serve                                the same in the browser: drop logs on a page
      mavhums analyse flight.tlog --keep           the same, and kept for the comparison of later flights
      mavhums trend                                each actuator over its flights
      mavhums live udpin:14550                     the same verdicts while it flies
      mavhums inspect flight.tlog                  what the log holds, and what is missing
      mavhums profile new flight.tlog -o mine.toml a profile of your aircraft, to be filled in
    """


def main() -> None:
    """Run the command line; an error that the user can correct is one line with a remedy."""
    os.umask(os.umask(0o077) | 0o077)  # stores, recordings and reports hold positions
    _end_on_signals()
    collect_seldom()
    with sound_output():
        try:
            cli.main(prog_name="mavhums", standalone_mode=False)
        except MavhumsError as error:
            complain(error)
            sys.exit(ExitCode.ERROR)
        except click.ClickException as error:
            error.show()
            sys.exit(ExitCode.USAGE)
        except (click.Abort, KeyboardInterrupt):
            say("mavhums: stopped; no output was left half-written", err=True)
            sys.exit(130)
        except UnicodeEncodeError as error:
            remedy = "rename it: tables and viewers take UTF-8 alone"
            complain(MavhumsError(f"{error.object}: is not UTF-8", remedy))
            sys.exit(ExitCode.ERROR)
        except Exception:
            if not _received:
                raise
            # Some libraries turn an interruption of their import into an error of their own.
            sys.exit(_BY_SIGNAL + _received[-1])
        finally:
            # What it had to do is done, and the interpreter exits: Ctrl-C ends the program silently.
            signal.signal(signal.SIGINT, signal.SIG_DFL)


_BY_SIGNAL: Final = 128
_PATIENCE_S: Final = 4
_received: list[int] = []


def _end_on_signals() -> None:
    """Make SIGTERM, Ctrl-C and a terminal's SIGHUP end the program in order, and remove unfinished files.

    A signal that the caller ignores, as ``nohup`` does, stays ignored. A command with its own handlers, such
    as ``live``, replaces these.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _end)


def _end(number: int, _: FrameType | None) -> Never:
    """End the program, some seconds later whatever its end waits for: a pipe, a reader, a network."""
    _received.append(number)
    if hasattr(signal, "alarm"):
        signal.alarm(_PATIENCE_S)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    signal.signal(number, signal.SIG_IGN)
    sys.exit(_BY_SIGNAL + number)
