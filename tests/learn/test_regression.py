from math import comb, factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.preprocessing import PolynomialFeatures

from mavhums.learn import ChiSquareRanking, NonlinearRegression, RegressionRedundancyFilter
from mavhums.learn.regression import IDENTITY, Elementary, basis_count, basis_products, basis_values

RANDOM = np.random.default_rng(5)
LABEL = np.repeat([False, True], 300)
VOLTAGE, SPEED, LOAD = RANDOM.normal(size=(3, 600))
CURRENT = RANDOM.normal(size=600) + LABEL


@settings(deadline=None)
@given(st.integers(1, 3), st.integers(1, 5), st.integers(1, 3))
def test_the_number_of_basis_functions_is_that_of_the_formula(z: int, features: int, m: int) -> None:
    products = basis_products(z, range(features), m)
    assert len(products) == len(set(products)) == basis_count(z, features, m) == comb(z * features + m, m)
    # The set G as the paper writes it, with its m constants: choosing m of its elements gives as many.
    elements = z * features + m
    assert comb(elements, m) == len(products)
    if z == 1:
        k = features + 1
        assert len(products) == factorial(k + m - 1) // (factorial(m) * factorial(k - 1))


def test_with_one_elementary_function_the_basis_is_that_of_the_polynomials() -> None:
    values = RANDOM.normal(size=(20, 3))
    ours = basis_values(values, IDENTITY, basis_products(1, range(3), 3))
    theirs = PolynomialFeatures(3).fit_transform(values)
    np.testing.assert_allclose(np.sort(ours, axis=1), np.sort(theirs, axis=1))


def test_elementary_functions_of_the_user_are_multiplied() -> None:
    functions: Elementary = {"{}": lambda x: x, "sin({})": np.sin}
    target = 3 * VOLTAGE * np.sin(SPEED) - 2
    model = NonlinearRegression(functions).fit(np.column_stack([VOLTAGE, SPEED]), target)
    assert model.expression(["U", "w"], target="M") == "M = -2 + 3·U·sin(w)"
    assert model.r2_ == pytest.approx(1)
    assert len(model.products_) == basis_count(2, 2, 2)
    np.testing.assert_allclose(model.predict(np.array([[2.0, 1.0]])), 6 * np.sin(1) - 2)


def test_dependent_basis_functions_get_no_coefficient() -> None:
    features = np.column_stack([VOLTAGE, 2 * VOLTAGE])
    model = NonlinearRegression().fit(features, 4 * VOLTAGE + VOLTAGE**2)
    assert (len(model.products_), model.rank_, (np.abs(model.coef_) > 1e-9).sum()) == (6, 3, 2)
    assert model.r2_ == pytest.approx(1)
    np.testing.assert_allclose(model.predict(features), 4 * VOLTAGE + VOLTAGE**2, atol=1e-9)


def test_r2_is_what_score_gives_and_noise_is_not_explained() -> None:
    features, noise = np.column_stack([VOLTAGE, SPEED]), LOAD
    model = NonlinearRegression().fit(features, noise)
    assert model.r2_ == pytest.approx(model.score(features, noise))
    assert model.r2_ < 0.05
    assert NonlinearRegression().fit(features, np.ones(600)).expression(target="c") == "c = 1"
    assert NonlinearRegression().fit(features, np.zeros(600)).expression() == "y = 0"


def test_an_elementary_function_must_be_finite_where_it_is_asked() -> None:
    with (
        np.errstate(invalid="ignore"),
        pytest.raises(ValueError, match=r"^log\(\{\}\) of feature 0 is not one finite number"),
    ):
        NonlinearRegression({"log({})": np.log}).fit(VOLTAGE[:, None], VOLTAGE)
    with pytest.raises(ValueError, match="at least one elementary function"):
        NonlinearRegression({}).fit(VOLTAGE[:, None], VOLTAGE)


FEATURES = np.column_stack([VOLTAGE, CURRENT, VOLTAGE * CURRENT, 0.02 * CURRENT, LOAD, np.ones(600)])


def test_of_interdependent_features_the_one_with_the_smallest_chi_square_goes() -> None:
    found = RegressionRedundancyFilter(threshold=0.99).fit(FEATURES, LABEL)
    scores = ChiSquareRanking().fit(FEATURES, LABEL).scores_
    assert found.groups_ == ((0, 1, 2, 3), (4,))
    assert scores[1] == scores[3] > scores[2]
    excluded = {dependence.feature: dependence for dependence in found.dependences_}
    # Of the equals V5 and V8 the first column stays, as it does in the ranking.
    assert set(excluded) == {2, 3}
    assert excluded[3].explained_by == (1,)
    assert found.get_support().tolist() == [True, True, False, False, True, False]


def test_the_models_say_what_explains_and_no_more() -> None:
    found = RegressionRedundancyFilter(threshold=0.99).fit(FEATURES, LABEL)
    product = next(dependence for dependence in found.dependences_ if dependence.feature == 2)
    names = [f"x{column}" for column in product.explained_by]
    assert product.model.expression(names, target="x2") in ("x2 = 1·x0·x1", "x2 = 50·x0·x3")
    assert product.r2_all == pytest.approx(1)


@pytest.mark.parametrize("order", [1, 2])
def test_r2_from_the_compressed_basis_is_that_of_the_regression_itself(order: int) -> None:
    features = np.column_stack([VOLTAGE, VOLTAGE**2 + 0.3 * SPEED, SPEED])
    found = RegressionRedundancyFilter(threshold=1e-6, order=order).fit(features, LABEL)
    first = found.dependences_[0]
    others = [column for column in range(3) if column != first.feature]
    direct = NonlinearRegression(order=order).fit(features[:, others], features[:, first.feature])
    assert first.r2_all == pytest.approx(direct.r2_, abs=1e-9)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(1e-3, 1e3), min_size=6, max_size=6))
def test_units_do_not_change_the_groups(scale: list[float]) -> None:
    changed = FEATURES * scale
    assert RegressionRedundancyFilter().fit(changed, LABEL).groups_ == ((0, 1, 2, 3), (4,))


def test_nothing_but_constants_is_refused() -> None:
    with pytest.raises(ValueError, match="every feature is constant"):
        RegressionRedundancyFilter().fit(np.ones((6, 2)), [0, 0, 0, 1, 1, 1])
