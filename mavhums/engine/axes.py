"""The axes of every vehicle of a log: takes tables, yields changes of condition, returns findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Airframe
from mavhums.actuator.surfaces import of_airframe
from mavhums.core.conditions import Condition
from mavhums.engine.events import Notice
from mavhums.health.axis.monitor import AxisMonitor, explained_by
from mavhums.health.events import ConditionChanged, Indication
from mavhums.log import Table
from mavhums.report.axis_limits import AxisLimits
from mavhums.vehicle.events import Followed
from mavhums.vehicle.flight import Flight, Rows
from mavhums.vehicle.grid import RATE_HZ, Grid, Seconds
from mavhums.vehicle.inference import inferred
from mavhums.vehicle.parameters import Parameters, Sent
from mavhums.vehicle.signal_readers import MESSAGES, SignalReaders
from mavhums.vehicle.signals import Signal
from mavhums.vehicle.surfaces import Surfaces, of_parameters
from mavhums.vehicle.usage import Usage

__all__ = ["MESSAGES", "Axes", "VehicleAxes"]

AxisEvent = ConditionChanged | Indication | Followed | Notice
_TOLD_S: Final = 10  # most lists of parameters come within; a list that takes longer is applied in parts
_SHOWN_EVERY: Final = 5  # rows: four angles a second
_INFER_S: Final = 45
_RETRY_S: Final = 10
_LATEST_S: Final = 600
_INFERRED_FROM_S: Final = 120
_PARTED_S: Final = 3  # longer than an output that freezes takes to be noticed
_INFERENCES: Final = 3
_NAMES: Final = {"PARAM_VALUE": "param_id", "PARM": "Name", "parameter": "name"}
_FUNCTIONS: Final = ("SERVO", "PWM_", "CA_SV", "HIL_ACT")

Array = NDArray[np.float64]
Times = NDArray[np.int64]


class _Told(NamedTuple):
    """What the log told of the outputs, and the flight second from which it applies."""

    due_s: int
    surfaces: Surfaces
    limits: AxisLimits | None


class VehicleAxes:
    """The axes of one vehicle.

    What moves its surfaces is part of every judgement. When that turns out to be something else, because
    parameters come in flight or an inference fails, the flight so far is judged anew, and what was reported
    is revised by one change of condition.

    Parameters
    ----------
    vehicle
        System id.
    start_us
        Start of flight time, microseconds of UTC.
    surfaces
        Surfaces from a profile; None if the log is to define them.
    limits
        Limits from a profile; the defaults if None.
    angles
        Whether to yield the demanded and the flown angles as well, for a recording.

    Attributes
    ----------
    surfaces, flight, monitor
        The surfaces, the flight and the monitor, as far as known.
    usage
        Use of the vehicle's outputs.
    """

    def __init__(
        self,
        vehicle: int,
        start_us: int,
        surfaces: Surfaces | None,
        limits: AxisLimits | None = None,
        *,
        angles: bool = False,
    ) -> None:
        self.surfaces = surfaces
        self.monitor = AxisMonitor(vehicle, limits)
        self.flight = Flight(surfaces)
        self.usage = Usage()
        self._vehicle, self._angles = vehicle, angles
        self._grid = Grid(start_us)
        self._told: list[_Told] = []
        self._now_s = 0
        self._inferences, self._hoped_s, self._next_try_s = 0, 0, _INFER_S
        self._reported: dict[str, Condition] = {}
        self._shown_s: dict[str, float] = {}

    def reached_s(self, frames: Times, signals: Sequence[Signal]) -> Times:
        """Return the flight second that the vehicle's signals have reached at places in the log, (n,)."""
        return self._grid.reached_s(frames, signals)

    def tell(self, second: int, surfaces: Surfaces, limits: AxisLimits | None = None) -> None:
        """Take what the log reports when its signals have reached a flight second.

        It applies ten seconds later, together with what comes until then. Other limits begin the judgement
        anew.
        """
        if self._told and second < self._told[-1].due_s and limits is None is self._told[-1].limits:
            self._told[-1] = self._told[-1]._replace(surfaces=surfaces)
        else:
            self._told.append(_Told(second + _TOLD_S, surfaces, limits))

    def feed(self, signals: Sequence[Signal], *, final: bool = False) -> Iterator[AxisEvent]:
        """Take new samples; yield the changes of condition."""
        self.usage.feed(signals)
        seconds = self._grid.feed(signals, final=final)
        while seconds is not None:
            yield from self._apply(int(seconds.index[0]))
            now, seconds = self._next(seconds)
            yield from self._follow(now)
        if final and self._told:
            yield from self._apply(self._told[-1].due_s)

    def _next(self, seconds: Seconds) -> tuple[Seconds, Seconds | None]:
        """Return the seconds until the surfaces may change, and the rest."""
        first = int(seconds.index[0])
        ends = [told.due_s for told in self._told[:1]]
        if self.surfaces is None and self.flight.flown_s <= _INFER_S + _RETRY_S:
            ends.append(first + 1)
        elif self.surfaces is None or self.surfaces.origin == "inferred":
            ends.append(first - first % _RETRY_S + _RETRY_S)
        at = int(np.searchsorted(seconds.index, min(ends))) if ends else len(seconds.index)
        if at == len(seconds.index):
            return seconds, None
        return _part(seconds, 0, at), _part(seconds, at, len(seconds.index))

    def _follow(self, seconds: Seconds) -> Iterator[AxisEvent]:
        for rows in self.flight.feed(seconds):
            if self._angles:
                yield from _followed(self._vehicle, rows)
            for event in self.monitor.feed(rows):
                yield from self._report(event)
        self._now_s = int(seconds.index[-1]) + 1
        if self.surfaces is None and self.flight.flown_s >= self._next_try_s:
            yield from self._infer()
        elif self.flight.parted_s >= _PARTED_S:
            self._hoped_s = self.flight.flown_s
            self._next_try_s = self._hoped_s + _RETRY_S
            yield from self._adopt(None, "outputs that moved as one no longer do")

    def _apply(self, second: int) -> Iterator[AxisEvent]:
        """Apply what is due."""
        while self._told and self._told[0].due_s <= second:
            _, surfaces, limits = self._told.pop(0)
            if limits is None and not self._differs(surfaces):
                continue
            why = "a profile names its outputs" if limits else "its parameters name other outputs than before"
            yield from self._adopt(surfaces, why, limits)

    def _differs(self, surfaces: Surfaces) -> bool:
        """Return whether the flight must be judged anew with these surfaces.

        Other trims and ranges are other units, no other outputs: for them what is no longer kept of a long
        flight is not given up.
        """
        known = self.surfaces
        if known is None or known == surfaces:
            return known is None
        if known.origin == "profile":
            return False
        return self.flight.past.is_whole or not surfaces.same_outputs(known)

    def _adopt(
        self, surfaces: Surfaces | None, why: str, limits: AxisLimits | None = None
    ) -> Iterator[AxisEvent]:
        """Judge the flight anew with these surfaces, as far back as it is kept."""
        self.surfaces = surfaces
        self.monitor = AxisMonitor(self._vehicle, limits or self.monitor.limits)
        before = dict(self._reported)
        last: dict[str, ConditionChanged] = {}
        first_s = self._now_s
        for rows in self.flight.learn(surfaces):
            first_s = min(first_s, rows.second)
            for event in self.monitor.feed(rows):
                if isinstance(event, ConditionChanged):
                    last[event.actuator] = event
                    if event.actuator in before:
                        continue
                yield from self._report(event)
        if before:
            text = f"{why}: its axes are judged anew from {first_s} s on"
            yield Notice(float(self._now_s), self._vehicle, text)
        for axis, condition in before.items():
            yield from self._revised(axis, condition, last.get(axis), why)

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
        if last and after != "normal":
            change = replace(last, time_s=now_s, before=before)
        yield from self._report(change)

    def _report(self, event: ConditionChanged | Indication) -> Iterator[AxisEvent]:
        """Yield an event, an alert with the possible surfaces, of an indication only what is new."""
        axis = event.actuator
        if isinstance(event, Indication):
            new = event.end_s > self._shown_s.get(axis, -np.inf)
            if new.any():
                self._shown_s[axis] = float(event.end_s[-1])
                arrays = (event.end_s, event.value, event.low, event.high)
                yield Indication(event.vehicle, axis, event.fault, *(array[new] for array in arrays))
            return
        self._reported[axis] = event.after
        suspect = self.surfaces.brief(axis) if self.surfaces else ""
        named = event.finding and suspect
        yield replace(event, finding=f"{event.finding}: {suspect}?") if named else event

    def _infer(self) -> Iterator[AxisEvent]:
        """Try to infer the outputs from the last minutes, ever more rarely."""
        since_s = self.flight.flown_s - self._hoped_s
        self._next_try_s = self.flight.flown_s + max(_RETRY_S, since_s // 4)
        hopeful = since_s <= _LATEST_S and self._inferences < _INFERENCES
        known = self.flight.past.last(_INFERRED_FROM_S) if hopeful else None
        if known is None:
            return
        rows, pulses = known
        surfaces = inferred(
            rows, pulses, lambda axis, demand, others: explained_by(axis, rows, demand, others)
        )
        if surfaces is not None:
            self._inferences += 1
            yield from self._adopt(surfaces, "its outputs are inferred from the flight")


class Axes:
    """Follows the axes of every vehicle.

    Parameters
    ----------
    airframe
        The profile for every vehicle; None if each vehicle reports its own outputs.
    angles
        Whether to yield the demanded and the flown angles as well, for a recording.
    """

    def __init__(self, airframe: Airframe | None = None, *, angles: bool = False) -> None:
        self._angles = angles
        self._surfaces = of_airframe(airframe) if airframe else None
        self._limits = airframe.axes if airframe else None
        self._signals = SignalReaders()
        self._sent = Sent()
        self._told: dict[int, Surfaces] = {}
        self._vehicles: dict[int, VehicleAxes] = {}
        self._announced: list[tuple[int, int, Airframe]] = []

    def vehicle(self, vehicle: int) -> VehicleAxes | None:
        """Return the axes of a vehicle; None if it reported nothing about its flight."""
        return self._vehicles.get(vehicle)

    def parameters(self, vehicle: int) -> Parameters:
        """Return the parameters that a vehicle reported."""
        return self._sent.of(vehicle)

    def flown_s(self) -> float:
        """Return the seconds of forward flight of all vehicles."""
        return float(sum(axes.flight.flown_s for axes in self._vehicles.values()))

    def feed(
        self,
        tables: Mapping[str, Table],
        start_us: int,
        *,
        admits: Callable[[int], bool] = lambda _: True,
        final: bool = False,
    ) -> Iterator[AxisEvent]:
        """Take tables; yield the changes of condition.

        ``admits`` returns whether a vehicle is judged; ``final`` marks the end of the input.
        """

        def axes_of(vehicle: int) -> VehicleAxes:
            if vehicle not in self._vehicles:
                new = VehicleAxes(vehicle, start_us, self._surfaces, self._limits, angles=self._angles)
                self._vehicles[vehicle] = new
            return self._vehicles[vehicle]

        by_vehicle: dict[int, list[Signal]] = {}
        for signal in self._signals.read(tables):
            if admits(signal.vehicle):
                by_vehicle.setdefault(signal.vehicle, []).append(signal)
        for vehicle in by_vehicle:
            axes_of(vehicle)
        self._hear(tables, by_vehicle, axes_of, admits)
        for vehicle, axes in self._vehicles.items():
            yield from axes.feed(by_vehicle.get(vehicle, ()), final=final)

    def announce(self, vehicle: int, frame: int, airframe: Airframe) -> None:
        """Apply the profile that a vehicle named at a place in the log; before the tables of that place."""
        if of_airframe(airframe) is not None and self._surfaces is None:
            self._announced.append((vehicle, frame, airframe))

    def _hear(
        self,
        tables: Mapping[str, Table],
        signals: Mapping[int, Sequence[Signal]],
        axes_of: Callable[[int], VehicleAxes],
        admits: Callable[[int], bool],
    ) -> None:
        """Take the outputs' functions from profiles and parameters, in the order of sending."""
        while self._announced:
            vehicle, frame, airframe = self._announced.pop(0)
            surfaces, axes = of_airframe(airframe), axes_of(vehicle)
            [second] = axes.reached_s(np.array([frame]), signals.get(vehicle, ())).tolist()
            if surfaces is not None:
                axes.tell(second, surfaces, airframe.axes)
        if self._surfaces is None:
            for message, field in _NAMES.items():
                if message not in tables:
                    continue
                named = [name.startswith(_FUNCTIONS) for name in tables[message].texts(field)]
                sent = tables[message].select(np.array(named, dtype=bool))
                for vehicle in filter(admits, np.unique(sent.system).tolist()):
                    own = sent.select(sent.system == vehicle)
                    self._hear_parameters(
                        axes_of(vehicle), own, tables.get("HEARTBEAT"), signals.get(vehicle, ())
                    )
        if "HEARTBEAT" in tables:
            self._sent.take({"HEARTBEAT": tables["HEARTBEAT"]})

    def _hear_parameters(
        self, axes: VehicleAxes, sent: Table, heartbeats: Table | None, signals: Sequence[Signal]
    ) -> None:
        [vehicle] = np.unique(sent.system).tolist()
        seconds = axes.reached_s(sent.frame, signals)
        for second in np.unique(seconds).tolist():
            now = sent.select(seconds == second)
            if heartbeats is not None:  # what an integer parameter means depends on the autopilot
                self._sent.take({"HEARTBEAT": heartbeats.select(heartbeats.frame < now.frame[-1])})
            self._sent.take({sent.name: now})
            surfaces = of_parameters(self._sent.of(vehicle))
            if surfaces is not None and surfaces != self._told.get(vehicle):
                self._told[vehicle] = surfaces
                axes.tell(second, surfaces)


def _followed(vehicle: int, rows: Rows) -> Iterator[Followed]:
    """Yield the angles of roll and pitch in forward flight, where they are known."""
    time_s = rows.second + np.arange(0, len(rows), _SHOWN_EVERY) / RATE_HZ
    pairs = {"roll": (rows.roll_demand, rows.roll), "pitch": (rows.pitch_demand, rows.pitch)}
    for axis, (demand, flown) in pairs.items():
        angles = np.stack([demand, flown], axis=1)[::_SHOWN_EVERY]
        known = np.isfinite(angles[:, 1]) & rows.flying[::_SHOWN_EVERY]
        if known.any():
            yield Followed(vehicle, axis, time_s[known], angles[known])


def _part(seconds: Seconds, a: int, b: int) -> Seconds:
    return Seconds(seconds.index[a:b], {name: values[a:b] for name, values in seconds.signals.items()})
