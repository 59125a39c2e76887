"""The events of a flight in words, once for every place that shows them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mavhums.results.assessment import Assessment
from mavhums.results.events import IMPORTANCE, EventKind, FlightEvent
from mavhums.show.words import capital, clock

_WORDS: Final[Mapping[EventKind, str]] = {
    "crash": 'crash: the vehicle says "{said}"',
    "sinks": "it sinks {value:.0f} m below the altitude that it held and still demands: "
    "it lacks thrust or control, as inferred",
    "failsafe": 'failsafe: the vehicle says "{said}"',
    "reboot": "its clock jumps in the air: it rebooted, or its time was set",
    "supply": "the servo rail falls below {value:.1f} V",
    "telemetry_ends": "the telemetry of {subject} ends {value:.0f} s before the flight does",
    "contact": "it turns as no motor turns it and then comes down: it touched something, as inferred",
    "begins_in_air": "the records begin in the air",
    "ends_in_air": "the records end in the air",
    "take_off": "take-off",
    "landing": "landing",
    "armed": "armed",
    "disarmed": "disarmed",
    "mode": "flight mode {said}",
}
_ORDINARY: Final = IMPORTANCE.index("take_off")  # from here on: every flight has them
_LINES: Final = 3


def event_words(event: FlightEvent) -> str:
    """Return what happened, in words.

    Examples
    --------
    >>> event_words(FlightEvent(kind="mode", vehicle=1, time_s=3.0, said="AUTO"))
    'flight mode AUTO'
    """
    return _WORDS[event.kind].format(
        said=(event.said or "").strip(), subject=event.subject, value=event.value
    )


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
    whose = f"vehicle {event.vehicle}, " if len(assessment.log.vehicles) > 1 else ""
    return f"{capital(whose)}{clock(event.time_s)}: {event_words(event)}"
