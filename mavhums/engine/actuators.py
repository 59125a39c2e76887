"""The actuators that send telemetry: their monitors, their verdicts, and what the networks say of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from mavhums.actuator.mapping import MappedSamples, Mapper
from mavhums.actuator.profile import Actuator, Airframe
from mavhums.actuator.telemetry import Tier, tier_named
from mavhums.core.arrays import Array
from mavhums.engine.events import Event
from mavhums.engine.options import EngineOptions
from mavhums.engine.vehicle_setup import SetupHistory
from mavhums.health.decision.events import Classified, ConditionChanged
from mavhums.health.verdict.actuator import (
    TelemetrySources,
    unjudged_actuator,
    verdict_of_actuator,
    with_refused,
)
from mavhums.health.verdict.obstacles import unjudged
from mavhums.log import Table
from mavhums.results.verdict import Verdict
from mavhums.vehicle.airspeed import Airspeeds

if TYPE_CHECKING:
    from mavhums.health.actuator.monitor import Monitor
    from mavhums.learn import Model


class Actuators:
    """Follows the actuators of all vehicles.

    Parameters
    ----------
    options
        Models and the like.
    setups
        Returns the profiles and the parameters of a vehicle.

    Attributes
    ----------
    profiles
        Name of the profile by which each actuator is judged, by vehicle and actuator.
    """

    def __init__(self, options: EngineOptions, setups: Callable[[int], SetupHistory]) -> None:
        self._options, self._setups = options, setups
        self._airspeeds = Airspeeds()
        self._monitors: dict[tuple[int, str], Monitor] = {}
        self.profiles: dict[tuple[int, str], str] = {}

    def hear(self, tables: Mapping[str, Table]) -> None:
        """Take what bears on the actuators beside their own telemetry: the airspeed."""
        self._airspeeds.feed(tables)

    def feed(self, airframe: Airframe, mapped: MappedSamples, time_s: Array) -> Iterator[Event]:
        """Take samples of one actuator, and their flight times; yield the events that they cause."""
        vehicle, actuator = mapped.vehicle, mapped.actuator
        airspeed = self._airspeeds.at(vehicle, mapped.utc_us)
        refused = self._setups(vehicle).refused(actuator.name, time_s)
        edges = (np.flatnonzero(np.diff(refused)) + 1).tolist()
        for a, b in pairwise([0, *edges, time_s.size]):
            if refused[a]:
                yield from self._forget(vehicle, actuator.name, float(time_s[a]))
                continue
            bus_v = None if mapped.bus_v is None else mapped.bus_v[a:b]
            magnitudes = None if mapped.magnitudes is None else mapped.magnitudes[a:b]
            monitor = self._monitor(airframe, vehicle, actuator)
            yield from classified(mapped, time_s, slice(a, b), self._serving(airframe))
            yield from monitor.feed(
                time_s[a:b], mapped.values[a:b], mapped.measured[a:b], bus_v, airspeed[a:b], magnitudes
            )

    def finish(self, end_s: Callable[[int], float]) -> Iterator[Event]:
        """End the input; ``end_s`` returns the flight time at which the log of a vehicle ends."""
        for (vehicle, actuator), monitor in list(self._monitors.items()):
            if self._setups(vehicle).last.against(actuator):
                yield from self._forget(vehicle, actuator, end_s(vehicle))
            else:
                yield from monitor.finish()

    def drop(self, vehicle: int) -> None:
        """Drop the monitors of a vehicle: it names another profile."""
        self._monitors = {key: monitor for key, monitor in self._monitors.items() if key[0] != vehicle}

    def verdicts(
        self,
        vehicle: int,
        mapper: Mapper,
        tier: Tier | None,
        start_utc: datetime,
        end_s: float,
        *,
        indicators: bool,
    ) -> Iterator[Verdict]:
        """Yield the verdicts on a vehicle's actuators.

        Parameters
        ----------
        vehicle, mapper
            The vehicle, and what maps its telemetry.
        tier
            The richest telemetry of the vehicle.
        start_utc, end_s
            When the log begins, and the flight time at which it ends.
        indicators
            Whether to evaluate the whole flight again.
        """
        setup = self._setups(vehicle).last
        for actuator in mapper.airframe.actuators:
            monitor = self._monitors.get((vehicle, actuator.name))
            track = mapper.of(vehicle, actuator)
            own, provenance = track.tier and tier_named(track.tier), track.provenance
            if why := setup.against(actuator.name) or track.obstacle:
                yield unjudged(vehicle, actuator.name, why, tier=own or tier, provenance=provenance)
                continue
            if monitor is None or not own or not own.judged:
                yield unjudged_actuator(vehicle, actuator, own or tier, provenance)
                continue
            # What judges an actuator is loaded with the first telemetry: most logs have none.
            from mavhums.health.self_baseline.past import comparable
            from mavhums.health.self_baseline.verdict import compare_with_own_flights

            findings = monitor.findings(indicators=indicators)
            if actuator.blanks and monitor.worst == "undecided" and not comparable(findings.own):
                yield unjudged_actuator(vehicle, actuator, own, provenance, findings.own_gap)
            else:
                of = vehicle, actuator, own, provenance, track.aligner.late, track.implausible
                verdict = verdict_of_actuator(
                    TelemetrySources(*of), findings, start_utc=start_utc, end_s=end_s
                )
                verdict = compare_with_own_flights(verdict, (), self._options.false_alarms)
                yield with_refused(verdict)

    def _monitor(self, airframe: Airframe, vehicle: int, actuator: Actuator) -> Monitor:
        """Return the monitor of an actuator that sends."""
        key = vehicle, actuator.name
        if key not in self._monitors:
            from mavhums.health.actuator.monitor import Monitor  # most logs have no telemetry of servos

            self.profiles[key] = airframe.name
            self._monitors[key] = Monitor(
                vehicle,
                actuator,
                self._serving(airframe),
                decide=self._options.decide,
                false_alarms=self._options.false_alarms,
            )
        return self._monitors[key]

    def _serving(self, airframe: Airframe) -> list[Model]:
        """Return the models that are for an airframe."""
        return [model for model in self._options.models if model.card.airframe == airframe.name]

    def _forget(self, vehicle: int, actuator: str, time_s: float) -> Iterator[Event]:
        """Forget what was judged of an actuator whose output moves something else, as the log now records."""
        monitor, setups = self._monitors.pop((vehicle, actuator), None), self._setups(vehicle)
        reason = setups.at(time_s).against(actuator) or setups.last.against(actuator)
        if monitor is None or reason is None:
            return
        why = f"undecided: {reason.text}"
        if monitor.condition != "undecided":
            yield ConditionChanged(vehicle, actuator, time_s, time_s, monitor.condition, "undecided", why)


def classified(
    mapped: MappedSamples, time_s: Array, rows: slice, serving: Sequence[Model]
) -> Iterator[Classified]:
    """Yield what the networks say of each of these samples, if any serves the actuator.

    Parameters
    ----------
    mapped
        Samples of an actuator.
    time_s
        Their flight times, shape (n,).
    rows
        Which of them are asked about.
    serving
        Networks for the airframe; the one with the most inputs comes first.
    """
    if serving:
        from mavhums.health.actuator.votes import answer_samples

        answers = answer_samples(serving, mapped.values[rows], mapped.measured[rows])
        yield Classified(mapped.vehicle, mapped.actuator.name, time_s[rows], *answers)
