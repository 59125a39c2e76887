"""The networks' answers on single samples, as in the paper's figures 16 to 19.

A sample is classified by the first network whose input quantities it carries. It is judged by itself, so
that the answer does not depend on the samples around it: not on its window, and not on the cut into blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.quantities import column
from mavhums.learn import Model

__all__ = ["SampleAnswers", "answer_samples"]

_V2, _V3 = column("V2"), column("V3")


class SampleAnswers(NamedTuple):
    """What the networks say of n samples.

    Attributes
    ----------
    p_emergency
        Probability of an emergency, shape (n,); NaN where no network's quantities are all there.
    said
        Index into ``classes`` of the most probable class, shape (n,); -1 where there is no probability.
    inside
        Whether the sample lies within the training range of its network, shape (n,). Elsewhere the network
        abstains, whatever its class.
    classes
        Names of the classes of all these networks.
    """

    p_emergency: NDArray[np.float64]
    said: NDArray[np.int8]
    inside: NDArray[np.bool_]
    classes: tuple[str, ...]


def answer_samples(
    models: Sequence[Model], values: NDArray[np.float64], gear_ratio: float | None = None
) -> SampleAnswers:
    """Return the networks' answers on samples.

    Parameters
    ----------
    models
        Networks; the one with the most inputs comes first.
    values
        V1…V12, shape (n, 12).
    gear_ratio
        Gear ratio of the actuator: a V3 that is exactly V2 divided by it was not measured. None if unknown.
    """
    count = len(values)
    classes = tuple(dict.fromkeys(name for model in models for name in model.classes))
    p_emergency, inside = np.full(count, np.nan), np.zeros(count, dtype=np.bool_)
    said = np.full(count, -1, dtype=np.int8)
    carried = np.isfinite(values)
    if gear_ratio is not None:
        carried[:, _V3] &= values[:, _V3] != values[:, _V2] / gear_ratio
    open_ = np.ones(count, dtype=np.bool_)
    for model in models:
        own = open_ & np.asarray(carried[:, [column(key) for key in model.keys]].all(axis=1))
        open_ &= ~own
        if not own.any():
            continue
        answers = model.classify(values[own])
        names = np.array([classes.index(name) for name in model.classes], dtype=np.int8)
        # Quantities so large that the network's sums overflow have no probability.
        known = np.asarray(np.isfinite(answers.probabilities).all(axis=1))
        most = names[np.where(known[:, None], answers.probabilities, 0.0).argmax(axis=1)]
        p_emergency[own] = answers.probabilities[:, model.emergency]
        said[own] = np.where(known, most, -1)
        inside[own] = answers.inside & known
    return SampleAnswers(p_emergency, said, inside, classes)
