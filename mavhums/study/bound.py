"""What a decision per sample can reach on the take-off: an oracle that knows the test conditions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavhums.study.cyclograms import TAKEOFF, fly_condition, fly_takeoff
from mavhums.study.experiment import Effort, samples
from mavhums.study.published import TEST_NM

__all__ = ["Bound", "takeoff_bound"]

_COMMANDED = 2  # V1 and V2 are left out: they name the flight, not the friction


@dataclass(frozen=True)
class Bound:
    """Accuracy of the oracle on the test flights, as shares of 1.

    Attributes
    ----------
    takeoffs
        Number of other take-offs, each flown at every test friction, from which the oracle learned.
    moving_share
        Share of the test samples in which the actuator moves.
    moving, standing, all
        Share of the moving, of the standing, and of all test samples that the oracle classifies right.
    """

    takeoffs: int
    moving_share: float
    moving: float
    standing: float
    all: float


def takeoff_bound(effort: Effort) -> Bound:
    """Let gradient-boosted trees learn other take-offs at the test frictions, and test them.

    Networks learn the two training frictions alone; the oracle knows the distribution of every test
    friction, and is not limited to sixteen neurons. What it takes for the other class while the
    actuator stands, no decision on the sample alone can be expected to tell.
    """
    from sklearn.ensemble import HistGradientBoostingClassifier

    others = [fly_takeoff(seed, nm) for seed in range(1, effort.takeoffs + 1) for nm in TEST_NM]
    values, classes, _ = samples(others, effort.every)
    oracle = HistGradientBoostingClassifier(max_iter=effort.iterations, max_leaf_nodes=63, random_state=0)
    oracle.fit(values[:, _COMMANDED:], classes)
    test = fly_condition(TAKEOFF, TEST_NM)
    tested, truth, _ = samples(test)
    moving = np.concatenate([flown.moving for flown in test])
    right = oracle.predict(tested[:, _COMMANDED:]) == truth
    shares = (moving.mean(), right[moving].mean(), right[~moving].mean(), right.mean())
    return Bound(effort.takeoffs, *map(float, shares))
