"""Technical conditions of an actuator: fault, severity and onset."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf, isfinite, radians

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim.motion import Degradation


@dataclass(frozen=True, slots=True)
class Fault:
    """A type of fault.

    Attributes
    ----------
    unit
        Unit of the severity.
    meaning
        Meaning of the severity.
    gravest
        Severity beyond which nothing gets worse, or the model ends.
    limit
        Largest severity that the model can represent.
    """

    unit: str
    meaning: str
    gravest: float
    limit: float = inf


FAULTS = {
    "friction": Fault("N·m", "Coulomb friction T_c beyond the healthy actuator's", 6.0),
    "backlash": Fault("°", "play of the gear beyond the healthy actuator's, at the output shaft", 3.0),
    "resistance": Fault("1", "winding resistance gained, as a share of R", 8.0),
    "torque_constant": Fault("1", "torque constant lost, as a share of k_t", 1.0, 1.0),
    "slow": Fault("1", "speed lost by the controller, as a share of its gain and rate limit", 0.5, 1.0),
    "supply_sag": Fault("V", "supply voltage lost", 26.0, 26.0),
    "sensor_bias": Fault("°", "error of the output shaft's position sensor", 10.0),
    "jam": Fault("N·m", "torque that holds the output shaft; beyond the stall torque it stops", 10.0),
}


@dataclass(frozen=True, slots=True)
class Condition:
    """One fault over a flight: from ``at_s`` to ``until_s``, linearly from ``start`` to ``end``.

    Attributes
    ----------
    fault
        One of :data:`FAULTS`.
    start, end
        Severity from ``at_s`` on and at the end of the flight, in the fault's unit.
    at_s, until_s
        Flight times of the onset and of the end, s; by default from the first sample to beyond the last.

    Raises
    ------
    ValueError
        If the fault is unknown or a severity is impossible.

    Examples
    --------
    >>> Condition.growing("friction", 0.5, at_s=2.0).severity(np.array([1.0, 2.0, 3.0, 4.0])).tolist()
    [0.0, 0.0, 0.25, 0.5]
    """

    fault: str
    start: float
    end: float
    at_s: float = 0.0
    until_s: float = inf

    def __post_init__(self) -> None:
        if self.fault not in FAULTS:
            raise ValueError(f"no fault {self.fault!r}; there are {', '.join(FAULTS)}")
        limit = FAULTS[self.fault].limit
        low = -inf if self.fault == "sensor_bias" else 0.0
        for severity in (self.start, self.end):
            if not (isfinite(severity) and low <= severity <= limit):
                raise ValueError(f"{self.fault} of {severity} {FAULTS[self.fault].unit} is impossible")
        if not (isfinite(self.at_s) and self.at_s >= 0):
            raise ValueError(f"onset at {self.at_s} s is not a flight time")
        if not self.until_s > self.at_s:
            raise ValueError(f"an end at {self.until_s} s is not after the onset at {self.at_s} s")

    @classmethod
    def constant(cls, fault: str, severity: float) -> Condition:
        """Create a fault that is present during the whole flight."""
        return cls(fault, severity, severity)

    @classmethod
    def step(cls, fault: str, severity: float, at_s: float) -> Condition:
        """Create a fault that starts as a step."""
        return cls(fault, severity, severity, at_s)

    @classmethod
    def growing(cls, fault: str, severity: float, at_s: float = 0.0) -> Condition:
        """Create a fault that grows linearly from zero at ``at_s`` to ``severity`` at the flight's end."""
        return cls(fault, 0.0, severity, at_s)

    @property
    def onset(self) -> str:
        """``constant``, ``step`` or ``growing``."""
        if self.start != self.end:
            return "growing"
        return "step" if self.at_s or isfinite(self.until_s) else "constant"

    def severity(self, time_s: Array) -> Array:
        """Return the severity at each time; the last time is the flight's end. Shape (n,)."""
        lasting = max(min(float(time_s[-1]), self.until_s) - self.at_s, 1e-9)
        grown = self.start + (self.end - self.start) * (time_s - self.at_s) / lasting
        return np.where((time_s < self.at_s) | (time_s >= self.until_s), 0.0, grown)

    def truth(self) -> dict[str, object]:
        """Return the condition as plain data."""
        return {
            "fault": self.fault,
            "unit": FAULTS[self.fault].unit,
            "onset": self.onset,
            "at_s": self.at_s,
            "start": self.start,
            "end": self.end,
            **({"until_s": self.until_s} if isfinite(self.until_s) else {}),
        }


@dataclass(slots=True)
class _Severities:
    """Sum of the severities of each fault over time."""

    time_s: Array
    of: dict[str, Array] = field(default_factory=dict)

    def add(self, condition: Condition) -> None:
        self.of[condition.fault] = self.get(condition.fault) + condition.severity(self.time_s)

    def get(self, fault: str) -> Array:
        return self.of.get(fault, np.zeros(self.time_s.size))


def degrade(
    conditions: Iterable[Condition], time_s: Array, torque_factor: float = 1.0
) -> tuple[Array, Degradation]:
    """Return the additional friction, N·m, and all other degradations.

    Parameters
    ----------
    conditions
        Conditions of one actuator; severities of the same fault add up.
    time_s
        Control periods of the flight, shape (n,).
    torque_factor
        Torque constant of this individual relative to the data sheet's.
    """
    total = _Severities(time_s)
    for condition in conditions:
        total.add(condition)
    return total.get("friction"), Degradation(
        torque_factor=torque_factor * (1.0 - np.minimum(total.get("torque_constant"), 1.0)),
        resistance_factor=1.0 + total.get("resistance"),
        speed_factor=1.0 - np.minimum(total.get("slow"), 1.0),
        sag=total.get("supply_sag"),
        sensor_bias=radians(1.0) * total.get("sensor_bias"),
        backlash=radians(1.0) * total.get("backlash"),
        jam=total.get("jam"),
    )
