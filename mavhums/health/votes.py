"""The network's votes: which share of a window's moving samples it calls an emergency."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mavhums.health.motion import Motion
from mavhums.health.slots import Slots

__all__ = ["Classifier", "count_votes", "vote_share"]

_MIN_VOTERS = 20

Array = NDArray[np.float64]


class Classifier(Protocol):
    """What is needed of a network; ``values`` are V1…V12, shape (n, 12)."""

    def p_emergency(self, values: Array) -> Array:
        """Return the probability of an emergency for each sample, shape (n,)."""
        ...

    def inside(self, values: Array) -> NDArray[np.bool_]:
        """Return which samples lie within the network's experience, shape (n,)."""
        ...


def count_votes(network: Classifier, slots: Slots, motion: Motion) -> Array:
    """Return of each slot the moving samples, those the network may judge, and its votes for an emergency.

    Shape (k, 3).
    """
    votes = np.zeros((len(motion.moving), 3))
    votes[:, 0] = motion.moving
    known = np.flatnonzero(motion.moving)
    known = known[network.inside(motion.values[known])]
    votes[known, 1] = 1.0
    votes[known, 2] = network.p_emergency(motion.values[known]) > 0.5
    return slots.sums(votes)


def vote_share(windows: Array) -> Array:
    """Return the share of votes for an emergency in windows (k, S, 3); NaN where the network abstains.

    It abstains on few samples, and where more than half of them lie outside its experience.
    """
    moving, voters, emergency = windows.sum(axis=1).T
    silent = (voters < _MIN_VOTERS) | (2 * voters < moving)
    share: Array = np.divide(emergency, voters, out=np.full(len(windows), np.nan), where=~silent)
    return share
