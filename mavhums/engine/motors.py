"""Connects the motors of a multirotor to their monitor and their verdicts, for one vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from math import inf
from typing import TYPE_CHECKING, Final

from mavhums.engine.options import EngineOptions
from mavhums.health.decision.events import ConditionChanged, Trace
from mavhums.health.motor.speeds import EscSpeeds
from mavhums.health.verdict.obstacles import unjudged
from mavhums.results.reasons import Reason
from mavhums.results.verdict import Verdict
from mavhums.vehicle.arrivals import Received
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.grid import Seconds
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.phases import PhaseRows, Phases
from mavhums.vehicle.rotors import Rotors
from mavhums.vehicle.surfaces import STEERING

if TYPE_CHECKING:
    from mavhums.health.motor.monitor import MotorMonitor

_EARLY_S: Final = 20
"""Seconds kept until the parameters apply: they apply from their place in the log, and a log that
begins in the air, or a link that sends them on request, has them some seconds late."""
_LATE_S: Final = 40  # by which a stream may lag


class VehicleMotors:
    """The motors of one vehicle: none is judged until the parameters show where they are.

    Parameters
    ----------
    vehicle
        System id.
    options
        How to judge.

    Attributes
    ----------
    by_parameters
        The motors by the parameters; why they are not known; None if it is not known to be a multirotor.
    speeds
        The speeds that its ESCs report.
    """

    def __init__(self, vehicle: int, options: EngineOptions) -> None:
        self._vehicle, self._options = vehicle, options
        self.by_parameters: Rotors | Reason | None = None
        self.speeds = EscSpeeds()
        self._monitor: MotorMonitor | None = None
        self._early: list[Seconds] = []
        self._began_s: int | None = None

    @property
    def rotors(self) -> Rotors | Reason | None:
        """The motors that are judged; why they are not known; None if it is not known to be a multirotor."""
        # A motor that loses its output in flight, as an override has it, is still the aircraft's.
        return self._monitor.rotors if self._monitor else self.by_parameters

    @property
    def carry_alone(self) -> bool:
        """Whether they alone carry the vehicle."""
        return isinstance(self.rotors, Rotors) and not self.rotors.lift

    def feed(self, seconds: Seconds, phases: PhaseRows) -> Iterator[ConditionChanged | Trace]:
        """Take settled seconds and the phases in them; yield the changes of condition."""
        rotors = self.by_parameters
        if isinstance(rotors, Rotors) and (self._monitor is None or rotors != self._monitor.rotors):
            from mavhums.health.motor.monitor import MotorMonitor  # most vehicles have wings

            self._monitor = MotorMonitor(
                self._vehicle,
                rotors,
                self.speeds,
                self._options.false_alarms,
                traced=self._options.vehicle_states,
            )
            again = Phases()  # with the thrust, which was not known
            for earlier in self._early:
                yield from self._monitor.feed(earlier, again.feed(earlier, rotors))
            self._early.clear()
        if self._monitor is not None:
            yield from self._monitor.feed(seconds, phases)
            return
        if self._began_s is None:
            self._began_s = int(seconds.index[0])
        first_s = int(seconds.index[-1]) - _EARLY_S - _LATE_S
        self.speeds.forget(2 * first_s, inf)
        kept = int((seconds.index < self._began_s + _EARLY_S).sum())  # however the log is cut into blocks
        if kept:
            self._early.append(seconds.part(0, kept))

    def verdicts(
        self,
        identity: Identity,
        flight: Flight,
        why: Sequence[Reason],
        start_utc: datetime,
        received: Mapping[str, Received],
    ) -> Iterator[Verdict]:
        """Yield the verdicts on a multirotor's or a quadplane's motors, or why the axes are not judged.

        ``why`` are the reasons why its axes are not judged; none if they are.
        """
        lift = isinstance(self.rotors, Rotors) and self.rotors.lift
        only_rotors = identity.multirotor and any(one.code == "no_wings" for one in why)
        if why and not only_rotors:
            name = STEERING if flight.on_ground else "axes"
            yield unjudged(identity.vehicle, name, *why, subject="axis")
        if not lift and not only_rotors:
            return
        from mavhums.health.verdict.motor import verdicts_of_motors

        findings = self._monitor.findings() if self._monitor else None
        yield from verdicts_of_motors(identity.vehicle, findings, self.rotors, flight, start_utc, received)


def beside_motors(actuators: Sequence[Verdict], others: Sequence[Verdict]) -> Sequence[Verdict]:
    """Return the verdicts on actuators without those that only say of a copter that it has no surfaces."""
    if any(verdict.subject == "motor" for verdict in others):
        return [verdict for verdict in actuators if "multirotor" not in verdict.reason_codes]
    return actuators
