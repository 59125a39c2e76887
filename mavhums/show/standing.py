"""What is said of how an actuator stands over its flights, once for the terminal, the page and the digest."""

from __future__ import annotations

from math import ceil, floor

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.results.standing import FlightsLeft, Growth, Standing, Step
from mavhums.show.words import join

__all__ = [
    "growth_words",
    "left_words",
    "mark_of",
    "sentences",
    "since_words",
    "soonest_words",
    "step_words",
    "value_words",
]


def sentences(standing: Standing) -> list[str]:
    """Return what is wrong, since when, what grows, and what changed in one step; empty where all is well.

    Examples
    --------
    >>> sentences(Standing(vehicle=1, actuator="rudder", airframe=None, condition="normal", last="normal",
    ...     flights=3, last_utc="2026-03-01T09:00:00+00:00", log=None))
    []
    """
    said = []
    if SEVERITY[standing.condition] > 0:
        text = f"{standing.condition} {since_words(standing)}".rstrip()
        if value := value_words(standing):
            text = f"{text}: {value}"
        if count := standing.clear_flights:
            text += f"; not seen in the last {f'{count} flights' if count > 1 else 'flight'}"
        said.append(text)
    if standing.growth is not None:
        said.append(growth_words(standing.growth))
    if standing.step is not None:
        said.append(step_words(standing.step))
    return said


def mark_of(standing: Standing) -> tuple[Condition, str]:
    """Return the condition whose colour a list shows, and its word: what grows is not called normal."""
    if standing.growth is not None and SEVERITY[standing.condition] <= 0:
        return "changed", "grows"
    return standing.condition, standing.condition


def value_words(standing: Standing) -> str:
    """Return the finding's own quantity with its value and limit."""
    unit = _unit(standing.unit)
    if standing.value is not None:
        limit = "" if standing.limit is None else f" (limit {standing.limit:.3g}{unit})"
        return f"{standing.quantity} {standing.value.estimate:.3g}{unit}{limit}"
    if standing.quantity is not None:
        return standing.quantity.partition(": ")[2] or standing.quantity
    return (standing.fault or standing.reason or "").replace("_", " ")


def since_words(standing: Standing) -> str:
    """Return since which flight the fault is there; empty where there is none."""
    if standing.since_flight is None or standing.since_utc is None:
        return ""
    return f"since flight {standing.since_flight} of {standing.flights} ({standing.since_utc[:10]})"


def growth_words(growth: Growth) -> str:
    """Return what grows, how fast, since when, and the flights left to each limit that is not reached."""
    slope, unit = growth.per_flight, _unit(growth.unit)
    way = "grows" if slope.estimate > 0 else "falls"
    said = (
        f"{growth.quantity} {way} by {abs(slope.estimate):.2g}{unit} a flight"
        f" since flight {growth.since_flight} ({growth.since_utc[:10]})"
    )
    limits = [(left_words(left), word) for left, word in _limits(growth)]
    return "; ".join([said, *(f"{left} until {word}" for left, word in limits)])


def soonest_words(growth: Growth) -> str:
    """Return the flights left to each limit that is ahead."""
    return join(
        [f"{left_words(left)} until {word}" for left, word in _limits(growth)] or ["no limit is ahead"]
    )


def left_words(left: FlightsLeft, *, dates: bool = True) -> str:
    """Return flights left with their interval and date.

    Examples
    --------
    >>> left_words(FlightsLeft(estimate=30.4, low=24.1, high=40.2, expected_utc="2026-12-01"))
    '30 flights (24–41), about 2026-12-01,'
    >>> left_words(FlightsLeft(estimate=300, low=200, high=None, is_far=True))
    'more than 200 flights'
    """
    low = floor(left.low)
    if left.is_far or left.high is None:
        return f"more than {low:,} flights"
    count = round(left.estimate)
    text = f"{count:,} flight{'s' if count != 1 else ''} ({low:,}–{ceil(left.high):,})"
    return f"{text}, about {left.expected_utc}," if dates and left.expected_utc else text


def step_words(step: Step) -> str:
    """Return a change between two flights, and what it may be."""
    way = "rose" if step.size > 0 else "fell"
    why = (
        "a repair or swap? record it, and later flights are compared with those since"
        if step.better
        else "damage, or another part? inspect it; if it was swapped, record it"
    )
    return (
        f"{step.quantity} {way} by {abs(step.size):.2g}{_unit(step.unit)} in one step"
        f" at flight {step.flight} ({step.at_utc[:10]}): {why}"
    )


def _limits(growth: Growth) -> list[tuple[FlightsLeft, str]]:
    both = ((growth.to_degraded, "degraded"), (growth.to_emergency, "emergency"))
    return [(left, word) for left, word in both if left is not None and left.estimate > 0]


def _unit(unit: str | None) -> str:
    return "" if unit in (None, "1") else f" {unit}"
