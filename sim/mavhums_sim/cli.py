"""The simulator's command line."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mavhums_sim._loop_options import plan_loop, with_loop_options
from mavhums_sim._options import DURATION, SEED, Planned, given, plan_flight, with_flight_options

if TYPE_CHECKING:
    from mavhums_sim.flight import Flight, FlightRecord
    from mavhums_sim.link import Link

Flown = TypeVar("Flown")


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True}
)
@click.version_option(package_name="mavhums", prog_name="mavhums-sim")
def cli() -> None:
    """Fly simulated servo actuators and write the MAVLink logs they would leave.

    \b
    Start here:
      mavhums-sim flight -o flight.tlog --friction elevator=0.225..1.0
      mavhums-sim campaign paper -o logs/
      mavhums-sim stream udpout:127.0.0.1:14550
      mavhums-sim validate
    """


@cli.command(short_help="Fly once; write a log and its truth.")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FILE.tlog|.BIN",
    help="Log to write.",
)
@click.option("--force", is_flag=True, help="Replace files that are there already.")
@with_loop_options
@with_flight_options
def flight(output: Path, force: bool, **options: Any) -> None:
    """Fly a four-surface aircraft once; write FILE.tlog or FILE.BIN, and FILE.truth.json.

    A .BIN is the log that the autopilot keeps on board; the options of the link are not for it.
    Surfaces: aileron_left, aileron_right, elevator, rudder.
    """
    for file in (output, output.with_suffix(".truth.json")):
        if file.is_file() and not force:
            raise click.UsageError(f"{file} is there already; name another, or replace it with --force")
    on_board = output.suffix.lower() == ".bin"
    if on_board and not given("tiers"):
        options["tiers"] = ("csrv", "esc-unsigned", "pwm")
    planned = plan_flight(options)
    loop = plan_loop(planned, options)
    from mavhums_sim.campaign import write_truth

    if loop is None:
        record = _fly(planned)
        counts, known = _written(record, output, planned), record.truth()
    elif planned.link.baud is not None:
        raise click.UsageError("a flight in closed loop has no --baud; --stream-rate slows its streams")
    elif on_board:
        raise click.UsageError("a flight in closed loop is written as a .tlog; name one with -o")
    else:
        from mavhums_sim.closed_loop import fly_closed_loop
        from mavhums_sim.closed_loop.log import write_loop
        from mavhums_sim.closed_loop.truth import truth as loop_truth

        flown = fly_closed_loop(loop[0])
        counts, known = write_loop(flown, output, loop[1], planned.link), loop_truth(flown)
    truth = write_truth(
        [{"log": output.name, **known, "messages": counts}], output.with_suffix(".truth.json")
    )
    click.echo(
        f"{output}: {sum(counts.values()):,} messages, {output.stat().st_size / 1e6:.1f} MB; truth in {truth}"
    )


def _fly(planned: Planned) -> FlightRecord:
    from mavhums_sim.flight import fly

    return fly(planned.flight)


def _written(record: FlightRecord, output: Path, planned: Planned) -> dict[str, int]:
    from mavhums_sim.dataflash import write_dataflash
    from mavhums_sim.telemetry import write_tlog

    if output.suffix.lower() != ".bin":
        return write_tlog(record, output, planned.link)
    try:
        return write_dataflash(record, output, day=planned.link.day)
    except ValueError as error:
        raise click.UsageError(str(error)) from error


@cli.command(short_help="Fly live: send messages when they are due.")
@click.argument("urls", nargs=-1, required=True, metavar="URL...")
@click.option(
    "--speed",
    default=1.0,
    type=click.FloatRange(0, min_open=True),
    help="Flight seconds per second.",
)
@with_flight_options
def stream(urls: tuple[str, ...], speed: float, **options: Any) -> None:
    """Fly live: send the messages to each URL when they are due.

    \b
    URL: udpout:HOST:PORT, udpbcast:…, tcp:… or tcpin:…
    """
    planned = plan_flight(options)
    from mavhums_sim.flight import fly
    from mavhums_sim.link import transmit
    from mavhums_sim.stream import connect
    from mavhums_sim.stream import stream as send
    from mavhums_sim.telemetry import messages

    record = fly(planned.flight)
    try:
        with ExitStack() as exits:
            writers = [exits.enter_context(connect(url)) for url in urls]
            frames = transmit(messages(record, planned.link), planned.link, planned.flight.seed)
            counts = send(frames, lambda data: [write(data) for write in writers], speed)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    click.echo(f"{', '.join(urls)}: {sum(counts.values()):,} messages")
    for name, count in sorted(counts.items()):
        click.echo(f"  {name} {count:,}")


@cli.command(short_help="Fly many flights; write logs and truth.json.")
@click.argument("name", metavar="NAME|FILE.toml")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Folder to write the logs to.",
)
@click.option(
    "--workers",
    type=click.IntRange(1),
    metavar="N",
    help="Processes; by default one per core, and one for short campaigns.",
)
@SEED
@DURATION
def campaign(name: str, output: Path, workers: int | None, seed: int, duration: float) -> None:
    """Fly a campaign and write a log per flight, and truth.json, into FOLDER.

    What an interrupted run has finished is not flown again.

    \b
    NAME:
      paper      the elevator at the paper's eight frictions, and growing from 0.225 to 1.0 N·m
      FILE.toml  cyclograms × conditions × seeds, with their own seed and duration
    """
    from mavhums_sim.campaign import run_campaign

    flights, link = _campaign(name, seed, duration)
    if workers is None:
        workers = min(os.cpu_count() or 1, max(1, len(flights) // 10))
    with _progress("flying") as progress:
        truth = run_campaign(flights, output, progress, link=link, workers=workers)
    click.echo(f"{output}: {len(flights)} flights of {flights[0][1].duration_s:g} s; truth in {truth}")


def _campaign(name: str, seed: int, duration: float) -> tuple[list[tuple[str, Flight]], Link | None]:
    from mavhums_sim.campaign import CAMPAIGNS
    from mavhums_sim.plan import load_plan

    if name in CAMPAIGNS:
        return list(CAMPAIGNS[name](seed, duration)), None
    if not name.endswith(".toml"):
        raise click.UsageError(f"no campaign {name!r}; there is {', '.join(CAMPAIGNS)}, or a FILE.toml")
    if given("seed") or given("duration"):
        raise click.UsageError(f"seed and duration_s of this campaign are set in {name}")
    try:
        plan = load_plan(Path(name))
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    return list(plan.flights()), plan.link


@cli.command(short_help="Check the physics against known solutions.")
def validate() -> None:
    """Check the physics against data sheet, solutions on paper, conservation and finer steps.

    Exits with 1 if a check fails.
    """
    from rich.console import Console
    from rich.table import Table

    from mavhums_sim.validation import validate as checks

    table = Table("check", "expected", "simulated", "allowed", "unit", "", box=None)
    failed = total = 0
    for check in checks():
        total += 1
        failed += not check.passed
        verdict = "ok" if check.passed else "[red]FAILED"
        numbers = (f"{check.expected:.6g}", f"{check.measured:.6g}", f"±{check.tolerance:.2g}")
        table.add_row(check.name, *numbers, check.unit, verdict)
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    click.echo(f"{total - failed} of {total} checks passed")
    sys.exit(1 if failed else 0)


def main() -> None:
    """Run the command line; a file that cannot be written is one line."""
    try:
        cli.main(prog_name="mavhums-sim", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except ModuleNotFoundError as error:
        click.echo(f"mavhums-sim: {error}", err=True)
        sys.exit(2)
    except OSError as error:
        click.echo(f"mavhums-sim: {error.filename or 'link'}: {error.strerror or error}", err=True)
        sys.exit(1)
    except (click.Abort, KeyboardInterrupt):
        click.echo("mavhums-sim: stopped; the flights finished so far are whole", err=True)
        sys.exit(130)


@contextmanager
def _progress(title: str) -> Iterator[Callable[[int, int], None] | None]:
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
