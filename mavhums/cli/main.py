"""The command line. Commands import their modules when they run, so that ``--help`` is fast."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import click

from mavhums.cli.analyse import analyse, report
from mavhums.cli.fleet import fleet
from mavhums.cli.learn import precedents, study, train
from mavhums.cli.live import live
from mavhums.cli.options import AIRFRAME, DIALECT, JSON, LOG
from mavhums.cli.output import complain, reading, say, say_json, sound_output
from mavhums.cli.serve import serve
from mavhums.cli.signals import end_on_signals, interrupts_end_silently
from mavhums.cli.tools import announce_compiling, export, model, profile, warm_up
from mavhums.cli.trend import trend
from mavhums.core.collecting import collect_seldom
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.version import __version__

__all__ = ["main"]

_LONGEST: Final = 60  # a line of 80 columns holds that beside the name


class _Grouped(click.Group):
    """A group that lists its commands under headings.

    Parameters
    ----------
    headings
        Names of commands by heading, in the order of the help. A command that is under none comes last,
        under *Other*.
    """

    def __init__(
        self, *arguments: Any, headings: Mapping[str, Sequence[str]] | None = None, **options: Any
    ) -> None:
        super().__init__(*arguments, **options)
        self._headings = dict(headings or {})

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands, the most used first."""
        names = self.list_commands(ctx)
        listed = {name for several in self._headings.values() for name in several}
        rest = [name for name in names if name not in listed]
        width = max(map(len, names), default=0)
        for heading, several in {**self._headings, "Other": rest}.items():
            rows = [
                (name.ljust(width), self.commands[name].get_short_help_str(_LONGEST))
                for name in several
                if name in names
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)


@click.group(
    cls=_Grouped,
    headings={
        "Judge": ("analyse", "report", "serve", "live"),
        "Look": ("inspect", "check", "export"),
        "Over flights": ("trend", "fleet"),
        "Set up": ("profile", "warm-up"),
        "Models": ("model", "train", "precedents", "study"),
    },
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
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
      mavhums trend flights                        each actuator over its flights
      mavhums live udpin:14550                     the same verdicts while it flies
      mavhums inspect flight.tlog                  what the log holds, and what is missing
      mavhums profile new flight.tlog -o mine.toml a profile of your aircraft, to be filled in
    """


@cli.command(short_help="Tell what a log allows to judge, and what it lacks.")
@LOG
@AIRFRAME
@DIALECT
@click.option("--messages", is_flag=True, help="List the messages and named values, with their rates.")
@JSON
def inspect(log: Path, airframe: str | None, dialect: Path | None, messages: bool, as_json: bool) -> None:
    """Tell what LOG allows to judge, and what it lacks.

    First what can be judged, then each vehicle with its telemetry tier, what is missing and how to record
    it, and the log's losses.

    LOG may be - for the standard input.
    """
    from mavhums.app.inspection import inspect_log

    with reading(log) as progress:
        inspection = inspect_log(log, airframe=airframe, dialect=dialect, progress=progress)
    if as_json:
        say_json(inspection.to_json())
    else:
        from rich.console import Console

        from mavhums.show.inspection import render_inspection

        render_inspection(inspection, Console(), messages=messages)
    raise SystemExit(ExitCode.READ_WITH_LOSSES if inspection.losses.any else ExitCode.OK)


@cli.command(short_help="Check surfaces that are swept on the ground.")
@LOG
@AIRFRAME
@DIALECT
@JSON
def check(log: Path, airframe: str | None, dialect: Path | None, as_json: bool) -> None:
    """Check the servos whose surfaces are swept on the ground in LOG, before take-off.

    For each: the travel and the speed that it reaches, the hysteresis between the two ways (play, friction
    and lag), the roughness of its motion, and the friction in its current. `analyse --history` compares
    roughness and friction with the aircraft's earlier sweeps.

    Ends with 0 if travel and speed are reached, and with 10 if not.
    """
    from mavhums.app.check import check_log

    with reading(log) as progress:
        sweeps = check_log(log, airframe=airframe, dialect=dialect, progress=progress)
    if as_json:
        say_json(json.dumps([asdict(sweep) for sweep in sweeps], indent=2, ensure_ascii=False))
    else:
        for sweep in sweeps:
            say(sweep.told())
    raise SystemExit(ExitCode.DEGRADED if any(sweep.faults for sweep in sweeps) else ExitCode.OK)


for _command in (
    analyse,
    report,
    serve,
    live,
    trend,
    fleet,
    train,
    precedents,
    study,
    export,
    model,
    profile,
    warm_up,
):
    cli.add_command(_command)


def main() -> None:
    """Run the command line; an error that the user can correct is one line with a remedy."""
    end_on_signals()
    collect_seldom()
    announce_compiling()
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
        finally:
            interrupts_end_silently()
