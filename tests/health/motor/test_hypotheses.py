"""The hypotheses on an effort by their definitions: normal densities, a grid of shares and of the air."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mavhums.core.arrays import Array
from mavhums.health.motor import hypotheses as h

NOISE: Array = np.array([[0.02, 0.004, -0.003], [0.004, 0.03, 0.002], [-0.003, 0.002, 0.01]])
QUAD = np.array([[0.5, 0.5, 0.2], [-0.5, -0.5, 0.2], [0.5, -0.5, -0.2], [-0.5, 0.5, -0.2]])
ASKED = np.array([1.0, 0.9, 1.1, 1.2])
EFFORTS = [np.zeros(3), np.array([0.2, 0.25, 0.1]), np.array([-0.3, 0.1, 0.4]), np.array([0.05, -0.6, 0.0])]


def beside_none(e: Array, mean: Array) -> float:
    """Return the logarithm of the likelihood of a mean effort, against none."""
    fault, none = (multivariate_normal(one, NOISE).logpdf(e) for one in (mean, np.zeros(3)))
    return float(fault - none)


@pytest.mark.parametrize("e", EFFORTS)
def test_a_loss_leaves_an_effort_along_the_column_of_its_motor(e: Array) -> None:
    faults = h.hypotheses_of(4)
    ratios = np.empty((4, faults.losses.size))
    precision = np.linalg.inv(NOISE).astype(np.float64)
    h.of_losses(e, ASKED, precision, QUAD, faults, ratios)
    expected = [[beside_none(e, loss * ASKED[i] * QUAD[i]) for loss in faults.losses] for i in range(4)]
    assert ratios == pytest.approx(np.array(expected))


def test_health_is_a_hidden_markov_model_of_the_air() -> None:
    faults, change = h.hypotheses_of(4), 0.1
    air = faults.air_weights.copy()
    precision = np.linalg.inv(NOISE).astype(np.float64)
    known = [float(np.exp(h.of_health(e, precision, change, faults, air))) for e in EFFORTS]
    weights, joint = faults.air_weights, 1.0
    for e, ratio in zip(EFFORTS, known, strict=True):
        weights = (1.0 - change) * weights + change * faults.air_weights
        weights = weights * [np.exp(beside_none(e, mean)) for mean in faults.air]
        assert ratio == pytest.approx(weights.sum())
        weights = weights / weights.sum()
        joint *= ratio
    assert air == pytest.approx(weights)


@pytest.mark.parametrize(("motors", "least"), [(4, 0.25), (6, 0.4)])
def test_the_air_is_as_likely_one_way_as_the_other(motors: int, least: float) -> None:
    faults = h.hypotheses_of(motors)
    assert (faults.losses[0], faults.losses[-1]) == (least, 1.0)
    assert faults.air_weights.sum() == pytest.approx(1.0)
    assert faults.air_weights @ faults.air == pytest.approx(np.zeros(3), abs=1e-12)
    assert faults.air_weights[(faults.air == 0.0).all(axis=1)] > 0.5


def test_an_effort_beyond_all_levels_is_still_weighed() -> None:
    faults = h.hypotheses_of(4)
    air = faults.air_weights.copy()
    precision = np.linalg.inv(NOISE / 100.0).astype(np.float64)
    assert np.isfinite(h.of_health(np.full(3, 9.0), precision, 0.1, faults, air))
    assert air.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("e", EFFORTS)
def test_the_share_lost_is_a_regression_on_the_column(e: Array) -> None:
    column = 0.9 * QUAD[1]
    root = np.linalg.inv(np.linalg.cholesky(NOISE))
    [expected], *_ = np.linalg.lstsq((root @ column)[:, None], root @ e, rcond=None)
    loss, deviation = h.regression(e, 0.9, NOISE, QUAD[1])
    assert loss == pytest.approx(expected)
    assert deviation == pytest.approx(1.0 / np.linalg.norm(root @ column))
