"""Results of closed-loop flights, a line each, so that a run can be continued or read midway."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor, Future
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks._closed_loop import Labelled, Planned
from benchmarks._flown_faults import CONFOUNDERS, Fault, Flight, judge_bytes
from mavhums.log import Decoder


@dataclass(frozen=True, slots=True)
class Alarm:
    """An alarm of an axis: what, since when, seconds of flight time."""

    axis: str
    fault: str
    condition: str
    time_s: float


@dataclass(frozen=True, slots=True)
class Result:
    """A flight as it was planned, and what was found in it.

    Attributes
    ----------
    start_s, end_s
        The labelled fault or confounder, flight time; None on a healthy flight.
    alarms
        While the fault lasted, or at any time on a healthy flight and after a confounder.
    early
        Alarms before the fault or confounder: all false.
    judged, evidence
        By axis the seconds judged, and the highest evidence of a loss or a lag.
    """

    name: str
    label: dict[str, str]
    start_s: float | None
    end_s: float | None
    axes: tuple[str, ...]
    alarms: tuple[Alarm, ...]
    early: tuple[Alarm, ...]
    conditions: dict[str, str]
    judged: dict[str, int]
    flown_s: float
    evidence: dict[str, float]


def results(
    flights: Iterable[Planned], pool: Executor | None, keep: Path | None, jobs: int
) -> Iterator[Result]:
    """Yield the result of each flight, those that ``keep`` holds without flying them again.

    Without a pool only those that ``keep`` holds.
    """
    known = {} if keep is None or not keep.exists() else _read(keep)
    waiting: list[Future[Result]] = []
    for planned in flights:
        if planned.name in known:
            yield known[planned.name]
            continue
        if pool is None:
            continue
        waiting.append(pool.submit(_fly, planned))
        if len(waiting) > 2 * jobs:
            yield _kept(waiting.pop(0).result(), keep)
    for future in waiting:
        yield _kept(future.result(), keep)


def _fly(planned: Planned) -> Result:
    labelled = planned.fly()
    faults = [*_faults(labelled)]
    outcome = judge_bytes(Flight(Path(labelled.name), faults), [labelled.tlog], None, planned.false_alarms)
    alarms = [Alarm(a.actuator, a.fault, a.after, a.time_s) for a in outcome.alarms]
    fault = faults[0] if faults else None
    start_s = fault.start_s if fault else -1.0
    end_s = fault.end_s + 1 if fault and not fault.confounds else float("inf")
    return Result(
        name=labelled.name,
        label=labelled.labels[0],
        start_s=fault.start_s if fault else None,
        end_s=fault.end_s if fault else None,
        axes=tuple(sorted(fault.axes)) if fault else (),
        alarms=tuple(a for a in alarms if start_s <= a.time_s <= end_s),
        early=tuple(a for a in alarms if a.time_s < start_s),
        conditions=outcome.conditions,
        judged={axis: seconds for axis, (seconds, _) in outcome.judged.items()},
        flown_s=outcome.flown_s,
        evidence=outcome.evidence,
    )


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


def _kept(result: Result, keep: Path | None) -> Result:
    if keep is not None:
        with keep.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result)) + "\n")
    return result


def _read(keep: Path) -> dict[str, Result]:
    """Return the results of a file; a last line that was cut off is ended, and its flight flown again."""
    found = {}
    text = keep.read_text(encoding="utf-8")
    if text and not text.endswith("\n"):
        with keep.open("a", encoding="utf-8") as file:
            file.write("\n")
    for line in text.splitlines():
        try:
            values: dict[str, Any] = json.loads(line)
        except json.JSONDecodeError:
            continue
        for name in ("alarms", "early"):
            values[name] = tuple(Alarm(**alarm) for alarm in values[name])
        result = Result(**values | {"axes": tuple(values["axes"])})
        found[result.name] = result
    return found
