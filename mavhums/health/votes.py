"""The network's votes: which share of a window's moving samples it calls an emergency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mavhums.health.motion import Motion

__all__ = ["Classifier", "Votes", "count_votes", "vote_share"]

_MIN_VOTERS = 20


class Classifier(Protocol):
    """What is needed of a network; ``values`` are V1…V12, shape (n, 12)."""

    def p_emergency(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the probability of an emergency for each sample, shape (n,)."""
        ...

    def inside(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which samples lie within the network's experience, shape (n,)."""
        ...


class Votes(NamedTuple):
    """Counts over a slot: moving samples, those the network may judge, those it calls an emergency."""

    moving: int
    voters: int
    emergency: int


def count_votes(network: Classifier, motion: Motion) -> Votes:
    """Let the network judge each moving sample that lies within its experience."""
    values = motion.values[motion.moving]
    known = values[network.inside(values)]
    emergency = int(np.count_nonzero(network.p_emergency(known) > 0.5)) if len(known) else 0
    return Votes(len(values), len(known), emergency)


def vote_share(slots: Sequence[Votes]) -> float | None:
    """Return the share of votes for an emergency; None where the network abstains.

    It abstains on few samples, and where more than half of them lie outside its experience.
    """
    moving = sum(slot.moving for slot in slots)
    voters = sum(slot.voters for slot in slots)
    if voters < _MIN_VOTERS or 2 * voters < moving:
        return None
    return sum(slot.emergency for slot in slots) / voters
