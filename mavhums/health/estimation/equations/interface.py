"""The two kinds of equations, each linear in its coefficients.

An :class:`Equation` rests on the constants of a data sheet. An :class:`OwnEquation` needs none:

    y = wear·sgn(w) + b·w + J·dw/dt + h·q·d + o

w is the servo's speed, q the dynamic pressure, d the surface's angle, and o an offset that is free in each
window of 10 s: it absorbs the trim load and slow changes. b, J and h are properties of the individual.
They are learned once from its own flights and then fixed; only ``wear`` is estimated in each flight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import Slots


@dataclass(frozen=True, slots=True)
class Equation:
    """One equation with the constants of a data sheet.

    Attributes
    ----------
    name
        Name by which detectors read its fit.
    terms
        Names of its p terms.
    prior
        Returns the prior of the coefficients.
    rows
        Returns the terms (n, p), the left side (n,) and the mask of usable samples (n,).
    """

    name: str
    terms: tuple[str, ...]
    prior: Callable[[Actuator], Prior]
    rows: Callable[[Actuator, Motion], tuple[Array, Array, Flags]]


class ServoSpeed(NamedTuple):
    """A servo's speed, rad/s of the measured shaft, and the threshold from which it counts as moving."""

    rad_s: Array
    moving_rad_s: float


@dataclass(frozen=True, slots=True)
class OwnEquation:
    """One own-scale equation.

    Attributes
    ----------
    name
        Name under which flights store its sums.
    fault
        Name of the indicator.
    quantity, unit
        Quantity and unit of the wear coefficient.
    inspect
        The parts that a maintainer should inspect.
    cause
        The possible causes of a change, as far as the data show.
    min_rate_hz
        Slower samples are no evidence.
    min_flights
        Number of flights that the baseline needs.
    left
        Returns the left side at all samples, shape (n,), NaN where it is not measured.
    speed
        Returns the speed at all samples; None if the profile rules it out.
    by_activity
        Whether the wear coefficient depends on how fast the commands change: a flight is then compared with
        the baseline at its own acceleration.
    blurs
        Whether a grave fault makes the quantity as uncertain as it makes it large. A flight's error then
        counts at most as threefold that of the baseline.
    """

    name: str
    fault: str
    quantity: str
    unit: str
    inspect: str
    cause: str
    min_rate_hz: float
    min_flights: int
    left: Callable[[Actuator, Slots], Array]
    speed: Callable[[Actuator, Slots], ServoSpeed | None]
    by_activity: bool = False
    blurs: bool = False
