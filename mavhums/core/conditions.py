"""The conditions of an actuator, and their order."""

from __future__ import annotations

from typing import Final, Literal

Condition = Literal[
    "normal", "unchanged", "unmonitored", "learning", "undecided", "changed", "degraded", "emergency"
]
"""Without a known limit an actuator is not ``normal``: it is ``unchanged`` against its own earlier flights,
``changed``, or still ``learning`` what they are."""

SEVERITY: Final[dict[Condition, int]] = {
    "unmonitored": -2,
    "undecided": -1,
    "learning": -1,
    "normal": 0,
    "unchanged": 0,
    "changed": 1,
    "degraded": 1,
    "emergency": 2,
}
"""Order of what evidence shows: any evidence outranks none. A detector's state only grows in this order."""

URGENCY: Final[dict[Condition, int]] = {
    "unmonitored": 0,
    "normal": 1,
    "unchanged": 2,
    "learning": 3,
    "undecided": 4,
    "changed": 5,
    "degraded": 6,
    "emergency": 7,
}
"""Order in which a maintainer acts; a subject that nothing monitors comes after what was judged."""
