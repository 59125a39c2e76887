"""Flights with labelled faults: reads the labels, judges each flight, and compares findings with labels."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import numpy as np

from mavhums import Engine, load_airframe
from mavhums.core.errors import MavhumsError
from mavhums.engine.events import Event
from mavhums.engine.options import EngineOptions
from mavhums.health.decision.events import ConditionChanged, Indication
from mavhums.log import read_blocks, read_log
from mavhums.results.verdict import Verdict

ALARMS = ("degraded", "emergency")
CONFOUNDERS = ("engine", "airspeed", "wind", "gps")
AFTER_S = 30.0
"""An alarm that comes this long after a fault was cleared is still the fault's."""

_AXES = {
    "aileron": {"roll"},
    "elevator": {"pitch"},
    "rudder": {"yaw"},
    "elevon": {"roll", "pitch"},
    "vtail": {"pitch", "yaw"},
    "all": {"roll", "pitch", "yaw"},
}


@dataclass(frozen=True, slots=True)
class Fault:
    """A labelled interval, flight seconds after the log's first frame."""

    surface: str
    kind: str
    start_s: float
    end_s: float
    servos: frozenset[int] = frozenset()

    @property
    def confounds(self) -> bool:
        """Whether it is no fault of a surface."""
        return self.surface in CONFOUNDERS

    @property
    def axes(self) -> set[str]:
        """Axes that a finding may name."""
        return _AXES.get(self.surface, set())


@dataclass(slots=True)
class Flight:
    """A file with its faults."""

    path: Path
    faults: list[Fault] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was found in a flight: the alarms, the conditions of the axes, and what could be judged.

    ``bounded`` is by axis the number of seconds that exclude a loss of 40 %, or that measured one.
    ``findings`` counts the axes with a finding that no other one explains; ``candidates`` are the outputs
    that explain them, ``singled_out`` those that are named alone. ``evidence`` is the highest of each axis.
    """

    flight: Flight
    alarms: tuple[ConditionChanged, ...]
    conditions: dict[str, str]
    judged: dict[str, tuple[int, int]]
    bounded: dict[str, int]
    reasons: dict[str, str]
    surfaces: tuple[str, ...]
    flown_s: float
    findings: int = 0
    candidates: frozenset[int] = frozenset()
    singled_out: frozenset[int] = frozenset()
    evidence: dict[str, float] = field(default_factory=dict)

    def found(self, fault: Fault) -> list[ConditionChanged]:
        """Return the alarms that came while a fault lasted."""
        return [a for a in self.alarms if fault.start_s <= a.time_s <= fault.end_s + 1]

    def false_alarms(self) -> list[ConditionChanged]:
        """Return the alarms that no fault of a surface explains."""
        real = [fault for fault in self.flight.faults if not fault.confounds]
        return [a for a in self.alarms if not any(f.start_s <= a.time_s <= f.end_s + AFTER_S for f in real)]

    def fault_free_s(self) -> float:
        """Return the seconds of forward flight outside faults, those after an engine failure included."""
        real = [fault for fault in self.flight.faults if not fault.confounds]
        return max(self.flown_s - sum(fault.end_s - fault.start_s for fault in real), 0.0)


def read_labels(folder: Path) -> Iterator[Flight]:
    """Yield the flights of a folder's ``labels.csv``: that of ALFA, or that of flights with boot times."""
    flights: dict[str, Flight] = {}
    with (folder / "labels.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if not row.keys() >= {"file", "surface"}:
                raise MavhumsError(
                    f"{file.name}: labels no surfaces", "name a folder of flights of fixed wings"
                )
            path = folder / row["file"]
            flight = flights.setdefault(row["file"], Flight(path))
            fault = _alfa(row, path) if "t_fault_s" in row else _booted(row, path)
            if fault is not None:
                flight.faults.append(fault)
    yield from flights.values()


def _alfa(row: dict[str, str], path: Path) -> Fault | None:
    """Times count from the flight's first SERVO_OUTPUT_RAW."""
    if row["fault"] == "none":
        return None
    log = read_log(path, messages=["SERVO_OUTPUT_RAW"])
    first = log.span[0] if log.span else 0
    offset = (int(log.tables["SERVO_OUTPUT_RAW"].time_us[0]) - first) / 1e6
    start, end = float(row["t_fault_s"]), float(row["t_end_s"])
    servos = frozenset(map(int, re.findall(r"\d+", row["servo_channels"])))
    return Fault(row["surface"], row["fault"], start + offset, end + offset, servos)


def _booted(row: dict[str, str], path: Path) -> Fault | None:
    """Times count from the autopilot's boot."""
    if row["kind"] == "none":
        return None
    log = read_log(path, messages=["ATTITUDE"])
    table, first = log.tables["ATTITUDE"], log.span[0] if log.span else 0
    offset = (int(table.time_us[0]) - first) / 1e6 - float(table["time_boot_ms"][0]) / 1e3
    end = row["t_clear_boot_s"] or row["t_end_boot_s"]
    surface = row["kind"] if row["surface"] == "none" else row["surface"]
    servos = frozenset(map(int, re.findall(r"SERVO(\d+)", row["servos"])))
    return Fault(surface, row["kind"], float(row["t_fault_boot_s"]) + offset, float(end) + offset, servos)


def judge(flight: Flight, airframe: str | Path | None) -> Outcome:
    """Return what the engine finds in a flight, its outputs named by a profile or by the log."""
    return judge_bytes(flight, read_blocks(flight.path), airframe)


def judge_bytes(
    flight: Flight, blocks: Iterable[bytes], airframe: str | Path | None, false_alarms: float = 1.0
) -> Outcome:
    """Return the same of the bytes of a flight."""
    profile = None if airframe is None else load_airframe(airframe)
    engine = Engine(EngineOptions(airframe=profile, false_alarms=false_alarms))
    events: list[Event] = []
    for block in blocks:
        events += engine.feed(block)
    events += engine.finish()
    changes = [event for event in events if isinstance(event, ConditionChanged)]
    alarms = tuple(c for c in changes if c.after in ALARMS and c.actuator in ("roll", "pitch", "yaw"))
    assessment = engine.assessment(indicators=False)
    axes = [v for v in assessment.verdicts if v.subject == "axis"]
    return Outcome(
        flight,
        alarms,
        {v.actuator: v.condition for v in axes},
        {v.actuator: (v.coverage.decidable, v.coverage.windows) for v in axes},
        {v.actuator: v.coverage.excluded + _measured(v.actuator, events) for v in axes},
        {v.actuator: v.reason or "" for v in axes},
        tuple(dict.fromkeys(s for v in axes for s in v.surfaces)),
        sum(use.forward_s or 0.0 for use in assessment.usage),
        *_named(axes),
        {v.actuator: v.highest_evidence for v in axes if v.highest_evidence is not None},
    )


def _named(axes: Sequence[Verdict]) -> tuple[int, frozenset[int], frozenset[int]]:
    own = [v for v in axes if v.worst in ALARMS and not v.consequence_of]
    outputs = [[(one.servo, one.because) for one in v.candidates] for v in own]
    alone = {found[0][0] for found in outputs if found and (found[0][1] or len(found) == 1)}
    return len(own), frozenset(servo for found in outputs for servo, _ in found), frozenset(alone)


def _measured(axis: str, events: Sequence[Event]) -> int:
    """Return the seconds in which the effectiveness of an axis with a fault was known."""
    own = [event for event in events if isinstance(event, ConditionChanged) and event.actuator == axis]
    # By their times: of one block of the log all indications come before all changes.
    changed_s = np.array([event.time_s for event in own])
    faulty = np.array([False, *(event.after in ALARMS for event in own)])
    return sum(
        int(faulty[np.searchsorted(changed_s, event.end_s, side="left")].sum())
        for event in events
        if isinstance(event, Indication) and event.actuator == axis
    )


def summary(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the figures over all flights, one a line."""
    lasting, short, delays, right, engines, flagged = 0, 0, [], 0, 0, 0
    single, among, alone, sure = 0, 0, 0, 0
    for outcome in outcomes:
        for fault in outcome.flight.faults:
            if fault.confounds:
                engines += 1
                after = [a for a in outcome.false_alarms() if fault.start_s <= a.time_s]
                flagged += bool(after)
                continue
            found = outcome.found(fault)
            long = fault.end_s - fault.start_s >= 20
            lasting, short = lasting + long, short + (not long)
            if found:
                delays.append((found[0].time_s - fault.start_s, long))
                right += any(a.actuator in fault.axes for a in found)
                single += outcome.findings == 1
                among += bool(fault.servos & outcome.candidates)
                alone += bool(outcome.singled_out)
                sure += bool(fault.servos & outcome.singled_out)
    hours = sum(outcome.fault_free_s() for outcome in outcomes) / 3600
    false = [alarm for outcome in outcomes for alarm in outcome.false_alarms()]
    seconds = [delay for delay, _ in delays] or [float("nan")]
    long_found = sum(long for _, long in delays)
    return [
        f"surface faults that leave 20 s or more: {long_found} of {lasting} found; shorter: "
        f"{len(delays) - long_found} of {short}",
        f"delay: median {median(seconds):.1f} s, worst {max(seconds):.1f} s",
        f"the axis named is one that the surface moves: {right} of {len(delays)}",
        f"one finding for one fault: {single} of {len(delays)}; the failed output is a candidate in {among}; "
        f"one output is named alone in {alone}, the right one in {sure}",
        f"false alarms: {len(false)} in {hours:.2f} h of fault-free flight "
        f"({len(false) / hours if hours else float('nan'):.2f} per hour)",
        f"engine failures and other confounders flagged as a surface: {flagged} of {engines}",
        "seconds of forward flight with a verdict; that exclude a loss of 40 % or measured one: "
        + ", ".join(_shares(outcomes, axis) for axis in ("roll", "pitch", "yaw")),
    ]


def _shares(outcomes: Sequence[Outcome], axis: str) -> str:
    flown_s = sum(outcome.flown_s for outcome in outcomes) or float("nan")
    judged = sum(outcome.judged.get(axis, (0, 0))[0] for outcome in outcomes)
    bounded = sum(outcome.bounded.get(axis, 0) for outcome in outcomes)
    return f"{axis} {100 * judged / flown_s:.0f} %; {100 * bounded / flown_s:.0f} %"
