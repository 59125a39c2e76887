"""The events of a flight in words, once for every place that shows them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mavhums.results.assessment import Assessment
from mavhums.results.events import IMPORTANCE, EventKind, FlightEvent
from mavhums.show.words import capital, clock

_WORDS: Final[Mapping[EventKind, str]] = {
    "crash": 'crash: the vehicle reports "{said}"',
    "altitude_loss": "the aircraft sinks {value:.0f} m while the autopilot holds its altitude demand: "
    "probably a loss of thrust or control",
    "failsafe": 'failsafe: the vehicle reports "{said}"',
    "reboot": "the autopilot's clock jumps in flight: a reboot, or its time was set",
    "supply": "the servo rail falls below {value:.1f} V",
    "telemetry_ends": "telemetry of {subject} ends {value:.0f} s before the end of the flight",
    "contact": "angular acceleration beyond what motors can produce, then a descent: probably a contact",
    "begins_in_air": "the log begins in flight",
    "ends_in_air": "the log ends in flight",
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
