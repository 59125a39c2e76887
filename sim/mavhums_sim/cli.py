"""The simulator's command line."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click

__all__ = ["main"]

_DURATION = click.option(
    "--duration",
    default=100.0,
    show_default=True,
    type=click.FloatRange(1, 36_000),
    metavar="S",
    help="Seconds.",
)
_SEED = click.option(
    "--seed",
    default=0,
    show_default=True,
    type=click.IntRange(0),
    help="Pilot, gusts and noise; the same seed flies the same.",
)


class _Friction(click.ParamType[tuple[str, tuple[float, float]]]):
    """``SURFACE=VALUE`` or ``SURFACE=FROM..TO``."""

    name = "friction"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, tuple[float, float]]:
        surface, _, numbers = value.partition("=")
        start, _, end = numbers.partition("..")
        try:
            return surface, (float(start), float(end or start))
        except ValueError:
            self.fail(
                f"{value!r} is not SURFACE=N·m or SURFACE=FROM..TO, for example elevator=0.225..1.0",
                param,
                ctx,
            )


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="mavhums", prog_name="mavhums-sim")
def cli() -> None:
    """Fly simulated servo actuators and write the MAVLink logs they would leave.

    \b
    Start here:
      mavhums-sim flight -o flight.tlog --friction elevator=0.225..1.0
      mavhums-sim campaign paper -o logs/
    """


@cli.command()
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), metavar="FILE.tlog")
@click.option(
    "--friction",
    multiple=True,
    type=_Friction(),
    metavar="SURFACE=N·m",
    help="Coulomb friction of a surface, 0.9 or growing 0.225..1.0; others have 0.225. Repeatable.",
)
@_SEED
@_DURATION
@click.option(
    "--rate",
    default=100.0,
    show_default=True,
    type=click.FloatRange(1, 500),
    metavar="HZ",
    help="Actuator telemetry.",
)
def flight(
    output: Path,
    friction: tuple[tuple[str, tuple[float, float]], ...],
    seed: int,
    duration: float,
    rate: float,
) -> None:
    """Fly one take-off of a four-surface aircraft; write FILE.tlog and FILE.truth.json.

    Surfaces: aileron_left, aileron_right, elevator, rudder.
    """
    from mavhums_sim.campaign import write_truth
    from mavhums_sim.flight import Flight, fly
    from mavhums_sim.telemetry import write_tlog

    try:
        planned = Flight(seed=seed, duration_s=duration, friction_nm=dict(friction), rate_hz=rate)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    record = fly(planned)
    counts = write_tlog(record, output)
    truth = write_truth(
        [{"log": output.name, **record.truth(), "messages": counts}], output.with_suffix(".truth.json")
    )
    click.echo(
        f"{output}: {sum(counts.values()):,} messages, {output.stat().st_size / 1e6:.1f} MB; truth in {truth}"
    )


@cli.command()
@click.argument("name", type=click.Choice(["paper"]), metavar="NAME")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), metavar="FOLDER")
@_SEED
@_DURATION
def campaign(name: str, output: Path, seed: int, duration: float) -> None:
    """Fly a campaign and write a log per flight, and truth.json, into FOLDER.

    \b
    NAME:
      paper   the elevator at the paper's eight frictions, and growing from 0.225 to 1.0 N·m
    """
    from mavhums_sim.campaign import CAMPAIGNS, run_campaign

    flights = list(CAMPAIGNS[name](seed, duration))
    with _progress("flying") as progress:
        truth = run_campaign(flights, output, progress)
    click.echo(f"{output}: {len(flights)} flights of {duration:g} s; truth in {truth}")


def main() -> None:
    """Run the command line; a file that cannot be written is one line."""
    try:
        cli.main(prog_name="mavhums-sim", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except OSError as error:
        click.echo(f"mavhums-sim: {error.filename}: {error.strerror}", err=True)
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
