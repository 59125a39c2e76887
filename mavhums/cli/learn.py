"""The commands that learn: ``train``, ``precedents`` and ``study``."""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mavhums.cli.options import AIRFRAME, LOGS, PATH
from mavhums.cli.output import reading, say, steps

if TYPE_CHECKING:
    from mavhums.learn.chain import Select
    from mavhums.learn.precedents import Origin

_BASE = click.option(
    "-d",
    "--dir",
    "folder",
    default="precedents",
    type=PATH,
    metavar="DIR",
    help="Folder of the labelled flights.",
)


@click.command(short_help="Train a model on simulated and labelled flights.")
@click.option("--airframe", default="paper", metavar="NAME|FILE", help="Airframe profile.")
@click.option(
    "--tier",
    default="instrumented",
    type=click.Choice(["instrumented", "without-load", "esc"]),
    help="Telemetry that the model is for: all of V1-V12, without V11 and V12, or of the ESCs.",
)
@click.option(
    "--flights",
    default=24,
    type=click.IntRange(0),
    help="Simulated flights per class; 0 trains on the precedents alone, without constants and limits.",
)
@click.option(
    "--select",
    default="algorithm-1",
    type=click.Choice(["algorithm-1", "pairwise", "exhaustive", "genetic", "none"]),
    help="What chooses the inputs: a filter, then a search of the subsets of what it keeps; or the search of"
    " all subsets, or of some by a genetic algorithm, without a filter; or nothing. Statistics of windows are"
    " left out one by one, whatever the search.",
)
@click.option(
    "--functions",
    default="x",
    metavar="NAME,...",
    help="Elementary functions of Algorithm 1: x, abs, sign, square, sqrt, sin.",
)
@click.option(
    "--order",
    default=2,
    type=click.IntRange(1, 6),
    help="How many functions form a product of Algorithm 1; the degree for --select pairwise.",
)
@click.option(
    "--r2",
    default=0.999,
    type=click.FloatRange(0, 1, min_open=True),
    help="R² from which a filter drops a quantity that others explain.",
)
@click.option(
    "--vectors",
    default=4000,
    type=click.IntRange(0),
    help="How many vectors represent the training samples; 0 trains on all.",
)
@click.option("--networks", default=50, type=click.IntRange(1), help="Networks to choose from.")
@click.option("--seed", default=1, type=int, help="Makes the model repeatable.")
@click.option("--precedents", type=PATH, metavar="DIR", help="Labelled flights that train too.")
@click.option(
    "--flown-weight",
    default=1.0,
    type=click.FloatRange(0, min_open=True),
    help="How many simulated samples one of a precedent counts for.",
)
@click.option("-o", "--output", required=True, type=PATH, metavar="MODEL", help="Model file to write.")
def train(
    airframe: str,
    tier: str,
    flights: int,
    select: Select,
    functions: str,
    order: int,
    r2: float,
    vectors: int,
    networks: int,
    seed: int,
    precedents: Path | None,
    flown_weight: float,
    output: Path,
) -> None:
    """Train a model for an airframe's actuators on simulated and labelled flights, and write it to MODEL.

    Training flies each class in the simulator in all flight modes and runs the paper's scheme: chi-square
    ranks the quantities, Algorithm 1 drops those that others explain, similar vectors are thinned, and
    networks of 4 to 16 tanh neurons choose the smallest subset of the rest that is as good as the best within
    a standard error and, on it, the best network. Flights that nothing was trained on calibrate its votes,
    and others again measure it. The same stages on the statistics of windows, which leave out one statistic
    after the other, give a second network, which knows every fault that the simulator flies. Precedents
    teach both; with three logs of a condition or more, whole logs of them calibrate and measure in place of
    simulated flights. Each stage prints what it kept, its time, and the most memory that training has taken
    so far; `mavhums model show MODEL` repeats what it kept.
    """
    from mavhums.actuator.profile import load_airframe
    from mavhums.learn import CommandLeakWarning, PrecedentBase, Scheme, save_model
    from mavhums.paper.flights import ModelOptions
    from mavhums.paper.train import train_model

    profile = load_airframe(airframe)
    names = tuple(name.strip() for name in functions.split(","))
    scheme = Scheme(select, names, order, r2, vectors or None, networks)
    base = PrecedentBase(precedents) if precedents else None
    started, latest = time.monotonic(), [time.monotonic()]

    def report(line: str) -> None:
        elapsed, latest[0] = time.monotonic() - latest[0], time.monotonic()
        say(line if line.startswith(" ") else f"{line}  [{elapsed:.1f} s{_peak_memory()}]")

    with steps("training") as progress, warnings.catch_warnings():
        warnings.simplefilter("always", CommandLeakWarning)
        warnings.showwarning = lambda message, *_: say(f"warning: {message}", err=True)
        options = ModelOptions(tier, flights, seed, scheme, flown_weight)
        trained = train_model(profile, options, precedents=base, report=report, progress=progress)
    model, card = save_model(output, *trained), trained[1]
    took_s = time.monotonic() - started
    say(f"{output}: {' '.join(card.features)} → {card.name}, sha256 {model.hash[:12]}, {took_s:.0f} s")
    for name, value in (card.calibration.metrics if card.calibration else {}).items():
        say(f"  {name.replace('_', ' ')}: {value:.4g}")


def _peak_memory() -> str:
    """Return the most memory that the process has taken so far, as a text; empty where it is not known."""
    if sys.platform == "win32":
        return ""
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return f", {most / (2**20 if sys.platform == 'darwin' else 2**10):.0f} MiB"


@click.group(short_help="Keep labelled flights for training.")
def precedents() -> None:
    """Keep labelled flights that supplement the simulation in training."""


@precedents.command("add", short_help="Add logs that an inspection has labelled.")
@LOGS
@click.option(
    "--labels",
    "table",
    type=PATH,
    metavar="FILE",
    help="CSV table with the columns log, actuator and label; no actuator: all others of the log.",
)
@click.option(
    "--label",
    metavar="CONDITION",
    help="The condition, in place of a table: normal, emergency (by friction), or another class.",
)
@_BASE
@click.option("--actuator", "names", multiple=True, metavar="NAME", help="Only this one; can be repeated.")
@AIRFRAME
@click.option(
    "--simulated/--flown",
    default=None,
    help="Whether the log is of a simulator or of an aircraft. Default: flown, but simulated if its board is"
    " that of mavhums-sim.",
)
def add_precedents(
    logs: tuple[Path, ...],
    table: Path | None,
    label: str | None,
    folder: Path,
    names: tuple[str, ...],
    airframe: str | None,
    simulated: bool | None,
) -> None:
    """Add the actuators of LOGs, in conditions that an inspection has established, to the base DIR.

    The conditions are the classes of the networks: normal, friction_degraded, friction_emergency (or
    emergency), winding_resistance, torque_constant, backlash, supply_sag, sensor_bias and jam.
    """
    from mavhums.actuator.profile import load_airframe
    from mavhums.learn import PrecedentBase
    from mavhums.learn.precedents import PrecedentError, label_of, read_labels
    from mavhums.paper.flown import add_log

    if (table is None) == (label is None) or (table and names):
        raise click.UsageError("name the conditions either with --labels, or with --label and --actuator")
    of_all = dict.fromkeys(names or ("",), label_of(label)) if label else {}
    by_log = read_labels(table) if table else {log.name: of_all for log in logs}
    if unlabelled := [str(log) for log in logs if log.name not in by_log]:
        raise PrecedentError(
            f"{table}: has no row of {', '.join(unlabelled)}", "add one, or leave the log out"
        )
    if absent := sorted(by_log.keys() - {log.name for log in logs}):
        say(f"{table}: left out, for their logs are not named: {', '.join(absent)}", err=True)
    profile, base = load_airframe(airframe) if airframe else None, PrecedentBase(folder)
    origin: Origin | None = None if simulated is None else "simulated" if simulated else "flown"
    for log in logs:
        with reading(log) as progress:
            added = add_log(base, log, by_log[log.name], airframe=profile, origin=origin, progress=progress)
        for precedent in added:
            said = precedent.provenance
            say(
                f"{precedent.path}: {said.actuator}, {said.label}, {said.origin}, {precedent.samples} samples"
            )


@precedents.command("list")
@_BASE
def list_precedents(folder: Path) -> None:
    """List what the base DIR holds."""
    from mavhums.learn import PrecedentBase

    for precedent in PrecedentBase(folder):
        said = precedent.provenance
        whose = f"{said.airframe} {said.actuator} (vehicle {said.vehicle}, {said.tier})"
        say(f"{said.label:18}  {said.origin:9}  {whose}  {precedent.samples} samples  {said.log}")


@click.group(short_help="Reproduce published results.")
def study() -> None:
    """Reproduce published results."""


@study.command("paper", short_help="Set the paper's tables and figures beside ours.")
@click.option("-o", "--output", required=True, type=PATH, metavar="DIR", help="Folder for the report.")
@click.option("--quick", is_flag=True, help="Fewer networks and iterations.")
@click.option("--seed", default=1, type=int, help="Of the networks; not of the flights.")
def study_paper(output: Path, quick: bool, seed: int) -> None:
    """Set the tables and figures of the paper beside ours: report, CSV tables and figures."""
    from mavhums.paper import write_study

    with steps("study") as progress:
        files = write_study(output, quick=quick, seed=seed, progress=progress)
    for file in files:
        say(str(file))


@study.command("real", short_help="Run the paper's stages on recordings of a real rig.")
@click.argument("data", type=PATH, metavar="DIR")
@click.option("-o", "--output", required=True, type=PATH, metavar="OUT", help="Folder for the report.")
@click.option("--quick", is_flag=True, help="Fewer folds, networks and trees.")
@click.option("--seed", default=1, type=int, help="Of folds, networks and trees.")
def study_real(data: Path, output: Path, quick: bool, seed: int) -> None:
    """Run the paper's selection and networks on the recordings of a rig with seeded faults.

    DIR holds a table for each condition, NAME.csv.gz, that of the healthy rig named normal, with set point,
    position error and current of whole runs at several loads. The report has the accuracies with sequences
    mixed, whole runs kept together, and a load, later runs or early stages left out, with and without the
    constants of the runs; and what the indicators of strokes find without learning any fault.
    """
    from mavhums.paper import write_real_study

    with steps("study") as progress:
        files = write_real_study(data, output, quick=quick, seed=seed, progress=progress)
    for file in files:
        say(str(file))
