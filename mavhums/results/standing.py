"""How an actuator or axis stands over its flights: its state, what grows, and what changed in one step."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.models import Contract

__all__ = ["FlightsLeft", "Growth", "Interval", "Standing", "Step"]


class Interval(Contract):
    """An estimate with its 95 % interval."""

    estimate: float
    low: float
    high: float


class FlightsLeft(Contract):
    """Flights after the last one until a line reaches a limit, with a 95 % interval, and the dates of it.

    ``high`` and ``latest_utc`` are None where the line need not reach it; dates are None where the flights do
    not tell how often the aircraft flies, and beyond a hundred years. ``is_far`` says that the limit is more
    than three times as far ahead as the flights reach back, where a straight line is a guess.
    """

    estimate: float
    low: float
    high: float | None
    expected_utc: str | None = None
    earliest_utc: str | None = None
    latest_utc: str | None = None
    is_far: bool = False


class Growth(Contract):
    """A certain growth of an indicator.

    Attributes
    ----------
    fault, quantity, unit
        What grows.
    since_flight, since_utc
        The flight after which it most likely grows.
    per_flight
        Slope of the line since then.
    to_degraded, to_emergency
        None where there is no such limit; 0 flights where the line has reached it.
    """

    fault: str
    quantity: str
    unit: str
    since_flight: int
    since_utc: str
    per_flight: Interval
    to_degraded: FlightsLeft | None
    to_emergency: FlightsLeft | None


class Step(Contract):
    """A change of an indicator between two flights: a repair, a swap, or damage.

    ``flight`` and ``at_utc`` are the first flight after it, ``size`` is how much the indicator changed;
    ``better`` says whether the fault became less.
    """

    fault: str
    quantity: str
    unit: str
    flight: int
    at_utc: str
    size: float
    better: bool


class Standing(Contract):
    """How an actuator or axis stands after its last flight.

    Attributes
    ----------
    condition
        Over the flights: a limit that was crossed stays crossed until a repair, or until five judged flights
        in a row did not cross it.
    last
        The gravest of the last flight alone.
    since_flight, since_utc
        The first flight of the present fault; None where there is none.
    clear_flights
        Judged flights since the last one that showed the fault.
    fault, quantity, unit, value, limit
        What the finding rests on: its quantity in the last flight that shows it, and the limit.
    growth
        The one with the fewest flights left; None where nothing certainly grows.
    step
        The last one, if it is one of the last 20 flights.
    reason
        Of the last flight, where nothing was decided or found.
    flights, last_utc, log
        Number of its flights, and date and log of the last one.
    """

    subject: Literal["actuator", "axis", "motor"] = "actuator"
    vehicle: int
    actuator: str
    airframe: str | None
    condition: Condition
    last: Condition
    since_flight: int | None = None
    since_utc: str | None = None
    clear_flights: int = Field(default=0, ge=0)
    fault: str | None = None
    quantity: str | None = None
    unit: str | None = None
    value: Interval | None = None
    limit: float | None = None
    growth: Growth | None = None
    step: Step | None = None
    reason: str | None = None
    flights: int = Field(ge=1)
    last_utc: str
    log: str | None

    @property
    def is_finding(self) -> bool:
        """Whether somebody must look at it: a fault, or growth."""
        return SEVERITY[self.condition] > SEVERITY["normal"] or self.growth is not None

    @property
    def rank(self) -> tuple[float, float, int, str]:
        """Sort by urgency, growth before what is well, then by the fewest flights left."""
        growth = self.growth
        left = [one.estimate for one in (growth.to_degraded, growth.to_emergency) if one] if growth else []
        urgency = max(URGENCY[self.condition], URGENCY["changed"] - 0.5 if growth else 0.0)
        return -urgency, min(left, default=float("inf")), self.vehicle, self.actuator
