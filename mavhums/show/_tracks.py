"""One actuator's part of a recording: condition, evidence and quantities."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Container, Mapping
from typing import Final

import numpy as np
import rerun as rr

from mavhums.actuator.mapping import Samples
from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.actuator.detector import Detector
from mavhums.health.decision.events import Classified, ConditionChanged, Indication, Trace, Window
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Verdict
from mavhums.show._craft import CraftModel, vehicle_part
from mavhums.show._signals import ROWS_PER_CHUNK, Classes, RowWriter, Signals
from mavhums.show.event_words import drawn, trace_words
from mavhums.show.words import (
    BLUE,
    COLOURS,
    PALE_BLUE,
    STALE,
    STALE_COLOUR,
    YELLOW,
    axis_levels,
    capital,
    levels,
)

STALE_S: Final = 3.0
"""An actuator without data for longer than this is stale: its condition is no longer shown as current."""

_EFFECTIVENESS: Final = "effectiveness"
_FAULTY: Final[tuple[Condition, ...]] = ("degraded", "emergency")
_COMPARED: Final[tuple[Condition, ...]] = ("unchanged", "changed", "learning")
_STATES: Final = {**{str(name): rgb for name, rgb in COLOURS.items()}, STALE: STALE_COLOUR}
_HALF_WINDOW_S: Final = 5.0


def path_part(name: str) -> str:
    """Return a name as part of an entity path: the viewer shows what it must escape with backslashes.

    Examples
    --------
    >>> path_part("aileron (servo 4)")
    'aileron_servo_4'
    """
    return re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "unnamed"


class Track:
    """Draws the engine's events about one actuator.

    Parameters
    ----------
    rows
        The recording.
    vehicle, actuator
        Whose track it is; the entities lie under the paths of both.
    craft
        The vehicle's airframe.
    others
        Root paths of other tracks: names that differ in signs alone would share one.

    Attributes
    ----------
    root
        The entity path of the actuator.
    parts
        Names of the airframe's parts that have the colour of its condition.
    detectors
        Detectors by fault, with quantity and limits; empty without a profile.
    axis_limits
        Limits of an axis.
    traces
        What lies behind the judgement, by its kind: the quantity, and its entity path.
    reference_s
        Flight seconds from and to which an axis's reference was learned; None without one.
    condition, worst
        The current condition, and the worst condition so far.
    stale
        Whether the actuator's telemetry is silent.
    cause
        The fault that caused the worst condition.
    faults
        Indicators by fault: what each shows, and its entity path.
    last_s
        Flight time of the latest data.
    """

    def __init__(
        self,
        rows: RowWriter,
        vehicle: int | None,
        actuator: str,
        craft: CraftModel,
        others: Container[str] = (),
    ) -> None:
        self.vehicle, self.actuator, self._craft = vehicle, actuator, craft
        self.root = f"/{vehicle_part(vehicle)}/{path_part(actuator)}"
        while self.root in others:
            self.root += "_"
        self.parts: list[str] = []
        self.detectors: Mapping[str, Detector] = {}
        self.axis_limits = AxisLimits()
        self.traces: dict[str, tuple[str, str]] = {}
        self.reference_s: tuple[int, int] | None = None
        self.condition: Condition = "undecided"
        self.worst: Condition = "undecided"
        self.stale = False
        self.last_s = 0.0
        self.cause = "friction"
        self.faults: dict[str, tuple[str, str]] = {}
        self._rows = rows
        self._signals = Signals(rows, f"{self.root}/quantities", self._move)
        self._classes = Classes(rows, f"{self.root}/network")
        self._limits: dict[str, list[float]] = {}
        self._states: list[tuple[float, str]] = []
        self._written: deque[tuple[float, str]] = deque(maxlen=ROWS_PER_CHUNK)
        self._first_s = self._heard_s = np.inf
        self._state_s: float | None = None
        rows.style(self.root, _state_style())

    @property
    def present(self) -> frozenset[str]:
        """Quantities with data, and ``network`` if one says anything."""
        return frozenset(self._signals.present | ({"network"} if self._classes.any else set()))

    def take(self, event: Samples | Window | Indication | Trace | Classified) -> None:
        """Add data of any kind."""
        match event:
            case Classified():
                self._classes.add(event)
            case Samples():
                self.samples(event)
            case Window():
                self.window(event)
            case Indication():
                self.indication(event)
            case Trace():
                self.trace(event)

    def samples(self, event: Samples) -> None:
        """Add samples."""
        time = event.time_s
        if not time.size:
            return
        if self._first_s < np.inf:
            steps = np.diff(time, prepend=self._heard_s)
            for row in np.flatnonzero(steps > STALE_S).tolist():
                self._fall_silent(float(time[row] - steps[row]))
                self._state(float(time[row]), self.condition)
                self.stale = False
        self._heard_s = float(time[-1])
        self._note_span(float(time[0]), self._heard_s)
        self._signals.add(time, event.values)

    def window(self, event: Window) -> None:
        """Add the results of a window."""
        self._note_span(event.start_s, event.end_s)
        self.condition = event.condition
        self._classes.add_window(event)
        middle_s, found = (event.start_s + event.end_s) / 2, event.friction_nm
        friction = (found.estimate, found.low, found.high) if found else (np.nan,) * 3
        self._indicate("friction", np.array([middle_s]), np.array([friction]))

    def indication(self, event: Indication) -> None:
        """Add values of a fault indicator, except friction, which windows contain."""
        if event.fault == "friction" or not event.end_s.size:
            return
        if event.fault == _EFFECTIVENESS:  # nothing else says from when to when an axis is followed
            self._note_span(0.0, float(event.end_s[-1]))
        rows = np.stack([event.value, event.low, event.high], axis=1)
        self._indicate(event.fault, event.end_s - _HALF_WINDOW_S, rows)

    def _indicate(self, fault: str, time_s: Array, rows: Array) -> None:
        """Draw an indicator, its interval and its limits; without a value up to then there is none."""
        if fault not in self.faults:
            if np.isnan(rows).all():
                return
            title, limits = self._levels(fault)
            leaf = ["friction"] if fault == "friction" else ["faults", fault]
            self.faults[fault] = title, self.root + rr.new_entity_path(leaf)
            self._limits[fault] = [value for value, _ in limits]
            names = [f"{name} {value:g}" for value, name in limits]
            style = rr.SeriesLines(
                names=[fault.replace("_", " "), "low (95 %)", "high (95 %)", *names],
                colors=[BLUE, PALE_BLUE, PALE_BLUE, *map(_colour, names)],
                widths=[2.5, 1, 1, *[2] * len(names)],
            )
            self._rows.style(self.faults[fault][1], style)
        limits_too = np.hstack([rows, np.tile(self._limits[fault], (len(rows), 1))])
        self._rows.put(self.faults[fault][1], time_s, rr.Scalars.columns, scalars=limits_too)

    def _levels(self, fault: str) -> tuple[str, list[tuple[float, str]]]:
        """Return the title of an indicator, and its limits with their names."""
        if fault == _EFFECTIVENESS:
            return "Control effectiveness, share of the reference", axis_levels(self.axis_limits)
        detector = self.detectors.get(fault)
        unit = detector.unit if detector and detector.unit != "1" else ""
        title = ", ".join(filter(None, (capital(fault.replace("_", " ")), unit)))
        return title, _limits(detector) if detector else []

    def trace(self, event: Trace) -> None:
        """Add what lies behind the judgement."""
        if event.kind not in self.traces:
            words = trace_words(event.actuator, event.kind)
            self.traces[event.kind] = capital(words.quantity), f"{self.root}/{event.kind}"
            names, colours = [words.against, words.value], [YELLOW, BLUE]
            style = rr.SeriesLines(names=names, colors=colours, widths=[1.5, 2.0])
            self._rows.style(self.traces[event.kind][1], style)
        self.reference_s = event.reference_s or self.reference_s
        self._note_span(float(event.time_s[0]), float(event.time_s[-1]))
        self._rows.put(self.traces[event.kind][1], event.time_s, rr.Scalars.columns, scalars=drawn(event))

    def changed(self, event: ConditionChanged) -> None:
        """Add a change of condition, drawn at its onset, not at the time of the decision."""
        if self._state_s is None and event.since_s > self._first_s:
            self._state(self._first_s, event.before)
        self._state(event.since_s, event.after)
        self.condition = event.after
        if SEVERITY[event.after] >= SEVERITY[self.worst]:
            self.cause = event.fault
        self.worst = max(self.worst, event.after, key=SEVERITY.__getitem__)

    def conclude(self, verdict: Verdict) -> None:
        """Show over the whole flight what only its end, or a comparison with earlier flights, shows."""
        condition = verdict.condition
        # Whether motors are sound is decided over the flight: no change of condition says so.
        if condition == "unmonitored" or (verdict.subject == "motor" and self.worst == "undecided"):
            self._forget_states(condition)
            return
        if condition in _FAULTY and SEVERITY[condition] > SEVERITY[self.worst]:
            self._forget_states(condition)
            self._state(min(self._first_s, self.last_s), condition)
        if condition in _FAULTY and verdict.since and self._states and self._states[-1][1] == condition:
            # The verdict knows the earliest evidence, the alarm only that which raised it.
            before_s = self._states[-2][0] if len(self._states) > 1 else 0.0
            since_s = min(self._states[-1][0], max(verdict.since.flight_time_s, before_s + 1e-6))
            self._states[-1] = since_s, condition
        if condition not in _COMPARED or self._first_s == np.inf:
            return
        self._states = [
            (at_s, condition if state == self.condition else state) for at_s, state in self._states
        ]
        self.condition = self.worst = condition
        if self._state_s is None:
            self._state(self._first_s, condition)

    def _forget_states(self, condition: Condition) -> None:
        self._states.clear()
        self._state_s = None
        self.condition = self.worst = condition

    def now(self, time_s: float) -> None:
        """Set the current flight time, so that silence is detected."""
        if time_s - self._heard_s > STALE_S:
            self._fall_silent(self._heard_s)

    def flush(self) -> None:
        """Write buffered data."""
        if self._state_s is None and self._first_s < np.inf:
            self._state(self._first_s, self.condition)
        self._flush_states()

    def finish(self) -> None:
        """Write remaining data, and a state even for an actuator without data."""
        if self._state_s is None:
            self._state(self._first_s if self._first_s < np.inf else 0.0, self.condition)
        self.flush()

    def lane(self, path: str) -> None:
        """Write the states once more under ``path``; of a flight with thousands of changes, the last ones."""
        if self._written:
            self._rows.style(path, _state_style())
            times, states = zip(*self._written, strict=True)
            self._rows.put(path, times, rr.StateChange.columns, state=states)

    def _note_span(self, first_s: float, last_s: float) -> None:
        self._first_s, self.last_s = min(self._first_s, first_s), max(self.last_s, last_s)

    def _move(self, time_s: Array, values: Array) -> None:
        self._craft.move(self.actuator, time_s, values)

    def _fall_silent(self, time_s: float) -> None:
        if not self.stale:
            self.stale = True
            if self._state_s is None:
                self._state(self._first_s, self.condition)
            self._state(time_s, STALE)

    def _state(self, time_s: float, state: str) -> None:
        """Add a state; an earlier state never covers a later one."""
        self._state_s = time_s if self._state_s is None else max(time_s, self._state_s + 1e-6)
        self._states.append((self._state_s, state))
        if len(self._states) >= ROWS_PER_CHUNK:
            self._flush_states()

    def _flush_states(self) -> None:
        if self._states:
            times, states = zip(*self._states, strict=True)
            self._written.extend(self._states)
            self._states = []
            self._rows.put(self.root, times, rr.StateChange.columns, state=states)
            for part in self.parts:
                self._craft.colour(part, times, [_STATES[state] for state in states])


def _state_style() -> rr.StateConfiguration:
    return rr.StateConfiguration(
        values=list(_STATES),
        labels=[*COLOURS, "stale: no data"],
        colors=[(*rgb, 255) for rgb in _STATES.values()],
    )


def _limits(detector: Detector) -> list[tuple[float, str]]:
    """Return a quantity's limits and their names; a two-sided one has its limit on either side."""
    normal, emergency = detector.levels
    other_side = levels(-normal, None, falls=True) if normal is not None and detector.two_sided else []
    return [*levels(normal, emergency), *other_side]


def _colour(name: str) -> tuple[int, int, int]:
    """Return the colour of the condition with which the name of a limit begins."""
    return next((rgb for condition, rgb in COLOURS.items() if name.startswith(condition)), COLOURS["normal"])
