"""Determines an actuator's condition from the successive changes of its detectors."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mavhums.core.conditions import SEVERITY, Condition

__all__ = ["Change", "Holding", "Turn"]


class Change(NamedTuple):
    """A change of an indicator's condition: the window k that brings it, and the onset."""

    window: int
    condition: Condition
    since_s: float
    rule: str


class Turn(NamedTuple):
    """An actuator's condition changed; ``fault`` is what changed it."""

    since_s: float
    before: Condition
    after: Condition
    rule: str
    fault: str


class Holding:
    """Tracks the conditions that the detectors of one actuator report.

    Attributes
    ----------
    shown
        The latest change of each fault.
    condition, worst
        The actuator's current condition, and the worst one so far.
    since_s
        Flight time of the onset of the current condition.

    Examples
    --------
    >>> holding = Holding()
    >>> holding.take("friction", Change(0, "normal", 0.0, "normal: …")).after
    'normal'
    >>> holding.take("backlash", Change(5, "degraded", 3.0, "degraded: …")).since_s
    3.0
    >>> holding.condition, holding.worst
    ('degraded', 'degraded')
    """

    def __init__(self) -> None:
        self.shown: dict[str, Change] = {}
        self.condition: Condition = "undecided"
        self.worst: Condition = "undecided"
        self.since_s: float | None = None
        self._changed_s = -np.inf

    @property
    def jammed(self) -> bool:
        """Whether the shaft is jammed, in which case no balance of torques or angles is valid."""
        return "jam" in self.shown and self.shown["jam"].condition == "emergency"

    def take(self, fault: str, change: Change) -> Turn | None:
        """Process a detector's change; return the resulting change of the actuator's condition, if any."""
        self.shown[fault] = change
        before, self.condition = self.condition, self._gravest()
        if SEVERITY[self.condition] > SEVERITY[self.worst]:
            self.worst = self.condition
        if self.condition == before:
            return None
        holding = [
            (c.since_s, name, c.rule)
            for name, c in self.shown.items()
            if c.condition == self.condition and name in self._deciding()
        ]
        since_s, why, rule = min(holding, default=(change.since_s, fault, change.rule))
        since_s = self._changed_s = max(since_s, self._changed_s)  # not before the last change
        self.since_s = None if self.condition == "undecided" else since_s
        return Turn(since_s, before, self.condition, rule, why)

    def _gravest(self) -> Condition:
        """Return the worst condition of the detectors; normal only if the friction is normal."""
        gravest: Condition = max(
            (change.condition for change in self.shown.values()), key=SEVERITY.__getitem__
        )
        if SEVERITY[gravest] > SEVERITY["normal"]:
            return gravest
        return self.shown["friction"].condition if "friction" in self.shown else "undecided"

    def _deciding(self) -> Collection[str]:
        """Return the faults that can cause the condition; only the friction can make it normal."""
        return {"friction"} if self.condition == "normal" else self.shown.keys()
