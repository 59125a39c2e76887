"""The hypotheses on a window of effort against their definitions: normal densities, grids of shares lost."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from mavhums.core.arrays import Array
from mavhums.health.motor import hypotheses as h
from mavhums.health.motor import thresholds as t
from mavhums.health.motor.evidence import rules_for

NOISE = np.array([[0.02, 0.004, -0.003], [0.004, 0.03, 0.002], [-0.003, 0.002, 0.01]])
SMALL = NOISE / 100.0
QUAD = np.array([[0.5, 0.5, 0.2], [-0.5, -0.5, 0.2], [0.5, -0.5, -0.2], [-0.5, 0.5, -0.2]])
PLUS = np.array([[1.0, 0.0, 0.2], [-1.0, 0.0, 0.2], [0.0, 1.0, -0.2], [0.0, -1.0, -0.2]])
ASKED = np.array([1.0, 0.9, 1.1, 1.2])
RULES = rules_for(4)
EFFORTS = [np.zeros(3), np.array([0.2, 0.25, 0.1]), np.array([-0.3, 0.1, 0.4]), np.array([0.05, -0.6, 0.0])]


def log_density(e: Array, covariance: Array, mean: Array) -> float:
    """Return the density of scipy, whose constant the hypotheses leave out."""
    return float(multivariate_normal(mean, covariance).logpdf(e) + 1.5 * np.log(2.0 * np.pi))


def motor_loss(e: Array, motor: int, loss: float, noise: Array, columns: Array) -> float:
    """Return the log density of a share lost: the column's error grows with it, the air's does not."""
    reach = np.maximum(np.abs(columns[motor]), 0.5 * np.abs(columns).max(axis=0))
    extra = (t.MODEL_ERROR * loss * ASKED[motor] * reach) ** 2 + t.AIR_BESIDE**2
    return log_density(e, noise + np.diag(extra), loss * ASKED[motor] * columns[motor])


def motor(e: Array, number: int, noise: Array, columns: Array) -> tuple[float, Array]:
    shares = [motor_loss(e, number, (j + 0.5) / h.LOSSES, noise, columns) for j in range(h.LOSSES)]
    return float(logsumexp(shares) - np.log(h.LOSSES)), np.array(shares)


@pytest.mark.parametrize("e", EFFORTS)
def test_a_density_is_the_normal_one(e: Array) -> None:
    extra, mean = np.array([0.01, 0.02, 0.03]), np.array([0.1, -0.2, 0.05])
    expected = log_density(e, NOISE + np.diag(extra), mean)
    assert h.density(e, NOISE, extra, mean) == pytest.approx(expected)
    assert h.det(NOISE) == pytest.approx(np.linalg.det(NOISE))
    assert h.add(e[0], e[1]) == pytest.approx(np.logaddexp(e[0], e[1]))


@pytest.mark.parametrize(("e", "window"), list(product(EFFORTS, (3, 4))))
def test_the_other_causes_are_noise_and_air_by_its_rarity(e: Array, window: int) -> None:
    """The air that comes slowly shows from the fifth window on."""
    slow = t.AIR_SLOW**2 if window == 4 else np.zeros(3)
    causes = [log_density(e, NOISE, np.zeros(3))]
    for air, rarity in zip(t.AIR, t.AIR_RARITY, strict=True):
        causes.append(log_density(e, NOISE + np.diag(air**2 + slow), np.zeros(3)) - np.log(rarity))
    assert h.of_others(window, e, NOISE, RULES) == pytest.approx(max(causes))


@pytest.mark.parametrize(("e", "columns"), list(product(EFFORTS, (QUAD, PLUS))))
def test_a_motor_lost_any_share_alike(e: Array, columns: Array) -> None:
    for k in range(4):
        filled = np.empty(h.LOSSES)
        total, shares = motor(e, k, NOISE, columns)
        assert h.of_motor(k, e, ASKED, NOISE, columns, RULES, filled) == pytest.approx(total)
        assert filled == pytest.approx(shares)


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        # All in the step from 0.5 to 0.55: its ends but for 2.5 % of it, and its middle.
        ({10: 1.0}, (0.5 + 0.025 * 0.05, 0.525, 0.5 + 0.975 * 0.05)),
        # Half of each: 2.5 % of all are 5 % of the first step.
        ({2: 0.5, 19: 0.5}, (0.1 + 0.05 * 0.05, (0.125 + 0.975) / 2, 0.95 + 0.95 * 0.05)),
    ],
)
def test_quantiles_lie_within_the_steps(
    weights: dict[int, float], expected: tuple[float, float, float]
) -> None:
    posterior = np.full(h.LOSSES, -1e3)
    for step, weight in weights.items():
        posterior[step] = 7.0 + np.log(weight)
    assert h.quantiles(posterior) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("lost", [(0, 1), (0, 2), (1, 3), (2, 3)])
def test_two_motors_are_the_pair_of_the_largest_evidence(lost: tuple[int, int]) -> None:
    shares = 0.7, 0.5
    e = sum(share * ASKED[k] * QUAD[k] for k, share in zip(lost, shares, strict=True))
    totals = {}
    for one, other in combinations(range(4), 2):
        parts = []
        for a, b in product((np.arange(10) + 0.5) / 10, repeat=2):
            own, beside = a * ASKED[other], b * ASKED[one]
            extra = (t.MODEL_ERROR * max(own, beside) * np.abs(QUAD).max(axis=0)) ** 2 + t.AIR_BESIDE**2
            mean = own * QUAD[other] + beside * QUAD[one]
            parts.append(log_density(e, SMALL + np.diag(extra), mean))
        totals[one + 1, other + 1] = logsumexp(parts) - np.log(100.0)
    best = max(totals, key=totals.__getitem__)
    most = float(totals[best])
    # It must beat every other cause and one motor alone by as much as the rules ask for, and more.
    for causes, alone, found in (
        (most - t.PAIR_ODDS - 0.01, -99.0, best),
        (most - t.PAIR_ODDS + 0.01, -99.0, (0, 0)),
        (-99.0, most - t.PAIR_BESIDE_ONE - 0.01, best),
        (-99.0, most - t.PAIR_BESIDE_ONE + 0.01, (0, 0)),
    ):
        assert h.pair(alone, causes, e, ASKED, SMALL, QUAD, RULES) == found


@pytest.mark.parametrize("e", [np.array([0.3, 0.0, 0.0]), np.array([0.4, 0.4, 0.15]), np.zeros(3)])
def test_a_payload_explains_more_than_noise_and_more_than_each_motor(e: Array) -> None:
    noise = log_density(e, SMALL, np.zeros(3))
    best = max(motor(e, k, SMALL, QUAD)[0] for k in range(4))
    least = max(noise + t.PAYLOAD_ODDS, best + t.PAYLOAD_BESIDE_MOTOR)
    for other, explained in ((least + 1e-6, True), (least - 1e-6, False)):
        assert h.is_payload(other, e, ASKED, SMALL, QUAD, RULES) is explained


def test_the_bound_of_a_loss_is_that_of_a_regression_on_its_column() -> None:
    e, asked = np.array([0.2, 0.2, 0.1]), np.array([1.0, 0.31, 0.29, 0.5])
    recent = np.array([0.0, 0.0, 0.25, 5.0])
    h.bound_losses(e, asked, SMALL, QUAD, RULES, recent)
    inverse = np.linalg.inv(SMALL + np.diag(t.AIR[0] ** 2))
    bounds = []
    for column in QUAD * asked[:, None]:
        information = column @ inverse @ column
        bounds.append(column @ inverse @ e / information + 1.96 / information**0.5)
    # A motor of which little is asked shows nothing, and the largest bound so far stays.
    assert recent == pytest.approx([bounds[0], max(bounds[1], 0.0), 0.25, 5.0])
