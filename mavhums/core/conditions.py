"""The conditions of an actuator, and their order."""

from __future__ import annotations

from typing import Final, Literal

__all__ = ["SEVERITY", "URGENCY", "Condition"]

Condition = Literal["normal", "degraded", "emergency", "undecided"]

SEVERITY: Final[dict[Condition, int]] = {"undecided": -1, "normal": 0, "degraded": 1, "emergency": 2}
"""What evidence shows: any evidence outranks none. A detector's state only ever grows along it."""

URGENCY: Final[dict[Condition, int]] = {"normal": 0, "undecided": 1, "degraded": 2, "emergency": 3}
"""What a maintainer acts on first: a subject without evidence comes before one that is normal."""
