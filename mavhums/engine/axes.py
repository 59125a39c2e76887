"""The vehicles of a log that are judged, and the axes of each: takes tables, yields changes of condition."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np

from mavhums.actuator.draft import Draft
from mavhums.actuator.profile import Airframe
from mavhums.engine.drafts import Drafts, telemetry_of_servos
from mavhums.engine.options import EngineOptions
from mavhums.engine.vehicle_axes import AxisEvent, VehicleAxes
from mavhums.engine.vehicle_setup import SetupHistory
from mavhums.log import Table
from mavhums.log.base.decoder import Losses, text_of
from mavhums.vehicle.arrivals import Received
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.events import FlightEvents
from mavhums.vehicle.facts import Signal
from mavhums.vehicle.formats import esc_speeds, reports
from mavhums.vehicle.formats.base import FactReport
from mavhums.vehicle.parameters import OUTPUT_PARAMETERS, Parameters, ReceivedParameters
from mavhums.vehicle.rotors import ROTOR_PARAMETERS
from mavhums.vehicle.signals import SignalReader
from mavhums.vehicle.vtol import VTOL_PARAMETERS

_FUNCTIONS: Final = (*OUTPUT_PARAMETERS, *VTOL_PARAMETERS, *ROTOR_PARAMETERS)


class Axes:
    """Follows the axes of every vehicle.

    Parameters
    ----------
    airframe
        The profile for every vehicle; None if each vehicle reports its own outputs.
    events
        Where the events of each vehicle go; None for nowhere else.
    options
        How to judge; the defaults if None.
    """

    def __init__(
        self,
        airframe: Airframe | None = None,
        events: FlightEvents | None = None,
        options: EngineOptions | None = None,
    ) -> None:
        self._options = options or EngineOptions()
        self._events = events or FlightEvents()
        self._airframe = airframe
        self._signals = SignalReader()
        self._received = ReceivedParameters()
        self._vehicles: dict[int, VehicleAxes] = {}
        self._announced: list[tuple[int, int, Airframe]] = []
        self._drafts, self._drafted = Drafts(), list[Draft]()

    def vehicle(self, vehicle: int) -> VehicleAxes | None:
        """Return the axes of a vehicle; None if it reported nothing about its flight."""
        return self._vehicles.get(vehicle)

    def vehicles(self) -> tuple[int, ...]:
        """Return the vehicles that reported something about their flight."""
        return tuple(self._vehicles)

    def by_rotors(self) -> frozenset[int]:
        """Return the vehicles that rotors alone carry."""
        return frozenset(vehicle for vehicle, axes in self._vehicles.items() if axes.motors.carry_alone)

    def received(self, vehicle: int) -> dict[str, Received]:
        """Return, by message, how many of a vehicle's samples were kept, came late, or came twice."""
        axes = self._vehicles.get(vehicle)
        return axes.grid.received() if axes else {}

    def parameters(self, vehicle: int) -> Parameters:
        """Return the parameters that a vehicle reported."""
        return self._received.of(vehicle)

    def setups(self, vehicle: int) -> SetupHistory:
        """Return the profile and the parameters of a vehicle."""
        axes = self._vehicles.get(vehicle)
        return axes.setups if axes else SetupHistory(self._airframe)

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
                self._vehicles[vehicle] = VehicleAxes(
                    vehicle, start_us, self._airframe, self._events.of(vehicle), self._options
                )
            return self._vehicles[vehicle]

        by_vehicle: dict[int, list[Signal]] = {}
        for signal in self._signals.read(tables):
            if admits(signal.vehicle):
                by_vehicle.setdefault(signal.vehicle, []).append(signal)
        for vehicle in by_vehicle:
            axes_of(vehicle)
        self._hear(tables, by_vehicle, axes_of, admits)
        for vehicle, esc, time_us, speeds in esc_speeds(tables):
            time_s = (time_us - start_us) / 1e6
            if vehicle in self._vehicles:
                self._vehicles[vehicle].motors.speeds.hear(esc, time_s, speeds)
            if admits(vehicle):
                self._events.of(vehicle).hear_source(f"ESC {esc + 1}", time_s)
        for vehicle, axes in self._vehicles.items():
            yield from axes.feed(by_vehicle.get(vehicle, ()), final=final)

    def announce(self, vehicle: int, frame: int, airframe: Airframe) -> None:
        """Apply the profile that a vehicle named at a place in the log; before the tables of that place."""
        if self._airframe is None:
            self._announced.append((vehicle, frame, airframe))
            self._drafts.give_up(vehicle)

    def drafted(self) -> list[Draft]:
        """Return the profiles that were drafted since the last call; none where one was given."""
        drafted, self._drafted = self._drafted, []
        return drafted

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
            axes = axes_of(vehicle)
            [second] = axes.grid.reached_s(np.array([frame]), signals.get(vehicle, ())).tolist()
            axes.setups.add_profile(second, airframe)
        for report in reports(tables, "parameter"):
            named = [text_of(name).startswith(_FUNCTIONS) for name in report.values["name"].tolist()]
            sent = report.select(np.array(named, dtype=bool))
            for vehicle in filter(admits, np.unique(sent.table.system).tolist()):
                own = sent.select(sent.table.system == vehicle)
                self._take_parameters(axes_of(vehicle), own, tables, signals.get(vehicle, ()))
        self._received.add_autopilots(tables)
        if self._airframe is None:
            for vehicle, telemetry in telemetry_of_servos(tables):
                if vehicle in self._vehicles:
                    axes = self._vehicles[vehicle]
                    reached_s = partial(axes.grid.reached_s, signals=signals.get(vehicle, ()))
                    draft = self._drafts.feed(vehicle, telemetry, axes.setups, reached_s)
                    self._drafted += [draft] if draft else []

    def _take_parameters(
        self, axes: VehicleAxes, sent: FactReport, tables: Mapping[str, Table], signals: Sequence[Signal]
    ) -> None:
        [vehicle] = np.unique(sent.table.system).tolist()
        seconds = axes.grid.reached_s(sent.table.frame, signals)
        for second in np.unique(seconds).tolist():
            now = sent.select(seconds == second)
            self._received.add_autopilots(tables, before=int(now.table.frame[-1]))
            self._received.add_parameters(now)
            axes.setups.add_parameters(second, self._received.of(vehicle))


def with_drops(losses: Losses, clocks: Clocks, axes: Axes) -> Losses:
    """Return the losses of a log with the samples that clocks and grids left out."""
    late, same = Counter[str](), Counter[str]()
    for vehicle in axes.vehicles():
        for message, received in axes.received(vehicle).items():
            late[message] += received.late
            same[message] += received.repeated
    found = {
        "late_samples": late,
        "same_time_samples": same,
        "broken_stamps": clocks.broken,
        "copies": clocks.copies,
    }
    return losses.model_copy(
        update={name: {key: n for key, n in sorted(counts.items()) if n} for name, counts in found.items()}
    )


MOST_VEHICLES: Final = 32
"""Vehicles that are judged at most."""


class VehicleLimit:
    """Admits the first vehicles of a log, in the order of the log, whatever the block size.

    Parameters
    ----------
    messages
        Names of the messages that describe actuators; a vehicle that sends none takes no place.
    """

    def __init__(self, messages: Collection[str]) -> None:
        self._messages = frozenset(messages)
        self._admitted: set[int] = set()

    def observe(self, tables: Mapping[str, Table]) -> None:
        """Admit the senders of the next messages, as long as there is room."""
        if len(self._admitted) == MOST_VEHICLES:
            return
        first: dict[int, int] = {}
        for name in self._messages & tables.keys():
            systems, places = np.unique(tables[name].system, return_index=True)
            for system, frame in zip(systems.tolist(), tables[name].frame[places].tolist(), strict=True):
                first[system] = min(frame, first.get(system, frame))
        for system in sorted(first, key=first.__getitem__):
            if len(self._admitted) < MOST_VEHICLES:
                self._admitted.add(system)

    def admits(self, vehicle: int) -> bool:
        """Return whether a vehicle is judged."""
        return len(self._admitted) < MOST_VEHICLES or vehicle in self._admitted
