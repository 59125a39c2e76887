"""What an actuator is held to be, out of what its detectors say one after the other."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mavhums.core.conditions import SEVERITY, Condition

__all__ = ["Change", "Holding", "Turn"]


class Change(NamedTuple):
    """What an indicator is held to show from the k-th of some windows on, and since when."""

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
    """Follows what the detectors of one actuator say.

    Attributes
    ----------
    shown
        The latest change of each fault.
    condition, worst
        What the actuator is held to be, and the worst that it was held to be.
    since_s
        Flight time since which it is.

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
        """Whether the shaft was held, where no balance of torques or angles holds."""
        return "jam" in self.shown and self.shown["jam"].condition == "emergency"

    def take(self, fault: str, change: Change) -> Turn | None:
        """Take what a detector says anew; tell if that changes the actuator's condition."""
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
        since_s = self._changed_s = max(since_s, self._changed_s)  # never before the last change
        self.since_s = None if self.condition == "undecided" else since_s
        return Turn(since_s, before, self.condition, rule, why)

    def _gravest(self) -> Condition:
        """Return the gravest condition that a detector shows; normal only if the friction is."""
        gravest: Condition = max(
            (change.condition for change in self.shown.values()), key=SEVERITY.__getitem__
        )
        if SEVERITY[gravest] > SEVERITY["normal"]:
            return gravest
        return self.shown["friction"].condition if "friction" in self.shown else "undecided"

    def _deciding(self) -> Collection[str]:
        """Return the faults that can make the condition what it is: only the friction makes it normal."""
        return {"friction"} if self.condition == "normal" else self.shown.keys()
