"""What tests of health are made of: verdicts, indicators, and samples of V1…V12."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mavhums.core.arrays import Array
from mavhums.core.conditions import Condition
from mavhums.core.quantities import column
from mavhums.health.estimation.slots import Slots, with_extra_columns
from mavhums.results.verdict import Indicator, Interval, Verdict
from mavhums.vehicle.surfaces import SurfaceOutput


def verdict(condition: Condition = "undecided", **fields: Any) -> Verdict:
    """Return a verdict on vehicle 1; the worst condition is the same unless it is given."""
    given: dict[str, Any] = {"vehicle": 1, "actuator": "rudder", "condition": condition, "worst": condition}
    return Verdict(**(given | fields))


def indicator(fault: str, value: float, half: float = 0.0, **fields: Any) -> Indicator:
    """Return what nine windows show of a quantity, to within half an interval."""
    known: dict[str, Any] = {"quantity": "", "unit": "", "windows": 9, **fields}
    return Indicator(fault=fault, value=Interval.around(value, half), **known)


def outputs(**servos: int) -> tuple[SurfaceOutput, ...]:
    """Return what moves surfaces, by the names of these."""
    return tuple(SurfaceOutput(servo, name.replace("_", " "), 1500, 400) for name, servo in servos.items())


def samples(count: int, **quantities: ArrayLike) -> Array:
    """Return V1…V12, shape (count, 12), of which the others are not measured."""
    values = np.full((count, 12), np.nan)
    for key, known in quantities.items():
        values[:, column(key)] = known
    return values


def one_slot(time_s: Array, values: Array, judged: slice | None = None) -> Slots:
    """Return samples of one slot, of which all are judged unless it is said."""
    first = np.array([0])
    return Slots(first, first, judged or slice(0, time_s.size), time_s, with_extra_columns(values))
