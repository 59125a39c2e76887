"""The conditions of an actuator, and their order."""

from __future__ import annotations

from typing import Final, Literal

__all__ = ["SEVERITY", "URGENCY", "Condition"]

Condition = Literal["normal", "degraded", "emergency", "undecided"]

SEVERITY: Final[dict[Condition, int]] = {"undecided": -1, "normal": 0, "degraded": 1, "emergency": 2}
"""Order of evidence: any evidence ranks above none. A detector's worst state only moves up in it."""

URGENCY: Final[dict[Condition, int]] = {"normal": 0, "undecided": 1, "degraded": 2, "emergency": 3}
"""Order of maintenance priority: a subject without evidence ranks above a normal one."""
