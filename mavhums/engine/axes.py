"""The axes of every vehicle of a log: takes tables, yields changes of condition, returns findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Airframe
from mavhums.actuator.surfaces import of_airframe
from mavhums.health.axis.monitor import AxisMonitor, new_gain
from mavhums.health.events import ConditionChanged, Indication
from mavhums.log import Table
from mavhums.report.axis_limits import AxisLimits
from mavhums.vehicle.events import Followed
from mavhums.vehicle.flight import Flight, Rows
from mavhums.vehicle.grid import RATE_HZ, Grid, Seconds
from mavhums.vehicle.inference import inferred
from mavhums.vehicle.order import Received
from mavhums.vehicle.parameters import Parameters, Sent
from mavhums.vehicle.signal_readers import MESSAGES, SignalReaders
from mavhums.vehicle.signals import Signal
from mavhums.vehicle.surfaces import AXES, Surfaces, of_parameters
from mavhums.vehicle.usage import Usage

__all__ = ["MESSAGES", "Axes", "VehicleAxes"]

AxisEvent = ConditionChanged | Indication | Followed
_TOLD_S: Final = 3
_SHOWN_EVERY: Final = 5  # rows: four angles a second
_INFER_S: Final = 45
_RETRY_S: Final = 10
_LATEST_S: Final = 180
_KEPT_S: Final = 120
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
    usage, grid
        Use of the vehicle's outputs; the grid of its signals.
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
        self.grid = Grid(start_us)
        self._told: list[tuple[int, Surfaces, AxisLimits | None]] = []
        self._waiting: list[Seconds] = []
        self._since_try = 0

    def tell(self, second: int, surfaces: Surfaces, limits: AxisLimits | None = None) -> None:
        """Take what the log reports in a flight second; it applies from three seconds later on.

        Other limits begin the judgement anew.
        """
        self._told.append((second + _TOLD_S, surfaces, limits))

    def feed(self, signals: list[Signal], *, final: bool = False) -> Iterator[AxisEvent]:
        """Take new samples; yield the changes of condition."""
        self.usage.feed(signals)
        seconds = self.grid.feed(signals, final=final)
        while seconds is not None:
            now, seconds = self._next(seconds)
            at = 0
            while self.surfaces is None and at < len(now.index):
                yield from self._unknown(_part(now, at, at + 1))
                at += 1
            if at < len(now.index):
                yield from self._known(_part(now, at, len(now.index)))

    def _next(self, seconds: Seconds) -> tuple[Seconds, Seconds | None]:
        """Apply surfaces due by the first second; return the seconds until the next change, and the rest."""
        first = int(seconds.index[0])
        while self._told and self._told[0][0] <= first:
            self._learn(*self._told.pop(0)[1:])
        count = len(seconds.index)
        at = int(np.searchsorted(seconds.index, self._told[0][0])) if self._told else count
        if at == count:
            return seconds, None
        return _part(seconds, 0, at), _part(seconds, at, count)

    def _learn(self, surfaces: Surfaces, limits: AxisLimits | None) -> None:
        if limits is not None and limits != self.monitor.limits:
            self.monitor = AxisMonitor(self._vehicle, limits)
        told_before = self.surfaces is not None and self.surfaces.origin == "profile"
        if told_before or surfaces == self.surfaces:
            return
        self.surfaces = surfaces
        self.flight.learn(surfaces)
        self._waiting.clear()

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
        probe = Flight(None)
        parts = [rows for seconds in self._waiting for rows in probe.feed(seconds)]
        rows = Rows.join(parts)
        outputs = np.concatenate([seconds.signals["outputs"] for seconds in self._waiting])
        pulses = outputs.reshape(-1, outputs.shape[2])

        def explains(axis: str, demand: Array) -> float:
            outputs = np.full_like(rows.outputs, np.nan)
            outputs[:, AXES.index(axis)] = demand
            gain = new_gain(axis)
            gain.feed(replace(rows, outputs=outputs))
            found = gain.reference or gain.best
            return 0.0 if found is None else found.explained

        return inferred(rows, pulses, explains)


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

    def vehicle(self, vehicle: int) -> VehicleAxes | None:
        """Return the axes of a vehicle; None if it reported nothing about its flight."""
        return self._vehicles.get(vehicle)

    def vehicles(self) -> tuple[int, ...]:
        """Return the vehicles that reported something about their flight."""
        return tuple(self._vehicles)

    def received(self, vehicle: int) -> dict[str, Received]:
        """Return, by message, how many of a vehicle's samples were kept, came late, or came twice."""
        axes = self._vehicles.get(vehicle)
        return axes.grid.received() if axes else {}

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
        by_vehicle: dict[int, list[Signal]] = {vehicle: [] for vehicle in self._vehicles}
        for signal in self._signals.read(tables):
            if not admits(signal.vehicle):
                continue
            by_vehicle.setdefault(signal.vehicle, []).append(signal)
        for vehicle in by_vehicle:
            if vehicle not in self._vehicles:
                self._vehicles[vehicle] = self._new(vehicle, start_us, self._surfaces)
        self._hear(tables, start_us, admits)
        for vehicle, signals in by_vehicle.items():
            yield from self._vehicles[vehicle].feed(signals, final=final)

    def _new(self, vehicle: int, start_us: int, surfaces: Surfaces | None) -> VehicleAxes:
        return VehicleAxes(vehicle, start_us, surfaces, self._limits, angles=self._angles)

    def announce(self, vehicle: int, time_us: int, start_us: int, airframe: Airframe) -> None:
        """Apply the profile that a vehicle named."""
        surfaces = of_airframe(airframe)
        if surfaces is None or self._surfaces is not None:
            return
        if vehicle not in self._vehicles:
            self._vehicles[vehicle] = self._new(vehicle, start_us, None)
        self._vehicles[vehicle].tell((time_us - start_us) // 1_000_000, surfaces, airframe.axes)

    def _hear(self, tables: Mapping[str, Table], start_us: int, admits: Callable[[int], bool]) -> None:
        """Take the outputs' functions from the parameters, second by second, in the order of sending."""
        heartbeats = tables.get("HEARTBEAT")
        if heartbeats is not None:
            self._sent.take({"HEARTBEAT": heartbeats})
        if self._surfaces is None:
            for message, field in _NAMES.items():
                if message in tables:
                    self._hear_parameters(tables[message], field, start_us, admits)

    def _hear_parameters(self, sent: Table, field: str, start_us: int, admits: Callable[[int], bool]) -> None:
        named = np.array([name.startswith(_FUNCTIONS) for name in sent.texts(field)], dtype=bool)
        sent = sent.select(named)
        seconds = (sent.time_us - start_us) // 1_000_000
        for vehicle in np.unique(sent.system).tolist():
            axes = self._vehicles.get(vehicle)
            if axes is None:
                if not admits(vehicle):
                    continue
                axes = self._vehicles[vehicle] = self._new(vehicle, start_us, None)
            for second in np.unique(seconds[sent.system == vehicle]).tolist():
                rows = (sent.system == vehicle) & (seconds == second)
                self._sent.take({sent.name: sent.select(rows)})
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
