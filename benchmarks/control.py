"""Control effectiveness on closed-loop flights: false alarms on healthy flights, and detections by fault.

    python benchmarks/control.py [--healthy-hours H] [--share S] [--seed N] [--jobs J] [--keep FILE]

Flights of JSBSim's aircraft under the simulator's autopilots (``benchmarks/_closed_loop.py``), from their
bytes alone: the detectors know nothing of that model. Seeds below 100 are for development, seeds from 1000 on
for a test. ``--share S`` uses every S-th faulty flight. ``--keep FILE`` writes each flight's result to a file
as it comes, and takes from it what a former run with the same seed has done. The rate of false alarms is given
with its 95 % upper bound (Poisson), the share of flights with one with that of Clopper and Pearson.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from _closed_loop import Labelled, Planned, confounders, healthy, jams, losses, others
from _flown_faults import CONFOUNDERS, Fault, Flight, Outcome, judge_bytes
from scipy.stats import chi2

from mavhums.log import Decoder


@dataclass(frozen=True, slots=True)
class Row:
    """A flight as it was planned, and what was found in it."""

    label: dict[str, str]
    outcome: Outcome


def fly(flights: Iterable[Planned], jobs: int) -> Iterator[Row]:
    """Fly, judge, compare; in so many processes."""
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_fly, flights)


def _fly(planned: Planned) -> Row:
    labelled = planned.fly()
    flight = Flight(Path(labelled.name), [*_faults(labelled)])
    return Row(labelled.labels[0], judge_bytes(flight, [labelled.tlog], None))


def _faults(labelled: Labelled) -> Iterator[Fault]:
    offset = _boot_offset(labelled.tlog)
    for label in labelled.labels:
        if label["kind"] == "none":
            continue
        end = float(label.get("t_clear_boot_s") or label["t_end_boot_s"])
        surface = label["kind"] if label["kind"] in CONFOUNDERS else label["surface"]
        yield Fault(surface, label["kind"], float(label["t_fault_boot_s"]) + offset, end + offset)


def _boot_offset(tlog: bytes) -> float:
    """Return the flight time at the autopilot's boot."""
    decoder = Decoder({"ATTITUDE"})
    tables = [decoder.feed(tlog), decoder.feed(b"", final=True)]
    table = next(found["ATTITUDE"] for found in tables if "ATTITUDE" in found)
    first = decoder.first_time_us or 0
    return (int(table.time_us[0]) - first) / 1e6 - float(table["time_boot_ms"][0]) / 1e3


def false_alarms(rows: Sequence[Row]) -> None:
    """Print the false alarms per 100 hours of healthy flight, and how much of it could be judged."""
    hours = sum(row.outcome.flown_s for row in rows) / 3600
    alarms = [alarm for row in rows for alarm in row.outcome.alarms]
    flights = sum(bool(row.outcome.alarms) for row in rows)
    bound = chi2.ppf(0.95, 2 * (len(alarms) + 1)) / 2
    print(f"healthy: {len(rows)} flights, {hours:.1f} h; {len(alarms)} alarms in {flights} flights: ", end="")
    print(f"{100 * len(alarms) / hours:.1f} per 100 h, at 95 % below {100 * bound / hours:.1f}")
    for row in rows:
        for alarm in row.outcome.alarms:
            what = f"{alarm.actuator} {alarm.fault} {alarm.after} at {alarm.time_s:.0f} s"
            print(f"    {row.outcome.flight.path}: {what} ({row.label['streams_hz']} Hz)")
    for axis in ("roll", "pitch", "yaw"):
        judged = sum(row.outcome.judged.get(axis, (0, 0))[0] for row in rows)
        normal = sum(row.outcome.conditions.get(axis) == "normal" for row in rows)
        share = 100 * judged / (3600 * hours)
        print(f"    {axis}: {share:.0f} % of the seconds judged, {normal} of {len(rows)} flights normal")


def found(title: str, rows: Sequence[Row], keys: Sequence[str]) -> None:
    """Print how many faults are found and how fast, by each of some columns of the labels."""
    for key in keys:
        groups: dict[str, list[Row]] = defaultdict(list)
        for row in rows:
            groups[row.label.get(key) or "—"].append(row)
        print(f"\n{title} by {key}")
        for value, group in sorted(groups.items(), key=lambda item: _order(item[0])):
            delays, named = [], 0
            for row in group:
                fault = row.outcome.flight.faults[0]
                alarms = row.outcome.found(fault)
                if alarms:
                    delays.append(alarms[0].time_s - fault.start_s)
                    named += any(alarm.actuator in fault.axes for alarm in alarms)
            middle = f"{sorted(delays)[len(delays) // 2]:.0f} s" if delays else "—"
            print(f"    {value}: {len(delays)} of {len(group)}, median {middle}, right axis {named}")


def _order(value: str) -> tuple[float, str]:
    try:
        return float(value), ""
    except ValueError:
        return float("inf"), value


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--healthy-hours", type=float, default=300.0)
    parser.add_argument("--share", type=int, default=1, help="every so-manieth of the faulty flights")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    arguments = parser.parse_args()
    jobs = arguments.jobs
    false_alarms([*fly(healthy(arguments.healthy_hours, arguments.seed), jobs)])
    columns = ("surface", "value", "streams_hz", "turb", "phase")
    for title, plan, keys in (
        ("frozen", jams, columns),
        ("reduced", losses, columns),
        ("other", others, ("kind", "surface", "streams_hz")),
        ("confounders", confounders, ("kind", "streams_hz")),
    ):
        found(title, [*fly([*plan(arguments.seed)][:: arguments.share], jobs)], keys)


if __name__ == "__main__":
    main()
