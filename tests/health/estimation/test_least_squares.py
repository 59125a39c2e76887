"""Least squares on sums, against least squares on the samples themselves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.health.estimation.least_squares import Fit, Prior, row_length, sums_of_slots

Array = NDArray[np.float64]
UNKNOWN = np.inf


class Data(NamedTuple):
    """Samples in S slots of equal length: X of shape (S, n, p), y of shape (S, n)."""

    X: Array
    y: Array

    def sums(self) -> Array:
        """Of each slot, as one window."""
        slots, n, p = self.X.shape
        there = np.ones(slots * n, dtype=bool)
        return sums_of_slots(self.X.reshape(-1, p), self.y.ravel(), there, np.arange(slots) * n)[None]

    def fit(self, prior: Prior | None = None) -> Fit:
        return Fit(self.sums(), prior or nothing_known(self.X.shape[2]), "abcdefgh"[: self.X.shape[2]])

    def without(self, slot: int) -> tuple[Array, Array]:
        """The samples of all other slots."""
        rest = np.arange(len(self.y)) != slot
        return np.concatenate([*self.X[rest]]), np.concatenate([*self.y[rest]])


def nothing_known(p: int) -> Prior:
    return Prior(np.zeros(p), np.full(p, UNKNOWN))


def made(seed: int, p: int = 3, slots: int = 10, n: int = 20, noise: float = 0.1) -> Data:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(slots, n, p)) * 10.0 ** rng.uniform(-1, 1, p)
    truth = rng.normal(size=p)
    common = rng.normal(size=(slots, 1)) * rng.choice([0.0, 0.2])
    return Data(X, X @ truth + common + noise * rng.normal(size=(slots, n)))


seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(1, 5))
@settings(max_examples=60, deadline=None)
def test_coefficients_and_variance_are_those_of_the_samples(seed: int, p: int) -> None:
    data = made(seed, p)
    X, y = data.without(-1)
    expected, residual, *_ = np.linalg.lstsq(X, y)
    fit = data.fit()
    assert fit.coefficients[0] == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert fit.variance[0] == pytest.approx(residual[0] / (len(y) - p), rel=1e-2)
    assert fit.count[0] == len(y)


@given(seeds)
@settings(max_examples=60, deadline=None)
def test_a_prior_gives_the_posterior(seed: int) -> None:
    """With normal residuals of the fit's variance: (XᵀX/s² + D⁻²)⁻¹ (Xᵀy/s² + D⁻²·m)."""
    data = made(seed, 3, n=4, noise=1.0)
    prior = Prior(np.array([1.0, -2.0, 0.5]), np.array([0.05, 0.5, UNKNOWN]))
    fit = data.fit(prior)
    X, y = data.without(-1)
    certainty = np.diag(prior.deviation**-2)
    precision = X.T @ X / fit.variance[0] + certainty
    expected = np.linalg.solve(precision, X.T @ y / fit.variance[0] + certainty @ prior.mean)
    assert fit.coefficients[0] == pytest.approx(expected, rel=1e-4, abs=1e-5)
    independent = np.sqrt(np.diag(np.linalg.inv(precision)))
    assert (fit.errors[0] >= independent * (1 - 1e-6)).all()


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_delete_one_is_a_fit_without_the_slot(seed: int) -> None:
    data = made(seed)
    fit = data.fit()
    refitted = np.array([np.linalg.lstsq(*data.without(k))[0] for k in range(10)])
    whole = np.linalg.lstsq(*data.without(-1))[0]
    jackknife = np.sqrt(9 / 10 * np.sum((refitted - whole) ** 2, axis=0))
    X, _ = data.without(-1)
    independent = np.sqrt(fit.variance[0] * np.diag(np.linalg.inv(X.T @ X)))
    assert fit.errors[0] == pytest.approx(np.maximum(jackknife, independent), rel=1e-4)


def test_samples_that_cannot_be_used_add_nothing() -> None:
    data = made(1)
    X, y = data.X[0].copy(), data.y[0].copy()
    usable = np.arange(len(y)) % 2 == 0
    X[~usable], y[~usable] = np.nan, np.inf
    first, there = np.zeros(1, dtype=np.int64), np.ones(10, dtype=bool)
    without = sums_of_slots(X[usable], y[usable], there, first)
    assert np.array_equal(sums_of_slots(X, y, usable, first), without)


def test_residuals_that_hang_together_widen_the_error() -> None:
    """Residuals common to a slot are ten numbers, however many samples a slot has."""
    rng = np.random.default_rng(2)
    common = rng.normal(size=(300, 10, 1)) * np.ones(50)
    errors = [Data(np.ones((10, 50, 1)), y).fit().errors[0, 0] for y in common]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.sqrt(1 / 10), rel=0.05)


def test_a_term_that_never_varies_stays_at_its_prior() -> None:
    data = made(3, 2)
    data.X[:, :, 1] = 0.0
    fit = data.fit(Prior(np.array([0.0, 5.0]), np.array([UNKNOWN, 0.7])))
    assert fit.coefficients[0, 1] == pytest.approx(5.0)
    assert fit.errors[0, 1] == pytest.approx(0.7, rel=1e-3)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_terms_that_move_together_stay_finite_and_near_the_prior(seed: int) -> None:
    data = made(seed, 2)
    data.X[:, :, 1] = data.X[:, :, 0]
    fit = data.fit(Prior(np.array([1.0, 1.0]), np.array([0.1, 0.1])))
    assert np.isfinite(fit.coefficients).all()
    assert np.isfinite(fit.errors).all()
    assert fit.coefficients[0, 0] - fit.coefficients[0, 1] == pytest.approx(0.0, abs=0.02)


def test_windows_without_samples_are_regular() -> None:
    fit = Fit(np.zeros((2, 10, row_length(3))), nothing_known(3), "abc")
    assert fit.filled.tolist() == [0, 0]
    assert not fit.spread.any()
    assert np.isfinite(fit.coefficients).all()
    assert np.isfinite(fit.errors).all()
    assert fit.coefficients.tolist() == [[0.0] * 3] * 2
    assert np.isfinite(fit.corrected("a", noisy="b")).all(), "a coefficient of zero divides nothing"


@pytest.mark.parametrize("noise", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("shared", [0.0, 0.6, -0.6])
@pytest.mark.parametrize("other", [0.0, 0.1])
def test_noise_in_a_term_is_allowed_for(noise: float, shared: float, other: float) -> None:
    """The first term is seen with noise, the second moves partly with it, the left side has noise of its own.

    The correction is half of the most that the noise can have pulled, its error 0.58 of that half.
    """
    rng = np.random.default_rng(4)
    truth = np.array([2.0, -1.0])
    X = rng.normal(size=(10, 2000, 2))
    X[:, :, 1] += shared * X[:, :, 0]
    y = X @ truth + other * rng.normal(size=(10, 2000))
    X[:, :, 0] += noise * rng.normal(size=(10, 2000))
    fit = Data(X, y).fit()
    corrected, errors = np.array([fit.corrected(term, noisy="a") for term in "ab"])[:, :, 0].T
    assert (np.abs(corrected - truth) <= 3**0.5 * errors + 4 * fit.errors[0]).all()
    if noise == 0.2 and not other:
        assert (np.abs(corrected - truth) < 0.6 * np.abs(fit.coefficients[0] - truth))[0]
    assert (errors >= fit.errors[0]).all()


def test_a_sign_is_counted_by_the_slots_that_show_it() -> None:
    way = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    X = np.stack([way, 0.3 * way + 2.0, np.ones_like(way)], axis=2)
    fit = Data(X, way).fit()
    assert fit.both_ways("a", "c").tolist() == fit.both_ways("c", "a").tolist() == [2]
    assert Data(np.abs(X), way).fit().both_ways("a", "c").tolist() == [0]
