"""Statistics of flights as a random sample, against the formulas of their sources."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import digamma, polygamma

from mavhums.health.estimation.random_effects import (
    CommonError,
    Population,
    population,
    satterthwaite,
    scattering_share,
    variance_between,
    weighted,
)

NATURAL = 9.0

ONE = np.ones((4, 1))
VALUES = np.array([1.0, 1.4, 0.7, 1.3])


def test_the_scatter_between_flights_is_the_variance_less_that_of_their_errors() -> None:
    variance = np.var(VALUES, ddof=1)
    assert variance_between(ONE, VALUES, np.full(4, 0.1)) == pytest.approx(variance - 0.01, rel=1e-5)
    assert variance_between(ONE, VALUES, np.full(4, 2.0)) == 0.0, "the errors alone explain it"
    # Of a line through four flights two degrees of freedom are left.
    design = np.column_stack([np.ones(4), [0.0, 1.0, 2.0, 3.0]])
    residuals = weighted(design, VALUES, np.ones(4))[1]
    expected = float(residuals @ residuals) / 2 - 0.01
    assert variance_between(design, VALUES, np.full(4, 0.1)) == pytest.approx(expected, rel=1e-5)


def test_a_population_with_much_scatter_is_that_of_its_flights() -> None:
    """The scatter exceeds the natural one, so that only the flights' own degrees of freedom count."""
    found = population(ONE, VALUES, np.full(4, 1e-6), natural_scatter=0.01)
    assert found.between == pytest.approx(np.std(VALUES, ddof=1), rel=1e-4)
    assert found.coefficients == pytest.approx([VALUES.mean()])
    assert found.covariance == pytest.approx(np.array([[np.var(VALUES, ddof=1) / 4]]), rel=1e-4)
    assert found.freedom == pytest.approx(3.0)


@pytest.mark.parametrize("natural_scatter", [0.01, 0.5])
def test_flights_count_by_their_errors_beside_the_scatter_between_them(natural_scatter: float) -> None:
    """The variance makes the weighted squares as large as expected; it counts with the natural one."""
    design = np.column_stack([np.ones(8), np.arange(8.0)])
    errors = np.array([0.02, 0.3, 0.05, 0.6, 0.1, 0.02, 0.4, 0.2])
    values = 2.0 + 0.1 * np.arange(8.0) + np.array([0.1, -0.5, -0.2, 0.9, 0.15, -0.1, 0.3, -0.2])
    own = variance_between(design, values, errors)
    first, residuals, _ = weighted(design, values, 1.0 / (errors**2 + own))
    assert own > 0.0
    assert residuals @ residuals == pytest.approx(6.0, rel=1e-4)
    natural = NATURAL * (natural_scatter * first[0]) ** 2
    between = max(own, (natural + 6.0 * own) / (NATURAL + 6.0))
    weights = 1.0 / (errors**2 + between)
    line, residuals, inverse = weighted(design, values, weights)
    found = population(design, values, errors, natural_scatter)
    assert found.between == pytest.approx(between**0.5)
    assert found.coefficients == pytest.approx(line)
    assert found.covariance == pytest.approx(max(float(residuals @ residuals) / 6.0, 1.0) * inverse)
    trusted = NATURAL if between > own else 0.0
    assert found.freedom == pytest.approx(weights.sum() ** 2 / (weights @ weights) - 2.0 + trusted)
    share, freedom = scattering_share(design, values, 8.0 * errors)
    squares = weighted(design, values, 1.0 / (8.0 * errors) ** 2)[1]
    assert freedom == 8.0
    assert share == pytest.approx((squares @ squares + 2.0) / freedom)
    assert share < 1.0


def test_a_population_that_agrees_by_chance_has_the_natural_scatter() -> None:
    found = population(ONE, np.full(4, 2.0), np.full(4, 1e-9), natural_scatter=0.05)
    pooled = NATURAL * (0.05 * 2.0) ** 2 / (NATURAL + 3)
    assert found.between == pytest.approx(pooled**0.5)
    assert found.freedom == pytest.approx(3.0 + NATURAL)
    assert found.covariance == pytest.approx(np.array([[pooled / 4]])), "never less than the errors"


def test_flights_of_unequal_weight_have_fewer_degrees_of_freedom() -> None:
    errors = np.array([1e-3, 1e-3, 10.0, 10.0])
    found = population(ONE, np.full(4, 2.0), errors, natural_scatter=0.05)
    assert found.freedom == pytest.approx(1.0 + NATURAL, abs=0.01), "two flights less one mean"


def test_a_new_flight_scatters_and_the_mean_is_uncertain() -> None:
    found = Population(np.array([1.0, 2.0]), np.array([[0.5, 0.1], [0.1, 0.2]]), 2.0, 9.0)
    assert found.variance_at(np.array([1.0, 3.0])) == pytest.approx(4.0 + 0.5 + 2 * 3 * 0.1 + 9 * 0.2)


def test_the_worth_of_common_errors_solves_smyths_equation() -> None:
    freedom, logarithms = np.full(5, 10.0), np.array([-1.0, -0.5, 0.0, 0.7, 1.1])
    found = CommonError.of(np.exp(logarithms), freedom)
    # The trigamma functions of both degrees of freedom make up the variance of the logarithms.
    assert polygamma(1, found.freedom / 2) + polygamma(1, 5.0) == pytest.approx(np.var(logarithms, ddof=1))
    worth = found.freedom / 2
    mean = logarithms.mean() - digamma(5.0) + np.log(5.0) + digamma(worth) - np.log(worth)
    assert found.variance == pytest.approx(np.exp(mean))


def test_common_errors_that_differ_beyond_measure_are_worth_next_to_nothing() -> None:
    found = CommonError.of(np.array([1e-300, 1.0, 1e300]), np.full(3, 10.0))
    assert 0.0 < found.freedom < 0.01
    assert CommonError.of(np.zeros(3), np.full(3, 10.0)).freedom == 30.0


def test_an_error_is_moderated_by_those_before() -> None:
    common = CommonError(4.0, 30.0)
    assert common.with_own(0.1, 10.0, 20.0) == pytest.approx((7.0 / 40, 40.0))
    assert common.with_own(0.3, 10.0, 20.0) == (0.3, 40.0), "a larger one of its own counts in full"


def test_satterthwaites_degrees_of_freedom() -> None:
    assert satterthwaite(1.0, 5.0, 1.0, 5.0) == pytest.approx(10.0)
    assert satterthwaite(2.0, 4.0, 1.0, 9.0) == pytest.approx(9.0 / (4.0 / 4.0 + 1.0 / 9.0))
