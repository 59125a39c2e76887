"""The events of a flight in words, once for every place that shows them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mavhums.core.conditions import Condition
from mavhums.results.assessment import Assessment
from mavhums.results.events import IMPORTANCE, EventKind, FlightEvent
from mavhums.show.words import capital, clock

_WORDS: Final[Mapping[EventKind, str]] = {
    "crash": 'crash: the vehicle reports "{said}"',
    "impact": "the aircraft sinks {value:.0f} m in the 4 s before it comes to rest: it hit the ground, or "
    "landed by parachute or stall",
    "altitude_loss": "the aircraft sinks {value:.0f} m while the autopilot holds its altitude demand: "
    "probably a loss of thrust or control",
    "fault": "{subject} reports {said}{times}",
    "failsafe": 'failsafe: the vehicle reports "{said}"',
    "reboot": "the autopilot's clock jumps in flight: a reboot, or its time was set",
    "supply": "the servo rail falls below {value:.1f} V",
    "telemetry_ends": "telemetry of {subject} ends {value:.0f} s before the end of the flight",
    "contact": "angular acceleration beyond what motors can produce, then a descent: probably a contact",
    "errors": "the error count of {subject} grows by {value:.0f}",
    "begins_in_air": "the log begins in flight",
    "ends_in_air": "the log ends in flight",
    "take_off": "take-off",
    "landing": "landing",
    "armed": "armed",
    "disarmed": "disarmed",
    "mode": "flight mode {said}",
}
_GRAVE: Final[Mapping[EventKind, tuple[Condition, str, str]]] = {
    "crash": ("emergency", "crash", "crash reported at {at}"),
    "impact": ("degraded", "impact", "probably hit the ground at {at}"),
    "contact": ("degraded", "contact", "probably hit something at {at}"),
    "altitude_loss": ("degraded", "altitude loss", "sank {value:.0f} m below its demand from {at} on"),
}
"""Kinds that a headline names, whatever could be judged."""

_ORDINARY: Final = IMPORTANCE.index("take_off")  # from here on: every flight has them
_LINES: Final = 3


def event_words(event: FlightEvent) -> str:
    """Return what happened, in words.

    Examples
    --------
    >>> event_words(FlightEvent(kind="mode", vehicle=1, time_s=3.0, said="AUTO"))
    'flight mode AUTO'
    """
    times = f", {event.value:.0f} times" if (event.value or 0) > 1 else ""
    return _WORDS[event.kind].format(
        said=(event.said or "").strip(), subject=event.subject, value=event.value, times=times
    )


def gravest_event(assessment: Assessment) -> tuple[Condition, str, str] | None:
    """Return how grave the event is that a headline must have, its name and its words; None without one."""
    for kind, (condition, called, words) in _GRAVE.items():
        for event in assessment.events:
            if event.kind == kind:
                text = words.format(at=clock(event.time_s), value=event.value)
                return condition, called, f"{_whose(event, assessment)}{text}"
    return None


def event_lines(assessment: Assessment) -> list[str]:
    """Return a line on each event of a flight, in order of time, and one on those that are not kept."""
    lines = [_line(event, assessment) for event in assessment.events]
    if assessment.events_left_out:
        lines.append(f"{assessment.events_left_out} more events are not kept")
    return lines


def foremost(assessment: Assessment) -> list[str]:
    """Return up to three lines on what happened and is not ordinary, the most important first."""
    kinds = [[one for one in assessment.events if one.kind == kind] for kind in IMPORTANCE[:_ORDINARY]]
    lines = [
        _line(alike[0], assessment) + (f" (and {len(alike) - 1} more such events)" if alike[1:] else "")
        for alike in kinds
        if alike
    ]
    return lines[:_LINES]


def _line(event: FlightEvent, assessment: Assessment) -> str:
    return f"{capital(_whose(event, assessment))}{clock(event.time_s)}: {event_words(event)}"


def _whose(event: FlightEvent, assessment: Assessment) -> str:
    return f"vehicle {event.vehicle}, " if len(assessment.log.vehicles) > 1 else ""
