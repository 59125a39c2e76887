"""Axes judged by the aircraft's other flights: what they find beside what each flight shows by itself.

    python benchmarks/response_history.py FOLDER [--airframe PROFILE]

FOLDER holds labelled flights as for ``benchmarks/alfa.py``. Each is compared with all other flights of the
folder whose axis is moved by the same surfaces, as if these had been flown before; those that are normal by
themselves are the reference. Delays count to the end of the minute that shows the loss.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from _flown_faults import Flight, read_labels

from mavhums import Options
from mavhums.app.analysis import analyse_alone
from mavhums.flights.compare import StandaloneAssessment, compared
from mavhums.flights.history import is_healthy
from mavhums.health.self_baseline.past import PastRecord
from mavhums.results.verdict import Verdict

AFTER_S = 30.0  # an alarm that soon after a fault's end is the fault's


def main() -> None:
    """Judge every flight of a folder by the others and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--airframe", default=None)
    arguments = parser.parse_args()
    settings = Options(airframe=arguments.airframe).resolved()
    labelled = [*read_labels(arguments.folder)]
    alone = [analyse_alone(flight.path, settings) for flight in labelled]
    counts = dict.fromkeys(("faults", "alone", "with others", "false", "normal", "normal with others"), 0)
    bounded = dict.fromkeys(("roll", "pitch", "yaw"), (0, 0))
    for k, flight in enumerate(labelled):
        others = [*alone[:k], *alone[k + 1 :]]
        after = compared(alone[k], {}, lambda _, start: _records(alone[k], others))  # noqa: B023
        _tell(flight, alone[k], after.verdicts, counts, bounded)
    print(counts)
    print("seconds that exclude a loss of 40 %, alone and with others:", bounded)


def _records(
    flight: StandaloneAssessment, others: Sequence[StandaloneAssessment]
) -> dict[tuple[int, str], list[PastRecord]]:
    """Return the records of the axes that the same surfaces move, by vehicle and axis."""
    found: dict[tuple[int, str], list[PastRecord]] = {}
    for other in others:
        if _frame(other) == _frame(flight):
            for one in _axes(other.assessment.verdicts):
                left = PastRecord(one.own, str(datetime.min), is_healthy(one))
                found.setdefault((one.vehicle or 0, one.actuator), []).append(left)
    return found


def _frame(flight: StandaloneAssessment) -> list[tuple[str, ...]]:
    """Return what moves each axis: flights of one frame share it."""
    return [one.surfaces for one in _axes(flight.assessment.verdicts)]


def _axes(verdicts: Sequence[Verdict]) -> list[Verdict]:
    return [verdict for verdict in verdicts if verdict.subject == "axis"]


def _tell(flight: Flight, alone: StandaloneAssessment, after: Sequence[Verdict], counts, bounded) -> None:
    faults = [one for one in flight.faults if not one.confounds]
    counts["faults"] += len(faults)
    before = {one.actuator: one for one in _axes(alone.assessment.verdicts)}
    raised = [one for one in _axes(after) if one is not before[one.actuator] and one.worst in _GRAVE]
    shown = [one for one in before.values() if one.worst in _GRAVE]
    counts["alone"] += any(shown) and len(faults) > 0
    right = [one for one in raised if any(one.actuator in fault.axes for fault in faults)]
    counts["with others"] += bool(shown or right) and len(faults) > 0
    counts["false"] += len(raised) - len(right)
    for one in _axes(after):
        if one.actuator in bounded:
            a, b = bounded[one.actuator]
            bounded[one.actuator] = a + before[one.actuator].coverage.excluded, b + one.coverage.excluded
        counts["normal"] += before[one.actuator].condition == "normal"
        counts["normal with others"] += one.condition == "normal"
    for one in raised:
        evidence = one.evidence[0]
        print(f"{flight.path.name}: {one.actuator} {one.worst}: {evidence.rule}")
        for fault in faults:
            print(f"    {fault.surface} ({fault.kind}) from {fault.start_s:.0f} s to {fault.end_s:.0f} s")


_GRAVE = ("degraded", "emergency")

if __name__ == "__main__":
    main()
