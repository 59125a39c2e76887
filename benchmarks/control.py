"""Control effectiveness on closed-loop flights: false alarms on healthy flights, and detections by fault.

    python benchmarks/control.py [--healthy-hours H] [--minutes M] [--share S] [--seed N] [--jobs J]
                                 [--only BATTERY] [--keep FILE [--kept]] [--no-airspeed] [--false-alarms N]
                                 [--plot PNG]

Flights of JSBSim's aircraft under the simulator's autopilots (``benchmarks/_closed_loop.py``), from their
bytes alone: the detectors know nothing of that model. Seeds below 100 are for development, seeds from 1000
on for a test. ``--share S`` uses every S-th faulty flight, none with 0, ``--only`` those of one battery.
``--keep FILE`` writes each flight's result to a file as it comes, and takes from it what a former run with
the same seed has done; ``--kept`` flies nothing more and prints what the file holds. ``--false-alarms N``
accepts N in 100 h of an axis on healthy flights, to compare many that are promised with those that come;
``--plot PNG`` draws both for every rate, from the highest evidence of each axis in each flight. The rate of
false alarms is given with its 95 % upper bound (Poisson), the share of flights with one with that of Clopper
and Pearson.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from math import log
from pathlib import Path
from statistics import median

import numpy as np
from scipy.stats import beta, chi2

from benchmarks._closed_loop import Planned, confounders, healthy, jams, losses, mixed, others
from benchmarks._flown_results import Result, results

_SURE = 0.95


def false_alarms(rows: Sequence[Result]) -> None:
    """Print the false alarms per 100 hours of healthy flight, and how much of it could be judged."""
    if not rows:
        print("healthy: no flight")
        return
    hours = sum(row.flown_s for row in rows) / 3600
    alarms = sum(len(row.alarms) for row in rows)
    flights = sum(bool(row.alarms) for row in rows)
    bound = chi2.ppf(_SURE, 2 * (alarms + 1)) / 2
    share = beta.ppf(_SURE, flights + 1, len(rows) - flights) if flights < len(rows) else 1.0
    print(f"healthy: {len(rows)} flights, {hours:.1f} h; {alarms} alarms in {flights} flights")
    tested = sum(alarm.fault in ("effectiveness", "slow") for row in rows for alarm in row.alarms)
    judged = sum(sum(row.judged.values()) for row in rows) / 3600
    print(f"    {tested} of them by the test of effectiveness, in {judged:.1f} judged hours of axes")
    print(f"    {100 * alarms / hours:.2f} per 100 h, at 95 % below {100 * bound / hours:.2f} (Poisson)")
    print(f"    {100 * flights / len(rows):.2f} % of the flights, at 95 % below {100 * share:.2f} %")
    for row in rows:
        for alarm in row.alarms:
            what = f"{alarm.axis} {alarm.fault} {alarm.condition} at {alarm.time_s:.0f} s"
            how = f"{row.label['streams_hz']} Hz, turbulence {row.label['turb']}"
            print(f"    {row.name}: {what} ({how}, {row.label['model']}, {row.label['autopilot']})")
    _judged(rows)
    _promised(rows)


def _promised(rows: Sequence[Result]) -> None:
    """Print how many axes of flights reach the evidence of some rates of false alarms, as on the page."""
    hours = sum(sum(row.judged.values()) for row in rows) / 3600
    evidence = [value for row in rows for value in row.evidence.values()]
    print("\n| accepted in 100 h | evidence | axes of flights that reach it in 100 h |")
    print("|---|---|---|")
    for accepted in (1, 10, 100, 1000):
        threshold = log(360_000 / accepted)
        count = sum(value >= threshold for value in evidence)
        print(f"| {accepted} | {threshold:.1f} | {100 * count / hours:.1f} |" if hours else "| – | – | – |")


def plot(rows: Sequence[Result], path: Path) -> None:
    """Draw how many axes of flights reach the evidence of an accepted rate, with their 95 % interval."""
    from matplotlib.figure import Figure

    hours = sum(sum(row.judged.values()) for row in rows) / 3600
    evidence = np.sort([value for row in rows for value in row.evidence.values()])
    accepted = np.geomspace(0.1, 10_000, 200)
    counts = evidence.size - np.searchsorted(evidence, np.log(360_000 / accepted))
    low, high = (chi2.ppf(p, 2 * (counts + k)) / 2 for p, k in ((0.025, 0), (0.975, 1)))
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log", xlim=(0.1, 10_000), ylim=(0.1, 10_000))
    axes.plot(accepted, accepted, "k--", label="promised: at most as many as are accepted")
    axes.fill_between(accepted, 100 * np.nan_to_num(low) / hours, 100 * high / hours, alpha=0.3)
    axes.step(accepted, 100 * counts / hours, label=f"{len(rows)} healthy flights, {hours:.0f} judged hours")
    axes.set_xlabel("false alarms accepted in 100 h (--false-alarms)")
    axes.set_ylabel("axes of flights that alarm, in 100 h")
    axes.legend(loc="upper left")
    figure.savefig(path, dpi=100)


def _judged(rows: Sequence[Result]) -> None:
    for rate in sorted({float(row.label["streams_hz"]) for row in rows}):
        some = [row for row in rows if float(row.label["streams_hz"]) == rate]
        total = sum(row.flown_s for row in some)
        shares = [
            f"{axis} {100 * sum(row.judged.get(axis, 0) for row in some) / total:.0f} % of the seconds, "
            f"{sum(row.conditions.get(axis) == 'normal' for row in some)} of {len(some)} flights normal"
            for axis in ("roll", "pitch", "yaw")
        ]
        print(f"    judged at {rate:g} Hz: {'; '.join(shares)}")


def found(title: str, rows: Sequence[Result], keys: Sequence[str]) -> None:
    """Print how many faults are found and how fast, by some columns of the labels."""
    early = [alarm for row in rows for alarm in row.early]
    hours = sum(row.start_s or 0.0 for row in rows) / 3600
    print(f"\n{title}: {len(rows)} flights; before the fault {len(early)} alarms in at most {hours:.1f} h")
    for key in keys:
        groups: dict[str, list[Result]] = defaultdict(list)
        for row in rows:
            groups[", ".join(_size(row.label.get(part) or "in place") for part in key.split("+"))].append(row)
        print(f"  by {key}")
        for value, group in sorted(groups.items(), key=lambda item: _order(item[0])):
            print(f"    {value}: {_found(group)}")


def _found(group: Sequence[Result]) -> str:
    delays = [row.alarms[0].time_s - row.start_s for row in group if row.alarms and row.start_s is not None]
    named = sum(any(alarm.axis in row.axes for alarm in row.alarms) for row in group)
    middle = f"{median(delays):.0f} s" if delays else "—"
    return f"{len(delays)} of {len(group)}, median {middle}, right axis {named}"


def _size(value: str) -> str:
    """Return a deflection without its sign."""
    return value.removeprefix("-")


def _order(value: str) -> tuple[str, float]:
    first, _, last = value.rpartition(", ")
    try:
        return first, float(last)
    except ValueError:
        return value, -1.0


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--healthy-hours", type=float, default=300.0)
    parser.add_argument("--minutes", type=float, default=15.0, help="of one healthy flight")
    parser.add_argument("--share", type=int, default=1, help="fly every such of the faulty flights; 0: none")
    parser.add_argument("--only", choices=("frozen", "reduced", "other", "mixed", "confounders"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--keep", type=Path, default=None, help="file of the results so far")
    parser.add_argument("--false-alarms", type=float, default=1.0, help="accepted in 100 h of an axis")
    parser.add_argument("--no-airspeed", action="store_true", help="as without a sensor of the airspeed")
    parser.add_argument("--kept", action="store_true", help="fly nothing, print what FILE holds")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw what is promised and what comes")
    arguments = parser.parse_args()
    sensed, accepted = not arguments.no_airspeed, arguments.false_alarms

    def flown_as(flight: Planned) -> Planned:
        return replace(flight, false_alarms=accepted, airspeed=sensed)

    columns = ("surface", "surface+value", "surface+streams_hz", "turb", "phase")
    with ProcessPoolExecutor(arguments.jobs) as pool:
        fly = partial(
            results, pool=None if arguments.kept else pool, keep=arguments.keep, jobs=arguments.jobs
        )
        for title, plan, keys in (
            ("frozen", jams, columns),
            ("reduced", losses, columns),
            ("other", others, ("kind+surface", "streams_hz")),
            ("mixed", mixed, ("surface", "surface+kind+value", "streams_hz")),
            ("confounders", confounders, ("kind+value", "streams_hz")),
        ):
            if arguments.share and arguments.only in (None, title):
                flights = [*plan(arguments.seed)][:: arguments.share]
                found(title, [*fly([flown_as(flight) for flight in flights])], keys)
        if arguments.healthy_hours:
            rows = [*fly(map(flown_as, healthy(arguments.healthy_hours, arguments.seed, arguments.minutes)))]
            false_alarms(rows)
            if arguments.plot:
                plot(rows, arguments.plot)


if __name__ == "__main__":
    main()
