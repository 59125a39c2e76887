"""The quantities of an axis that are compared between flights: control gain, lag, trim and manoeuvre."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from mavhums.core.conditions import SEVERITY
from mavhums.health.axis.monitor import AxisFindings
from mavhums.health.axis.past import LEAST_FLIGHTS
from mavhums.health.axis.reference import REFERENCE_S, Reference
from mavhums.report.assessment import Indicator, Interval
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["indicators"]

_NORMAL_95: Final = 1.96
_GAIN: Final = {"roll": (1, "rad/m"), "pitch": (2, "rad/m²"), "yaw": (2, "1/m")}
_CONSTANTS: Final = {"hard_over": ("trim", "1"), "manoeuvre": ("load factor by full demand", "s²/m²")}
_WINDOW_S: Final = 10.0
_WINDOW_ERROR: Final = 0.10  # relative deviation of the gain of ten seconds
_LAG_ERROR_S: Final = 0.03  # candidates are 0.05 s apart


def indicators(findings: AxisFindings) -> Iterator[Indicator]:
    """Yield the quantities that the reference determined; the gain is that of the present condition."""
    reference = findings.reference
    if reference is None:
        return
    power, unit = _GAIN[findings.axis]
    share, error = _share(findings, reference)
    scale = abs(reference.gain) / reference.speed**power
    yield _indicator("effectiveness", "control gain", unit, scale * share, scale * error)
    lag_s = reference.shape.delay_rows / RATE_HZ + reference.shape.tau_s
    yield _indicator("slow", "lag", "s", lag_s, _LAG_ERROR_S)
    for fault, (value, known) in reference.constants.items():
        yield _indicator(fault, *_CONSTANTS[fault], value, known)


def _share(findings: AxisFindings, reference: Reference) -> tuple[float, float]:
    """Return the gain of the flight as a share of the reference's, and its standard error.

    Of a fault it is that of the present condition, else the mean of the reference and the windows after it.
    """
    k = findings.effectiveness
    if k is None:
        return 1.0, reference.error
    if SEVERITY[findings.condition] > SEVERITY["normal"]:
        return k.estimate, (k.high - k.low) / 2 / _NORMAL_95
    own, after = REFERENCE_S / _WINDOW_S, float(findings.windows)
    share = (own + after * k.estimate) / (own + after)
    error = ((own * reference.error) ** 2 + after * _WINDOW_ERROR**2) ** 0.5 / (own + after)
    return share, error


def _indicator(fault: str, quantity: str, unit: str, value: float, error: float) -> Indicator:
    half = _NORMAL_95 * error
    numbers = {"estimate": value, "low": value - half, "high": value + half}
    return Indicator(
        fault=fault,
        quantity=quantity,
        unit=unit,
        value=Interval(**{name: float(f"{number:.5g}") for name, number in numbers.items()}),
        windows=REFERENCE_S,
        scatter=float(f"{error * REFERENCE_S**0.5:.4g}"),
        needed_flights=LEAST_FLIGHTS,
    )
