"""The conditions of an actuator, and their order."""

from __future__ import annotations

from typing import Final, Literal

__all__ = ["SEVERITY", "URGENCY", "Condition"]

Condition = Literal["normal", "degraded", "emergency", "undecided", "unmonitored"]

SEVERITY: Final[dict[Condition, int]] = {
    "unmonitored": -2,
    "undecided": -1,
    "normal": 0,
    "degraded": 1,
    "emergency": 2,
}
"""What evidence shows: any evidence outranks none. A detector's state only ever grows along it."""

URGENCY: Final[dict[Condition, int]] = {
    "normal": 0,
    "unmonitored": 1,
    "undecided": 2,
    "degraded": 3,
    "emergency": 4,
}
"""What a maintainer acts on first: a subject without evidence comes before one that is normal."""
