"""Axes judged by the aircraft's other flights: what they find beside what each flight shows by itself.

    python benchmarks/response_history.py FOLDER [--airframe PROFILE]

FOLDER holds labelled flights as for ``benchmarks/alfa.py``. Each is compared with all other flights of the
folder whose axis is moved by the same surfaces, as if these had been flown before; those that are normal by
themselves are the reference.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from benchmarks._flown_faults import Fault, Flight, read_labels
from mavhums import Options
from mavhums.app.analysis import analyse_alone
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared
from mavhums.flights.history import PastVerdict
from mavhums.health.decision.baseline import PastRecord
from mavhums.results.verdict import Verdict

GRAVE = ("degraded", "emergency")


def main() -> None:
    """Judge every flight of a folder by the others and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--airframe", default=None)
    arguments = parser.parse_args()
    settings = Options(airframe=arguments.airframe).resolved()
    labelled = [*read_labels(arguments.folder)]
    alone = [analyse_alone(flight.path, settings) for flight in labelled]
    faults, by_itself, by_others = sum(1 for flight in labelled if _real(flight)), Tally(), Tally()
    for k, flight in enumerate(labelled):
        others = [*alone[:k], *alone[k + 1 :]]
        after = compared(alone[k], lambda *_: {}, lambda _, start: _records(alone[k], others))  # noqa: B023
        before = {one.actuator: one for one in _axes(alone[k].assessment.verdicts)}
        judged = {one.actuator: one for one in _axes(after.verdicts)}
        by_itself.add(flight, before)
        by_others.add(flight, judged)
        for axis, one in judged.items():
            if one is not before[axis] and one.worst in GRAVE:
                print(f"{flight.path.name}: {axis} {one.worst}: {one.evidence[0].rule}")
    rows = zip(by_itself.rows(faults), by_others.rows(faults), strict=True)
    print(f"{'':40}{'alone':>12}{'with others':>12}")
    print("\n".join(f"{name:40}{value:>12}{other:>12}" for (name, value), (_, other) in rows))


@dataclass
class Tally:
    """What the verdicts of all flights say of their axes."""

    found: int = 0
    false: int = 0
    normal: int = 0
    excluded_s: Counter[str] = field(default_factory=Counter)

    def add(self, flight: Flight, verdicts: Mapping[str, Verdict]) -> None:
        """Count the axes of one flight; an alarm on an axis that no fault of the flight acts on is false."""
        grave = {axis for axis, one in verdicts.items() if one.worst in GRAVE}
        right = {axis for fault in _real(flight) for axis in fault.axes}
        self.found += bool(grave & right)
        self.false += len(grave - right)
        self.normal += sum(one.condition == "normal" for one in verdicts.values())
        self.excluded_s.update(
            {axis: one.coverage.excluded for axis, one in verdicts.items() if one.coverage}
        )

    def rows(self, faults: int) -> Iterator[tuple[str, object]]:
        """Yield the lines of the table: name and value."""
        yield f"flights found, of {faults} with faults", self.found
        yield "alarms on an axis without a fault", self.false
        yield "axes normal at the end", self.normal
        for axis in ("roll", "pitch", "yaw"):
            yield f"{axis}: seconds that exclude a loss of 40 %", self.excluded_s[axis]


def _real(flight: Flight) -> list[Fault]:
    return [one for one in flight.faults if not one.confounds]


def _records(
    flight: StandaloneAssessment, others: Sequence[StandaloneAssessment]
) -> dict[tuple[int, str], list[PastRecord]]:
    """Return the records of the axes that the same surfaces move, by vehicle and axis."""
    found: dict[tuple[int, str], list[PastRecord]] = {}
    for other in others:
        if _frame(other) == _frame(flight):
            for one in _axes(other.assessment.verdicts):
                left = PastRecord(one.own, str(datetime.min), PastVerdict.of(one).is_healthy)
                found.setdefault((one.vehicle or 0, one.actuator), []).append(left)
    return found


def _frame(flight: StandaloneAssessment) -> list[tuple[str, ...]]:
    """Return what moves each axis: flights of one frame share it."""
    return [one.surfaces for one in _axes(flight.assessment.verdicts)]


def _axes(verdicts: Sequence[Verdict]) -> list[Verdict]:
    return [verdict for verdict in verdicts if verdict.subject == "axis"]


if __name__ == "__main__":
    main()
