"""What lies behind a judgement, in words and in the units in which it is drawn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.engine.events import Trace

EVIDENCE: Final = "evidence"
FRAME: Final = "frame"
_ORDER: Final = (EVIDENCE, "response", "thrust", "roll_angle", "pitch_angle")
_ABOVE_ALARM: Final = 2.0  # what is certain grows without end, and would hide how near an alarm was


class TraceWords(NamedTuple):
    """What a trace shows: the quantity with its unit, the value, and what it is compared with."""

    quantity: str
    value: str
    against: str


_WORDS: Final = {
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
    return _WORDS[kind]


def in_order(kinds: Iterable[str], fault: str) -> list[str]:
    """Return kinds of traces in the order in which they are shown: what decided about a fault comes first.

    Examples
    --------
    >>> in_order(["roll_angle", "response", "evidence"], "hard_over")
    ['response', 'evidence', 'roll_angle']
    """
    decided = {"tracking": "_angle", "hard_over": "response"}.get(fault, EVIDENCE)
    return sorted(kinds, key=lambda kind: (not kind.endswith(decided), _ORDER.index(kind)))


def drawn(trace: Trace) -> Array:
    """Return the values of a trace as they are drawn, shape (n, 2): angles in degrees, evidence bounded."""
    if trace.kind == EVIDENCE:
        return np.minimum(trace.values, _ABOVE_ALARM * trace.values[:, :1])
    turns = "°" in trace_words(trace.actuator, trace.kind).quantity
    return np.degrees(trace.values) if turns else trace.values
