"""The axes of one vehicle: takes signals, yields changes of condition, returns findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from math import ceil
from typing import Final

import numpy as np

from mavhums.actuator.profile import Airframe
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.engine.events import Notice
from mavhums.engine.motors import VehicleMotors
from mavhums.engine.moving_outputs import TRIED_AXES, contradiction, inferred, refutation, rests_on_outputs
from mavhums.engine.options import EngineOptions
from mavhums.engine.vehicle_setup import SetupHistory, VehicleSetup
from mavhums.health.axis.monitor import AxisChange, AxisMonitor
from mavhums.health.axis.thresholds import REFERENCE_S
from mavhums.health.decision.events import ConditionChanged, Trace
from mavhums.health.verdict.axis import verdicts_of_axes
from mavhums.health.verdict.obstacles import why_not_at_all
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Verdict
from mavhums.vehicle.events import VehicleEvents
from mavhums.vehicle.facts import Signal
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.grid import RATE_HZ, SHOWN_EVERY, Grid, Seconds
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import AXES, STEERING, Demands, Surfaces
from mavhums.vehicle.usage import Usage

AxisEvent = AxisChange | Notice
_INFER_S: Final = REFERENCE_S  # of forward flight: what a reference takes shows the surfaces, too
_RETRY_S: Final = 10  # between tries: each fits minutes of flight anew
_LATEST_S: Final = 600  # since there was hope: bounds the cost of a flight that allows no inference
_INFERRED_FROM_S: Final = 120  # the latest flight; longer costs more at each try
_PARTED_S: Final = 3  # longer than an output that freezes takes to be noticed
_INFERENCES: Final = 3  # each that is given up judges the flight anew: bounds the revisions
_TRIES_S: Final = (60, 120, 180)  # of forward flight: a reference takes 45 s, and none begins later
_RECENT_S: Final = 180  # before an alarm: with 120, two of seven wrong profiles raised it all the same


class VehicleAxes:
    """The axes of one vehicle.

    What moves its surfaces is part of every judgement. When that turns out to be something else, because
    parameters come in flight, parameters or the motion contradict the profile, or an inference fails, the
    flight so far is judged anew, and what was reported is revised by one change of condition.

    Parameters
    ----------
    vehicle
        System id.
    start_us
        Start of flight time, microseconds of UTC.
    airframe
        A profile; None if the log is to define the surfaces.
    events
        Where the events of its flight go.
    options
        How to judge.

    Attributes
    ----------
    setups
        The profile and the parameters, with the flight seconds from which they apply.
    surfaces, flight, monitor
        The surfaces, the flight and the monitor, as far as known.
    usage, grid
        Use of the vehicle's outputs; the grid of its signals.
    motors
        The motors of a multirotor.
    """

    def __init__(
        self,
        vehicle: int,
        start_us: int,
        airframe: Airframe | None,
        events: VehicleEvents,
        options: EngineOptions,
    ) -> None:
        self._vehicle, self._options = vehicle, options
        self.setups = SetupHistory(airframe)
        self.surfaces = self.setups.last.surfaces
        self.monitor = self._monitor(airframe.axes if airframe else None)
        self.flight = Flight(self.surfaces)
        self.usage = Usage()
        self.grid = Grid(start_us)
        self.motors = VehicleMotors(vehicle, options)
        self._events = events
        self._setup = self.setups.last
        self._answers: dict[str, str] = {}
        self._now_s, self._tries = 0, 0
        self._inferences, self._hoped_s, self._next_try_s = 0, 0, _INFER_S
        self._reported: dict[str, Condition] = {}
        self._shown_s: dict[tuple[str, str], float] = {}

    @property
    def parameters(self) -> Parameters | None:
        """The vehicle's parameters, as far as they apply."""
        return self._setup.parameters

    def feed(self, signals: Sequence[Signal], *, final: bool = False) -> Iterator[AxisEvent]:
        """Take new samples; yield the changes of condition."""
        self.usage.feed(signals)
        seconds = self.grid.feed(signals, final=final)
        while seconds is not None:
            first = int(seconds.index[0])
            yield from self._apply(self.setups.at(first))
            yield from self._look(first)
            now, seconds = self._next(seconds)
            phases = self._events.feed(now, self.motors.rotors)
            yield from self.motors.feed(now, phases)
            yield from self._follow(now)
        if final:
            yield from self._apply(self.setups.last)
            yield from self._look(self._now_s + _RETRY_S)

    def verdicts(self, identity: Identity, start_utc: datetime) -> Iterator[Verdict]:
        """Yield the verdicts on the axes and the motors, or why they are not judged."""
        received = self.grid.received()
        why = why_not_at_all(self.flight, identity.kind, received, self.parameters)
        if not why:
            yield from verdicts_of_axes(
                self._vehicle, self.monitor, self.surfaces, self.flight, start_utc, self.grid
            )
        yield from self.motors.verdicts(identity, self.flight, why, start_utc, received)

    @property
    def _without_axes(self) -> bool:
        if self.flight.on_ground:  # of a rover only its steering is judged
            return STEERING not in self.monitor.axes
        return self.motors.carry_alone and self.surfaces is None

    def _eager(self) -> bool:
        """Return whether the outputs may be inferred for the first time in any second."""
        return self.surfaces is None and self.flight.flown_s <= _INFER_S + _RETRY_S

    def _look(self, second: int) -> Iterator[AxisEvent]:
        """Infer the outputs, or give up inferred ones, where it is time to before a flight second.

        Only the second decides when, and not how many came at once.
        """
        if not self._eager() and (self._now_s - 1) // _RETRY_S == second // _RETRY_S:
            return
        if self.surfaces is None and self.flight.flown_s >= self._next_try_s:
            yield from self._infer()
        elif self.flight.parted_s >= _PARTED_S:
            self._hoped_s = self.flight.flown_s
            self._next_try_s = self._hoped_s + _RETRY_S
            yield from self._adopt(None, "outputs that moved as one no longer do")

    def _next(self, seconds: Seconds) -> tuple[Seconds, Seconds | None]:
        """Return the seconds that follow each other until the surfaces may change, and the rest."""
        first = int(seconds.index[0])
        due = self.setups.next_s(first)
        gap = np.flatnonzero(np.diff(seconds.index) > 1)[:1]
        ends = [*(seconds.index[gap] + 1).tolist(), *([] if due is None else [due])]
        if self._doubtful():
            ends.append(first + 1)
        elif self._eager():  # nothing is looked for before so much was flown
            ends.append(first + max(1, ceil(_INFER_S - self.flight.flown_s)))
        elif self.surfaces is None or self.surfaces.origin == "inferred":
            ends.append(first - first % _RETRY_S + _RETRY_S)
        at = int(np.searchsorted(seconds.index, min(ends))) if ends else len(seconds.index)
        if at == len(seconds.index):
            return seconds, None
        return seconds.part(0, at), seconds.part(at, len(seconds.index))

    def _follow(self, seconds: Seconds) -> Iterator[AxisEvent]:
        for rows in self.flight.feed(seconds):
            if self._options.vehicle_states and not self.flight.on_ground:
                yield from _angles(self._vehicle, rows)
            self._now_s = rows.second + rows.seconds
            events = [] if self._without_axes else list(self.monitor.feed(rows))
            refuted = self._refuted(events)
            if refuted is not None:
                yield from self._adopt(refuted, "the motion contradicts the profile")
                return  # all of it: doubtful seconds come one by one
            for event in events:
                yield from self._report(event)

    def _apply(self, setup: VehicleSetup) -> Iterator[AxisEvent]:
        """Judge by another setup from now on."""
        if setup is self._setup:
            return
        named = setup.airframe is not self._setup.airframe
        self._setup, self.motors.by_parameters = setup, setup.rotors
        self.flight.parameters = setup.parameters.values.keys() if setup.parameters else ()
        if named:
            self._answers.clear()
            self._tries = 0
        surfaces = self._as_it_moves(setup.surfaces) if setup.surfaces else self.surfaces
        limits = setup.airframe.axes if setup.airframe else self.monitor.limits
        if limits != self.monitor.limits or (surfaces is not None and self._differs(surfaces)):
            why = "a profile names its outputs" if named else "its parameters name other outputs than before"
            yield from self._adopt(surfaces, why, limits)
        elif surfaces and self.surfaces and surfaces.demands == self.surfaces.demands:
            before, self.surfaces = self.surfaces, surfaces
            yield from self._contradicted(before)

    def _differs(self, surfaces: Surfaces) -> bool:
        """Return whether the flight must be judged anew with these surfaces.

        Other trims and ranges are other units, no other outputs: for them what is no longer kept of a long
        flight is not given up, unless they are those of a profile that the log contradicts.
        """
        known = self.surfaces
        if known is None:
            return True
        if surfaces.demands == known.demands:
            return False
        alike = surfaces.same_outputs(known) and surfaces.contradicted == known.contradicted
        return self.flight.past.is_whole or not alike

    def _adopt(
        self, surfaces: Surfaces | None, why: str, limits: AxisLimits | None = None
    ) -> Iterator[AxisEvent]:
        """Judge the flight anew with these surfaces, as far back as it is kept."""
        before, self.surfaces = self.surfaces, surfaces
        self.monitor = self._monitor(limits or self.monitor.limits)
        first_s, events = self._now_s, list[AxisChange]()
        for rows in self.flight.learn(surfaces):
            first_s = min(first_s, rows.second)
            events += [] if self._without_axes else self.monitor.feed(rows)
        refuted = self._refuted(events)
        if refuted is not None:  # one axis less each time
            self.surfaces = before
            yield from self._adopt(refuted, "the motion contradicts the profile")
            return
        reported, last = dict(self._reported), dict[str, ConditionChanged]()
        for event in events:
            if isinstance(event, ConditionChanged):
                last[event.actuator] = event
            if not isinstance(event, ConditionChanged) or event.actuator not in reported:
                yield from self._report(event)
        if reported:
            text = f"{why}: its axes are judged anew from {first_s} s on"
            yield Notice(float(self._now_s), self._vehicle, text)
        yield from self._contradicted(before)
        against = surfaces.contradicted if surfaces else {}
        for axis, condition in reported.items():
            yield from self._revised(axis, condition, last.get(axis), against.get(axis, why))

    def _contradicted(self, before: Surfaces | None) -> Iterator[Notice]:
        """Say what contradicts the profile, unless it was said of the surfaces before."""
        said = before.contradicted.values() if before else ()
        for text in dict.fromkeys(self.surfaces.contradicted.values() if self.surfaces else ()):
            if text not in said:
                yield Notice(float(self._now_s), self._vehicle, text)

    def _doubtful(self) -> list[str]:
        """Return the axes whose outputs only a profile names: no parameter confirms them."""
        surfaces = self.surfaces
        if surfaces is None or surfaces.origin != "profile":
            return []
        recorded = surfaces.confirmed | surfaces.by_log
        return [axis for axis in TRIED_AXES if axis not in recorded and surfaces.of_axis(axis)]

    def _refuted(self, events: Sequence[AxisChange]) -> Surfaces | None:
        """Return the surfaces less the axes whose outputs the motion contradicts; None if it does of none.

        It is asked in the first minutes, and before an alarm is reported that rests on outputs which only a
        profile names.
        """
        surfaces, doubtful = self.surfaces, self._doubtful()
        if surfaces is None or not doubtful:
            return None
        alarms = [event for event in events if rests_on_outputs(event)]
        due = self._tries < len(_TRIES_S) and self.flight.flown_s >= _TRIES_S[self._tries]
        self._tries += due
        if due:
            self._ask(surfaces, doubtful, self._now_s)
        for alarm in alarms:
            self._ask(surfaces, doubtful, int(alarm.time_s), alarm.actuator)
        refuted = self._as_it_moves(surfaces)
        return None if refuted.contradicted == surfaces.contradicted else refuted

    def _ask(self, surfaces: Surfaces, axes: Sequence[str], until_s: int, alarmed: str = "") -> None:
        """Ask the motion up to a flight second whether it answers to the outputs of axes."""
        known = self.flight.last(_RECENT_S, until_s)
        if known is None:
            return
        rows, pulses = known
        rows = replace(rows, outputs=Demands(surfaces).feed(pulses))
        for axis in axes:
            outputs = surfaces.of_axis(axis)
            found = contradiction(rows, pulses, axis, outputs) if axis not in self._answers else None
            if found is not None:
                self._answers[axis] = found
            # the side force of the ailerons must be known to judge yaw
            concerned = alarmed == axis or (axis == "roll" and alarmed == "yaw")
            if concerned and not self._answers.get(axis):
                self._answers[axis] = refutation(rows, pulses, axis, outputs, self.monitor.limits)

    def _as_it_moves(self, surfaces: Surfaces) -> Surfaces:
        """Return the surfaces, less the axes that the motion contradicts and no parameter confirms."""
        recorded = surfaces.confirmed | surfaces.by_log
        found = {axis: text for axis, text in self._answers.items() if text and axis not in recorded}
        if "roll" in found:  # the side force of the ailerons must be known to judge yaw
            found["yaw"] = found["roll"]
        return replace(surfaces, contradicted={**surfaces.contradicted, **found}) if found else surfaces

    def _revised(
        self, axis: str, before: Condition, last: ConditionChanged | None, why: str
    ) -> Iterator[AxisEvent]:
        """Yield the change from what was reported of an axis to what its new judgement says."""
        after = last.after if last else "undecided"
        if after == before:
            return
        now_s = float(self._now_s)
        rule = f"{after}: {why}"
        change = ConditionChanged(self._vehicle, axis, now_s, now_s, before, after, rule, "effectiveness")
        if last and SEVERITY[after] != SEVERITY["normal"]:
            change = replace(last, time_s=now_s, before=before)
        yield from self._report(change)

    def _report(self, event: AxisChange) -> Iterator[AxisEvent]:
        """Yield an event, an alert with the possible surfaces, of values only what is new."""
        axis = event.actuator
        if not isinstance(event, ConditionChanged):
            kind, names = (
                (event.kind, ("time_s", "values"))
                if isinstance(event, Trace)
                else (event.fault, ("end_s", "value", "low", "high"))
            )
            time_s = getattr(event, names[0])
            new = time_s > self._shown_s.get((axis, kind), -np.inf)
            if new.any():
                self._shown_s[axis, kind] = float(time_s[-1])
                yield replace(event, **{name: getattr(event, name)[new] for name in names})
            return
        self._reported[axis] = event.after
        suspect = self.surfaces.brief(axis) if self.surfaces else ""
        named = event.finding and suspect
        yield replace(event, finding=f"{event.finding}: {suspect}?") if named else event

    def _monitor(self, limits: AxisLimits | None) -> AxisMonitor:
        """Return a new monitor of what the surfaces move."""
        axes, mixed = (self.surfaces.axes, self.surfaces.mixed) if self.surfaces else (AXES, None)
        options = self._options
        return AxisMonitor(
            self._vehicle, limits, axes, mixed, options.false_alarms, traced=options.vehicle_states
        )

    def _infer(self) -> Iterator[AxisEvent]:
        """Try to infer the outputs from the last minutes, ever more rarely."""
        since_s = self.flight.flown_s - self._hoped_s
        self._next_try_s = self.flight.flown_s + max(_RETRY_S, since_s // 4)
        hopeful = not self.flight.on_ground and since_s <= _LATEST_S and self._inferences < _INFERENCES
        known = self.flight.last(_INFERRED_FROM_S) if hopeful else None
        if known is None:
            return
        surfaces = inferred(*known)
        if surfaces is not None:
            self._inferences += 1
            yield from self._adopt(surfaces, "its outputs are inferred from the flight")


def _angles(vehicle: int, rows: Rows) -> Iterator[Trace]:
    """Yield the angles of roll and pitch in forward flight, where they are known."""
    time_s = rows.second + np.arange(0, len(rows), SHOWN_EVERY) / RATE_HZ
    pairs = {"roll": (rows.roll_demand, rows.roll), "pitch": (rows.pitch_demand, rows.pitch)}
    for axis, (demand, flown) in pairs.items():
        angles = np.stack([demand, flown], axis=1)[::SHOWN_EVERY]
        known = np.isfinite(angles[:, 1]) & rows.flying[::SHOWN_EVERY]
        if known.any():
            yield Trace(vehicle, axis, f"{axis}_angle", time_s[known], angles[known])
