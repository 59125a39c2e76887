"""Determines an actuator's condition from the successive changes of its detectors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.decision.events import ConditionChanged
from mavhums.results.verdict import Since

_MOST_EPISODES = 100  # bounds the memory: of an actuator that alternates the first and the last stay


class IndicatorChange(NamedTuple):
    """A change of an indicator's condition, its onset, and the reason as text."""

    condition: Condition
    since_s: float
    rule: str


class ConditionTracker:
    """Tracks the conditions that the detectors of one actuator report.

    Parameters
    ----------
    vehicle, actuator
        System id, and the actuator's name.

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
    >>> tracker = ConditionTracker(1, "elevator")
    >>> tracker.take("friction", IndicatorChange("normal", 0.0, "normal: …"), 10.0).after
    'normal'
    >>> tracker.take("backlash", IndicatorChange("degraded", 3.0, "degraded: …"), 13.0).since_s
    3.0
    >>> tracker.condition, tracker.worst
    ('degraded', 'degraded')
    """

    def __init__(self, vehicle: int, actuator: str) -> None:
        self._whose = vehicle, actuator
        self.shown: dict[str, IndicatorChange] = {}
        self.condition: Condition = "undecided"
        self.worst: Condition = "undecided"
        self.since_s: float | None = None
        self._changed_s = -np.inf

    @property
    def jammed(self) -> bool:
        """Whether the shaft is jammed, in which case no balance of torques or angles is valid."""
        return "jam" in self.shown and self.shown["jam"].condition == "emergency"

    def take(self, fault: str, change: IndicatorChange, time_s: float) -> ConditionChanged | None:
        """Process a detector's change, decided at a flight time; return the actuator's own change, if any."""
        self.shown[fault] = change
        before, self.condition = self.condition, self._gravest()
        if SEVERITY[self.condition] > SEVERITY[self.worst]:
            self.worst = self.condition
        if self.condition == before:
            return None
        # Only the friction can make an actuator normal; any fault can make it worse.
        deciding = {"friction"} if self.condition == "normal" else self.shown.keys()
        holding = [
            (c.since_s, name, c.rule)
            for name, c in self.shown.items()
            if c.condition == self.condition and name in deciding
        ]
        since_s, why, rule = min(holding, default=(change.since_s, fault, change.rule))
        # Not before the last change: conditions follow each other in time.
        since_s = self._changed_s = max(since_s, self._changed_s)
        self.since_s = None if self.condition == "undecided" else since_s
        return ConditionChanged(*self._whose, time_s, since_s, before, self.condition, rule, why)

    def _gravest(self) -> Condition:
        """Return the worst condition of the detectors; normal only if the friction is normal."""
        gravest: Condition = max(
            (change.condition for change in self.shown.values()), key=SEVERITY.__getitem__
        )
        if SEVERITY[gravest] > SEVERITY["normal"]:
            return gravest
        # Silence of the other detectors is not health: normal requires that the friction was judged.
        return self.shown["friction"].condition if "friction" in self.shown else "undecided"


@dataclass(slots=True)
class Episode:
    """A continuous period in one condition; ``peak`` is its highest estimate."""

    condition: Condition
    start_s: float
    end_s: float
    peak: float


class Episodes:
    """Collects the episodes of one quantity, in bounded memory.

    If there are more than a hundred episodes, the first fifty and the last fifty are kept.

    Examples
    --------
    >>> episodes = Episodes()
    >>> episodes.begin(Episode("emergency", 0.0, 10.0, 0.9))
    >>> episodes.extend(1.1, 11.0, agrees=True)
    >>> [(episode.end_s, episode.peak) for episode in episodes]
    [(11.0, 1.1)]
    """

    def __init__(self) -> None:
        self._episodes: list[Episode] = []
        self._open_peak = -np.inf

    def __iter__(self) -> Iterator[Episode]:
        return iter(self._episodes)

    def begin(self, episode: Episode) -> None:
        """Start an episode, and end the previous one at its start."""
        if self._episodes:
            self._episodes[-1].end_s = episode.start_s
        self.add(episode)

    def add(self, episode: Episode) -> None:
        """Add an episode beside the others, which go on."""
        if len(self._episodes) == _MOST_EPISODES:
            del self._episodes[_MOST_EPISODES // 2]
        self._episodes.append(episode)

    def begin_decided(self, condition: Condition, since_s: float, end_s: float, value: float) -> None:
        """Start the episode of a window's decision; windows that led to it count towards its peak."""
        self._open_peak = max(self._open_peak, value)
        self.begin(Episode(condition, since_s, end_s, self._open_peak))
        self._open_peak = -np.inf

    def extend(self, value: float, end_s: float, *, agrees: bool) -> None:
        """Extend the current episode by a window.

        The value of a window that does not agree with the episode counts towards the peak of the next
        window that agrees, or of the next episode.
        """
        self._open_peak = max(self._open_peak, value)
        if self._episodes:
            self._episodes[-1].end_s = end_s
            if agrees:
                self._episodes[-1].peak = max(self._episodes[-1].peak, self._open_peak)
        if agrees:
            self._open_peak = -np.inf


def since(since_s: float | None, start_utc: datetime) -> Since | None:
    """Return an onset in flight time with its date; None if there is none."""
    if since_s is None:
        return None
    utc = start_utc + timedelta(seconds=since_s)
    return Since(flight_time_s=round(since_s, 3), utc=utc.astimezone(UTC).isoformat())
