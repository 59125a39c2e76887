"""The events of a flight, and the traces behind a judgement, in words: once for whatever shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import Condition
from mavhums.results.assessment import Assessment
from mavhums.results.sections import IMPORTANCE, EventKind, FlightEvent

if TYPE_CHECKING:
    from mavhums.health.decision.events import Trace
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
    "supply": "the servo rail falls to {value:.1f} V: it feeds every surface",
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


class GraveEvent(NamedTuple):
    """An event that a headline names, whatever could be judged: how grave it is, and what to do about it.

    ``name`` takes the place of the condition's, ``text`` has the time and the value.
    """

    condition: Condition
    name: str
    text: str
    todo: str


_GRAVE: Final[Mapping[EventKind, GraveEvent]] = {
    "crash": GraveEvent(
        "emergency",
        "crash",
        "crash reported at {at}",
        "do not fly; inspect frame, propellers, motors, servos, linkages and battery for damage",
    ),
    "impact": GraveEvent(
        "degraded",
        "impact",
        "probably hit the ground at {at}",
        "inspect fuselage, wings, propeller, servos, linkages and battery for damage before the next flight",
    ),
    "supply": GraveEvent(
        "degraded",
        "supply",
        "the servo rail, which feeds every surface, fell to {value:.1f} V at {at}",
        "inspect the BEC of the servo rail, its wiring and its load before the next flight",
    ),
    "contact": GraveEvent(
        "degraded",
        "contact",
        "probably hit something at {at}",
        "inspect propellers, motors, arms and frame for damage before the next flight",
    ),
    "altitude_loss": GraveEvent(
        "degraded",
        "altitude loss",
        "sank {value:.0f} m below its demand from {at} on",
        "inspect motor or engine, ESC, propeller and battery or fuel, then the linkages of its surfaces, "
        "before the next flight",
    ),
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
    times = f", {event.value:.0f} times" if (event.value or 0) > 1 else ""
    return _WORDS[event.kind].format(
        said=(event.said or "").strip(), subject=event.subject, value=event.value, times=times
    )


def gravest_event(assessment: Assessment) -> GraveEvent | None:
    """Return the event that a headline must have; None without one."""
    for kind, grave in _GRAVE.items():
        for event in assessment.events:
            if event.kind == kind:
                text = grave.text.format(at=clock(event.time_s), value=event.value)
                return grave._replace(text=f"{_whose(event, assessment)}{text}")
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


EVIDENCE: Final = "evidence"
FRAME: Final = "frame"
_TRACES: Final = (EVIDENCE, "response", "thrust", "roll_angle", "pitch_angle")
_ABOVE_ALARM: Final = 2.0  # what is certain grows without end, and would hide how near an alarm was


class TraceWords(NamedTuple):
    """What a trace shows: the quantity with its unit, the value, and what it is compared with."""

    quantity: str
    value: str
    against: str


_OF_TRACE: Final = {
    "thrust": TraceWords("thrust asked of it, share of full", "asked", "mean of all motors"),
    "roll_angle": TraceWords("roll angle, °", "flown", "demanded"),
    "pitch_angle": TraceWords("pitch angle, °", "flown", "demanded"),
}
_RESPONSES: Final = {
    "roll": "roll rate, °/s",
    "pitch": "pitch acceleration, °/s²",
    "yaw": "side force, m/s²",
    "steering": "yaw rate, °/s",
}


def trace_words(actuator: str, kind: str) -> TraceWords:
    """Return what a trace shows.

    Examples
    --------
    >>> trace_words("roll", "response").quantity
    'roll rate, °/s'
    """
    if kind == EVIDENCE:
        lost = "lost or slow control" if actuator in _RESPONSES else "lost thrust"
        return TraceWords(f"evidence of {lost}", "evidence", "alarm")
    if kind == "response":
        return TraceWords(_RESPONSES[actuator], "what the aircraft does", "what its outputs asked for")
    return _OF_TRACE[kind]


def in_order(kinds: Iterable[str], fault: str) -> list[str]:
    """Return kinds of traces in the order in which they are shown: what decided about a fault comes first.

    Examples
    --------
    >>> in_order(["roll_angle", "response", "evidence"], "hard_over")
    ['response', 'evidence', 'roll_angle']
    """
    decided = {"tracking": "_angle", "hard_over": "response"}.get(fault, EVIDENCE)
    return sorted(kinds, key=lambda kind: (not kind.endswith(decided), _TRACES.index(kind)))


def drawn(trace: Trace) -> Array:
    """Return the values of a trace as they are drawn, shape (n, 2): angles in degrees, evidence bounded."""
    if trace.kind == EVIDENCE:
        return np.minimum(trace.values, _ABOVE_ALARM * trace.values[:, :1])
    turns = "°" in trace_words(trace.actuator, trace.kind).quantity
    return np.degrees(trace.values) if turns else trace.values
