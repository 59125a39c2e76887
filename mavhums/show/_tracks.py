"""One actuator's part of a recording: condition, evidence and quantities."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Container, Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr

from mavhums.actuator.mapping import Samples
from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.actuator.detector import Detector
from mavhums.health.decision.events import Classified, ConditionChanged, Indication, Trace, Window
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import OUTSIDE, Verdict
from mavhums.show._craft import CraftModel, vehicle_part
from mavhums.show._signals import ROWS_PER_CHUNK, Classes, RowWriter, Signals
from mavhums.show.event_words import drawn, trace_words
from mavhums.show.words import BLUE, COLOURS, PALE_BLUE, STALE, STALE_COLOUR, YELLOW, axis_levels, levels

STALE_S: Final = 3.0
"""An actuator without data for longer than this is stale: its condition is no longer shown as current."""

_EFFECTIVENESS: Final = "effectiveness"
_FAULTY: Final[tuple[Condition, ...]] = ("degraded", "emergency")
_COMPARED: Final[tuple[Condition, ...]] = ("unchanged", "changed", "learning")
_STATES: Final = {**{str(name): rgb for name, rgb in COLOURS.items()}, STALE: STALE_COLOUR}
_HALF_WINDOW_S: Final = 5.0
_NETWORK_STYLE: Final = rr.SeriesLines(names="of ten seconds", colors=BLUE, widths=2.5)


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
        Entity paths of what lies behind the judgement, by its kind.
    reference_s
        Flight seconds from and to which an axis's reference was learned; None without one.
    known_s
        Flight time from which the profile is known.
    condition, worst
        The current condition, and the worst condition so far.
    stale
        Whether the actuator's telemetry is silent.
    cause
        The fault that caused the worst condition.
    faults
        Entity paths of indicators of faults other than friction.
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
        self.traces: dict[str, str] = {}
        self.reference_s: tuple[int, int] | None = None
        self.known_s = 0.0
        self.condition: Condition = "undecided"
        self.worst: Condition = "undecided"
        self.stale = False
        self.last_s = 0.0
        self.cause = "friction"
        self.faults: dict[str, str] = {}
        self._rows = rows
        self._signals = Signals(rows, f"{self.root}/quantities", self._move)
        self._classes = Classes(rows, f"{self.root}/network")
        self._drawn: set[str] = set()
        self._states: list[tuple[float, str]] = []
        self._written: deque[tuple[float, str]] = deque(maxlen=ROWS_PER_CHUNK)
        self._first_s = self._heard_s = np.inf
        self._state_s: float | None = None
        self._limits_s: dict[str, float] = {}
        rows.style(self.root, _state_style())

    @property
    def present(self) -> frozenset[str]:
        """Quantities with data, and ``friction`` and ``network`` if there are any."""
        return frozenset(self._signals.present | self._drawn | ({"network"} if self._classes.any else set()))

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
        middle_s = (event.start_s + event.end_s) / 2
        self._classes.add_window(middle_s, event.network)
        found, vote = event.friction_nm, event.p_fault
        friction = (found.estimate, found.low, found.high) if found else (np.nan,) * 3
        self._draw("friction", middle_s, friction, _interval_style("friction"))
        unknown = vote is None or event.network == OUTSIDE
        self._draw("network", middle_s, (np.nan if unknown else vote,), _NETWORK_STYLE)

    def _draw(self, leaf: str, time_s: float, values: Sequence[float | None], style: rr.SeriesLines) -> None:
        """Draw a window's values; what nothing is known of up to then is not drawn."""
        path, row = f"{self.root}/{leaf}", np.array([values], dtype=np.float64)
        if leaf not in self._drawn:
            if np.isnan(row).all():
                return
            self._drawn.add(leaf)
            self._rows.style(path, style)
        self._rows.put(path, [time_s], rr.Scalars.columns, scalars=row)

    def indication(self, event: Indication) -> None:
        """Add values of a fault indicator, except friction, which windows contain."""
        if event.fault == "friction" or not event.end_s.size:
            return
        if event.fault not in self.faults:
            self.faults[event.fault] = self.root + rr.new_entity_path(["faults", event.fault])
            self._rows.style(self.faults[event.fault], _interval_style(event.fault))
        rows = np.stack([event.value, event.low, event.high], axis=1)
        middle = event.end_s - _HALF_WINDOW_S
        if event.fault == _EFFECTIVENESS:  # nothing else says from when to when an axis is followed
            self._note_span(0.0, float(event.end_s[-1]))
        self._rows.put(self.faults[event.fault], middle, rr.Scalars.columns, scalars=rows)

    def trace(self, event: Trace) -> None:
        """Add what lies behind the judgement."""
        if event.kind not in self.traces:
            self.traces[event.kind] = f"{self.root}/{event.kind}"
            words = trace_words(event.actuator, event.kind)
            names, colours = [words.against, words.value], [YELLOW, BLUE]
            style = rr.SeriesLines(names=names, colors=colours, widths=[1.5, 2.0])
            self._rows.style(self.traces[event.kind], style)
        self.reference_s = event.reference_s or self.reference_s
        self._note_span(float(event.time_s[0]), float(event.time_s[-1]))
        self._rows.put(self.traces[event.kind], event.time_s, rr.Scalars.columns, scalars=drawn(event))

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
        self._flush_limits()

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

    def _flush_limits(self) -> None:
        """Draw the limits of the indicators up to the latest data."""
        known = {fault: _limits(detector) for fault, detector in self.detectors.items()}
        if _EFFECTIVENESS in self.faults:
            known[_EFFECTIVENESS] = axis_levels(self.axis_limits)
        for fault, limits in known.items():
            path = self.root if fault == "friction" else self.faults.get(fault)
            if path is None or not limits:
                continue
            values = [value for value, _ in limits]
            times = [max(self.known_s, self.last_s)]
            if fault not in self._limits_s:
                names = [f"{name} {value:g}" for value, name in limits]
                style = rr.SeriesLines(names=names, colors=[*map(_colour, names)], widths=[2] * len(names))
                self._rows.style(f"{path}/limits", style)
                times.insert(0, self.known_s)
            elif times[0] <= self._limits_s[fault]:
                continue
            self._limits_s[fault] = times[-1]
            rows = np.tile(values, (len(times), 1))
            self._rows.put(f"{path}/limits", times, rr.Scalars.columns, scalars=rows)


def _state_style() -> rr.StateConfiguration:
    return rr.StateConfiguration(
        values=list(_STATES),
        labels=[*COLOURS, "stale: no data"],
        colors=[(*rgb, 255) for rgb in _STATES.values()],
    )


def _interval_style(name: str) -> rr.SeriesLines:
    return rr.SeriesLines(
        names=[name.replace("_", " "), "low (95 %)", "high (95 %)"],
        colors=[BLUE, PALE_BLUE, PALE_BLUE],
        widths=[2.5, 1, 1],
    )


def _limits(detector: Detector) -> list[tuple[float, str]]:
    """Return a quantity's limits and their names; a two-sided one has its limit on either side."""
    normal, emergency = detector.levels
    other_side = levels(-normal, None, falls=True) if normal is not None and detector.two_sided else []
    return [*levels(normal, emergency), *other_side]


def _colour(name: str) -> tuple[int, int, int]:
    """Return the colour of the condition with which the name of a limit begins."""
    return next((rgb for condition, rgb in COLOURS.items() if name.startswith(condition)), COLOURS["normal"])
