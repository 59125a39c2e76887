"""Control surfaces: the conversion of demands to surface angles, and surface faults."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, isfinite, nan, radians
from typing import Any

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim._compiled import kernel

FREEZE, FLOAT, GAIN, SLOW, RATE, BIAS, BACKLASH = range(1, 8)
KINDS = {
    "freeze": FREEZE,
    "float": FLOAT,
    "gain": GAIN,
    "slow": SLOW,
    "slow_rate": RATE,
    "bias": BIAS,
    "backlash": BACKLASH,
}
FAULT = np.dtype([("kind", "i8"), ("value", "f8"), ("at", "f8"), ("until", "f8")])
SERVO = np.dtype(
    [(name, "f8") for name in ("lag", "rate", "play", "trim", "streams_with_alpha", "streams_with_beta")]
)
_STREAM = 0.375  # c_α/c_δ of the hinge moment: deflection of a free surface per angle of attack
_FLOAT_LAG_S = 0.05
_RUNAWAY_RAD_S = 1.0


@dataclass(frozen=True, slots=True)
class Layout:
    """The control surfaces and their effects.

    Attributes
    ----------
    surfaces
        Names, in the order of the servo outputs.
    mixing
        Share of aileron, elevator and rudder demand in each servo, shape (n, 3).
    functions, px4_types
        ArduPlane's SERVOn_FUNCTION and PX4's CA_SV_CSn_TYPE.
    streams
        Angle of a free surface per angle of attack and of sideslip, shape (n, 2).
    """

    surfaces: tuple[str, ...]
    mixing: tuple[tuple[float, float, float], ...]
    functions: tuple[int, ...]
    px4_types: tuple[int, ...]
    streams: tuple[tuple[float, float], ...]

    def effect(self) -> Array:
        """Return each surface's contribution to the airframe's aileron, elevator and rudder, shape (3, n)."""
        return np.linalg.pinv(np.array(self.mixing))


LAYOUTS = {
    "conventional": Layout(
        ("aileron_left", "aileron_right", "elevator", "rudder"),
        ((1, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        (4, 4, 19, 21),
        (1, 2, 3, 4),
        ((-_STREAM, 0.0), (_STREAM, 0.0), (_STREAM, 0.0), (0.0, -_STREAM)),
    ),
    "elevon": Layout(
        ("elevon_left", "elevon_right", "rudder"),
        ((-0.5, 0.5, 0), (0.5, 0.5, 0), (0, 0, 1)),
        (77, 78, 21),
        (5, 6, 4),
        ((_STREAM, 0.0), (_STREAM, 0.0), (0.0, -_STREAM)),
    ),
    "vtail": Layout(
        ("aileron_left", "aileron_right", "vtail_left", "vtail_right"),
        ((1, 0, 0), (1, 0, 0), (0, 0.5, 0.5), (0, 0.5, -0.5)),
        (4, 4, 79, 80),
        (1, 2, 7, 8),
        ((-_STREAM, 0.0), (_STREAM, 0.0), (_STREAM, -_STREAM), (_STREAM, _STREAM)),
    ),
}


@dataclass(frozen=True, slots=True)
class Servo:
    """A servo of reduced order: first-order lag s, largest rate rad/s, play and offset rad.

    Examples
    --------
    >>> Servo.draw(1, 0) == Servo.draw(1, 0)
    True
    """

    lag: float = 0.06
    rate: float = 5.0
    play: float = 0.0
    trim: float = 0.0

    @classmethod
    def draw(cls, seed: int, index: int) -> Servo:
        """Return servo ``index`` of airframe ``seed``."""
        rng = np.random.default_rng([seed, 25, index])
        return cls(
            lag=rng.uniform(0.03, 0.10),
            rate=radians(rng.uniform(150.0, 400.0)),
            play=radians(rng.uniform(0.0, 0.6)),
            trim=radians(float(np.clip(rng.standard_normal(), -2.0, 2.0))),
        )


@dataclass(frozen=True, slots=True)
class SurfaceFault:
    """A fault of one surface, from ``at_s`` to ``until_s``.

    Attributes
    ----------
    surface
        Name in the layout.
    kind
        ``freeze`` (value: angle in ° that it runs to; NaN stays in place), ``float`` (free linkage; no
        value), ``gain`` (remaining share of its effect), ``slow`` (additional time constant, s),
        ``slow_rate`` (°/s), ``bias`` (°), ``backlash`` (°).

    Raises
    ------
    ValueError
        If the kind is unknown or the value impossible.
    """

    surface: str
    kind: str
    value: float = nan
    at_s: float = 0.0
    until_s: float = inf

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"no surface fault {self.kind!r}; there are {', '.join(KINDS)}")
        if self.kind not in {"freeze", "float"} and not isfinite(self.value):
            raise ValueError(f"surface fault {self.kind} needs a value")
        if self.kind in {"gain", "slow", "slow_rate", "backlash"} and self.value < 0.0:
            raise ValueError(f"surface fault {self.kind} of {self.value:g} is impossible")
        if not 0.0 <= self.at_s < self.until_s:
            raise ValueError(f"surface fault {self.kind} must begin before it ends")

    def row(self) -> tuple[int, float, float, float]:
        """Return the fault for compiled code, angles in rad."""
        angular = self.kind in {"freeze", "slow_rate", "bias", "backlash"}
        return KINDS[self.kind], radians(self.value) if angular else self.value, self.at_s, self.until_s


@kernel
def play(position: float, target: float, half: float) -> float:
    """Return the position of a linkage with play when its servo is at ``target``."""
    return min(max(position, target - half), target + half)


@kernel
def follow(servo: Any, shaft: float, command: float, dt: float) -> float:
    """Return the servo's angle after ``dt``: lag, then rate limit."""
    step: float = (command - shaft) * (1.0 - exp(-dt / servo.lag))
    most: float = servo.rate * dt
    return shaft + min(max(step, -most), most)


@kernel
def _towards(angle: float, target: float, most: float) -> float:
    return angle + min(max(target - angle, -most), most)


@kernel
def fail(fault: Any, angle: float, healthy: float, stream: float, dt: float) -> float:
    """Return the surface's angle after ``dt`` with an active fault.

    Parameters
    ----------
    angle, healthy
        Current angle of the surface, and its angle without the fault, rad.
    stream
        Angle of the freely floating surface, rad.
    """
    value: float = fault.value
    if fault.kind == FREEZE:
        return angle if np.isnan(value) else _towards(angle, value, _RUNAWAY_RAD_S * dt)
    if fault.kind == FLOAT:
        return angle + (stream - angle) * (1.0 - exp(-dt / _FLOAT_LAG_S))
    if fault.kind == GAIN:
        return healthy * value
    if fault.kind == SLOW:
        return angle + (healthy - angle) * (1.0 - exp(-dt / value)) if value > 0.0 else healthy
    if fault.kind == RATE:
        return _towards(angle, healthy, value * dt)
    if fault.kind == BIAS:
        return healthy + value
    return play(angle, healthy, 0.5 * value)
