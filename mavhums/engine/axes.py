"""The axes of every vehicle of a log: takes tables, yields changes of condition, returns findings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Airframe
from mavhums.core.conditions import Condition
from mavhums.engine.events import Notice
from mavhums.engine.motion import TRIED_AXES, contradiction, explained, refutation, rests_on_outputs
from mavhums.engine.told import Known, Told
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.events import ConditionChanged, Indication
from mavhums.log import Table
from mavhums.vehicle.events import Followed
from mavhums.vehicle.flight import Flight, Rows
from mavhums.vehicle.grid import RATE_HZ, Grid, Seconds
from mavhums.vehicle.inference import inferred
from mavhums.vehicle.parameters import Parameters, Sent
from mavhums.vehicle.signal_readers import MESSAGES, SignalReaders
from mavhums.vehicle.signals import OUTPUTS, Signal, all_outputs
from mavhums.vehicle.surfaces import AXES, Surfaces
from mavhums.vehicle.usage import Usage

__all__ = ["MESSAGES", "Axes", "VehicleAxes"]

AxisEvent = ConditionChanged | Indication | Followed | Notice
_SHOWN_EVERY: Final = 5  # rows: four angles a second
_INFER_S: Final = 45
_RETRY_S: Final = 10
_LATEST_S: Final = 180
_KEPT_S: Final = 120
_TRIES_S: Final = (60, 120, 180)  # of forward flight: a reference takes 45 s, and none begins later
_RECENT_S: Final = 180  # before an alarm: with 120, two of seven wrong profiles raised it all the same
_NAMES: Final = {"PARAM_VALUE": "param_id", "PARM": "Name", "parameter": "name"}
_FUNCTIONS: Final = ("SERVO", "PWM_", "CA_SV", "HIL_ACT")

Array = NDArray[np.float64]


class VehicleAxes:
    """The axes of one vehicle.

    Parameters
    ----------
    vehicle
        System id.
    start_us
        Start of flight time, microseconds of UTC.
    airframe
        A profile; None if the log is to define the surfaces.
    angles
        Whether to yield the demanded and the flown angles as well, for a recording.

    Attributes
    ----------
    told
        The profile and the parameters, with the flight seconds from which they apply.
    surfaces, flight, monitor
        The surfaces, the flight and the monitor, as far as known.
    usage
        Use of the vehicle's outputs.
    """

    def __init__(
        self, vehicle: int, start_us: int, airframe: Airframe | None = None, *, angles: bool = False
    ) -> None:
        self.told = Told(airframe)
        self.surfaces = self.told.last.surfaces
        self.monitor = AxisMonitor(vehicle, airframe.axes if airframe else None)
        self.flight = Flight(self.surfaces)
        self.usage = Usage()
        self._vehicle, self._angles = vehicle, angles
        self._grid = Grid(start_us)
        self._now = self.told.last
        self._answers: dict[str, str] = {}
        self._tries = self._last_s = 0
        self._waiting: list[Seconds] = []
        self._since_try = 0

    def feed(self, signals: list[Signal], *, final: bool = False) -> Iterator[AxisEvent]:
        """Take new samples; yield the changes of condition."""
        self.usage.feed(signals)
        seconds = self._grid.feed(signals, final=final)
        while seconds is not None:
            now, seconds = self._next(seconds)
            yield from self._apply(self.told.at(int(now.index[0])), int(now.index[0]))
            self._last_s, at = int(now.index[-1]), 0
            while at < len(now.index) and (self.surfaces is None or self._doubtful()):
                one = _part(now, at, at + 1)
                yield from self._unknown(one) if self.surfaces is None else self._doubt(one)
                at += 1
            if at < len(now.index):
                yield from self._known(_part(now, at, len(now.index)))
        if final and self.told.last.found:  # a contradiction counts, however late it was heard
            yield from self._apply(self.told.last, self._last_s)

    def _next(self, seconds: Seconds) -> tuple[Seconds, Seconds | None]:
        """Return the seconds before something else applies, and the rest."""
        count = len(seconds.index)
        due = self.told.next_s(int(seconds.index[0]))
        at = count if due is None else int(np.searchsorted(seconds.index, due))
        return _part(seconds, 0, at), _part(seconds, at, count) if at < count else None

    def _apply(self, known: Known, second: int) -> Iterator[ConditionChanged | Notice]:
        """Use what is known from a flight second on; other limits begin the judgement anew."""
        if known is self._now:
            return
        if known.airframe is not self._now.airframe:
            self._answers.clear()
        self._now = known
        limits = known.airframe.axes if known.airframe else None
        if limits is not None and limits != self.monitor.limits:
            self.monitor = AxisMonitor(self._vehicle, limits)
        surfaces = known.surfaces
        if surfaces is not None:
            yield from self._use(self._as_it_moves(surfaces), second)

    def _use(
        self, surfaces: Surfaces, second: int, reported: Mapping[str, Condition] | None = None
    ) -> Iterator[ConditionChanged | Notice]:
        """Use these surfaces; what rested on others is judged anew.

        ``reported`` is the condition that was reported last, by axis, where it is not the present one.
        """
        before, self.surfaces = self.surfaces, surfaces
        if surfaces == before:
            return
        self.flight.learn(surfaces)
        self._waiting.clear()
        said = before.contradicted.values() if before else ()
        for text in dict.fromkeys(surfaces.contradicted.values()):
            if text not in said:
                yield Notice(float(second), self._vehicle, text)
        for axis in _judged_otherwise(before, surfaces):
            why = surfaces.contradicted.get(axis) or "other outputs than before move it"
            condition = (reported or {}).get(axis, self.monitor.condition(axis))
            yield from self.monitor.begin_anew(axis, second, condition, f"undecided: {why}")

    def _doubtful(self) -> list[str]:
        """Return the axes whose outputs only a profile names: no parameter confirms them."""
        surfaces = self.surfaces
        if surfaces is None or surfaces.origin != "profile":
            return []
        told = surfaces.confirmed | surfaces.by_log
        return [axis for axis in TRIED_AXES if axis not in told and surfaces.of_axis(axis)]

    def _doubt(self, second: Seconds) -> Iterator[AxisEvent]:
        """Follow the flight, and ask its motion whether it answers to the profile's outputs.

        An alarm from these outputs waits for the answer.
        """
        self._waiting.append(second)
        del self._waiting[:-_RECENT_S]
        events = [*self._known(second)]
        alarms = [event for event in events if rests_on_outputs(event)]
        due = self._tries < len(_TRIES_S) and self.flight.flown_s >= _TRIES_S[self._tries]
        if not due and not alarms:
            yield from events
            return
        self._tries += due
        surfaces = self._asked({alarm.actuator for alarm in alarms})
        refuted = _judged_otherwise(self.surfaces, surfaces)
        yield from (event for event in events if event not in alarms or event.actuator not in refuted)
        reported = {alarm.actuator: alarm.before for alarm in reversed(alarms)}
        yield from self._use(surfaces, int(second.index[0]), reported)

    def _asked(self, alarmed: Collection[str]) -> Surfaces:
        """Return the surfaces, less the axes whose outputs the motion contradicts."""
        surfaces = self.surfaces
        assert surfaces is not None
        rows, pulses = self._recent(surfaces)
        for axis in self._doubtful():
            outputs = surfaces.of_axis(axis)
            found = contradiction(rows, pulses, axis, outputs) if axis not in self._answers else None
            if found is not None:
                self._answers[axis] = found
            if not self._answers.get(axis) and (axis in alarmed or (axis == "roll" and "yaw" in alarmed)):
                self._answers[axis] = refutation(rows, pulses, axis, outputs, self.monitor.limits)
        return self._as_it_moves(surfaces)

    def _as_it_moves(self, surfaces: Surfaces) -> Surfaces:
        """Return the surfaces, less the axes that the motion contradicts and no parameter confirms."""
        told = surfaces.confirmed | surfaces.by_log
        found = {axis: text for axis, text in self._answers.items() if text and axis not in told}
        if "roll" in found:  # the side force of the ailerons must be known to judge yaw
            found["yaw"] = found["roll"]
        return replace(surfaces, contradicted={**surfaces.contradicted, **found}) if found else surfaces

    def _known(self, seconds: Seconds, *, again: bool = False) -> Iterator[AxisEvent]:
        """Follow the flight; ``again`` marks seconds whose angles were shown before."""
        for rows in self.flight.feed(seconds):
            if self._angles and not again:
                yield from _followed(self._vehicle, rows)
            for event in self.monitor.feed(rows):
                yield self._named(event) if isinstance(event, ConditionChanged) else event

    def _named(self, event: ConditionChanged) -> ConditionChanged:
        """Add the possible surfaces to the finding of an alert."""
        suspect = self.surfaces.brief(event.actuator) if self.surfaces else ""
        if not suspect or not event.finding:
            return event
        return replace(event, finding=f"{event.finding}: {suspect}?")

    def _unknown(self, second: Seconds) -> Iterator[AxisEvent]:
        """Follow the flight without its outputs, and try to infer them from its first part."""
        self._waiting.append(second)
        del self._waiting[:-_KEPT_S]
        yield from self._known(second)
        self._since_try += 1
        if self._since_try < _RETRY_S or not _INFER_S <= self.flight.flown_s <= _LATEST_S:
            return
        self._since_try = 0
        surfaces = self._inferred()
        if surfaces is not None:
            self.surfaces, waiting = surfaces, list(self._waiting)
            self._waiting.clear()
            self.monitor = AxisMonitor(self._vehicle, self.monitor.limits)
            again = Flight(surfaces)
            self.flight = again
            for seconds in waiting:
                yield from self._known(seconds, again=True)

    def _inferred(self) -> Surfaces | None:
        rows, pulses = self._recent(None)
        return inferred(rows, pulses[:, :OUTPUTS], lambda axis, demand: explained(rows, axis, demand))

    def _recent(self, surfaces: Surfaces | None) -> tuple[Rows, Array]:
        """Return the rows of the seconds that wait, and the pulses of all outputs over them."""
        probe = Flight(surfaces)
        rows = Rows.join([rows for seconds in self._waiting for rows in probe.feed(seconds)])
        names = ("outputs", "outputs_2", "outputs_3")
        parts = {name: [seconds.signals[name] for seconds in self._waiting] for name in names}
        flat = {name: np.concatenate(part) for name, part in parts.items()}
        return rows, all_outputs({name: v.reshape(-1, v.shape[-1]) for name, v in flat.items()})


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
        self._airframe = airframe
        self._signals = SignalReaders()
        self._sent = Sent()
        self._vehicles: dict[int, VehicleAxes] = {}

    def vehicle(self, vehicle: int) -> VehicleAxes | None:
        """Return the axes of a vehicle; None if it reported nothing about its flight."""
        return self._vehicles.get(vehicle)

    def parameters(self, vehicle: int) -> Parameters:
        """Return the parameters that a vehicle reported."""
        return self._sent.of(vehicle)

    def told(self, vehicle: int) -> Told:
        """Return the profile and the parameters of a vehicle."""
        axes = self._vehicles.get(vehicle)
        return axes.told if axes else Told(self._airframe)

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
        by_vehicle: dict[int, list[Signal]] = {vehicle: [] for vehicle in self._vehicles}
        for signal in self._signals.read(tables):
            if not admits(signal.vehicle):
                continue
            by_vehicle.setdefault(signal.vehicle, []).append(signal)
        for vehicle in by_vehicle:
            self._known(vehicle, start_us)
        self._hear(tables, start_us, admits)
        for vehicle, signals in by_vehicle.items():
            yield from self._vehicles[vehicle].feed(signals, final=final)

    def _known(self, vehicle: int, start_us: int) -> VehicleAxes:
        if vehicle not in self._vehicles:
            self._vehicles[vehicle] = VehicleAxes(vehicle, start_us, self._airframe, angles=self._angles)
        return self._vehicles[vehicle]

    def announce(self, vehicle: int, time_us: int, start_us: int, airframe: Airframe) -> None:
        """Apply the profile that a vehicle named."""
        if self._airframe is None:
            self._known(vehicle, start_us).told.name((time_us - start_us) // 1_000_000, airframe)

    def _hear(self, tables: Mapping[str, Table], start_us: int, admits: Callable[[int], bool]) -> None:
        """Take the outputs' functions from the parameters, second by second, in the order of sending."""
        heartbeats = tables.get("HEARTBEAT")
        if heartbeats is not None:
            self._sent.take({"HEARTBEAT": heartbeats})
        for message, field in _NAMES.items():
            if message in tables:
                self._hear_parameters(tables[message], field, start_us, admits)

    def _hear_parameters(self, sent: Table, field: str, start_us: int, admits: Callable[[int], bool]) -> None:
        named = np.array([name.startswith(_FUNCTIONS) for name in sent.texts(field)], dtype=bool)
        sent = sent.select(named)
        seconds = (sent.time_us - start_us) // 1_000_000
        for vehicle in np.unique(sent.system).tolist():
            if vehicle not in self._vehicles and not admits(vehicle):
                continue
            told = self._known(vehicle, start_us).told
            for second in np.unique(seconds[sent.system == vehicle]).tolist():
                rows = (sent.system == vehicle) & (seconds == second)
                self._sent.take({sent.name: sent.select(rows)})
                told.hear(second, self._sent.of(vehicle))


def _judged_otherwise(before: Surfaces | None, after: Surfaces) -> list[str]:
    """Return the axes whose judgement rested on other outputs than a profile's: yaw also rests on roll's."""
    if before is None or "profile" not in (before.origin, after.origin):
        return []
    other = [axis for axis in AXES if before.demand(axis) != after.demand(axis)]
    return [*other, "yaw"] if "roll" in other and "yaw" not in other else other


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
