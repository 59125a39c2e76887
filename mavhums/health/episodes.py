"""Episodes of one condition in a flight, for the evidence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mavhums.core.conditions import Condition

__all__ = ["Episode", "Episodes"]

_MOST_EPISODES = 100


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
