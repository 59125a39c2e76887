import numpy as np
import pytest
from numpy.polynomial import Polynomial

from mavhums.learn import ChiSquareRanking, PairwiseRedundancyFilter

RANDOM = np.random.default_rng(11)
LABEL = np.repeat([False, True], 400)
ANGLE = RANDOM.normal(size=800)
CURRENT = RANDOM.normal(size=800) + LABEL
VOLTAGE = RANDOM.uniform(-27, 27, 800)
FEATURES = np.column_stack([ANGLE, CURRENT, VOLTAGE, -600 * ANGLE + 5, 0.024 * CURRENT, VOLTAGE * CURRENT])


def test_linear_pairs_are_grouped_and_a_product_is_not() -> None:
    groups = PairwiseRedundancyFilter().fit(FEATURES, LABEL).groups_
    assert groups == ((0, 3), (1, 4), (2,), (5,))


def test_a_square_is_explained_at_degree_two_but_not_at_one() -> None:
    features = np.column_stack([ANGLE, ANGLE**2])
    assert PairwiseRedundancyFilter(degree=1).fit(features, LABEL).groups_ == ((0,), (1,))
    parabola = PairwiseRedundancyFilter(degree=2).fit(features, LABEL)
    assert parabola.groups_ == ((0, 1),)
    # One direction is enough: the sign of the angle cannot be had from its square.
    assert parabola.r2_[1, 0] == pytest.approx(1)
    assert parabola.r2_[0, 1] < 0.2


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_r2_is_that_of_a_least_squares_polynomial(degree: int) -> None:
    features = np.column_stack([ANGLE, ANGLE**3 + CURRENT])
    residual = features[:, 1] - Polynomial.fit(ANGLE, features[:, 1], degree)(ANGLE)
    expected = 1 - residual.var() / features[:, 1].var()
    r2 = PairwiseRedundancyFilter(degree=degree).fit(features, LABEL).r2_
    assert r2[1, 0] == pytest.approx(expected)
    assert r2.diagonal().tolist() == [1, 1]


def test_of_each_group_the_most_informative_stays() -> None:
    worn = CURRENT + 0.2 * RANDOM.normal(size=800)
    features = np.column_stack([worn, CURRENT, ANGLE, ANGLE])
    fitted = PairwiseRedundancyFilter().fit(features, LABEL)
    assert fitted.groups_ == ((0, 1), (2, 3))
    best = int(np.argmax(fitted.ranking_.scores_[:2]))
    assert fitted.get_support(indices=True).tolist() == [best, 2]
    swapped = PairwiseRedundancyFilter().fit(features[:, [1, 0, 2, 3]], LABEL)
    assert swapped.get_support(indices=True).tolist() == [1 - best, 2]


def test_links_chain_into_one_group() -> None:
    first, last = RANDOM.normal(size=(2, 800))
    features = np.column_stack([first, first + last, last])
    fitted = PairwiseRedundancyFilter(threshold=0.4).fit(features, LABEL)
    assert fitted.r2_[0, 2] < 0.05
    assert fitted.groups_ == ((0, 1, 2),)


def test_constant_features_are_in_no_group_and_do_not_stay() -> None:
    features = np.column_stack([np.full(800, 27.0), CURRENT, np.zeros(800), ANGLE])
    fitted = PairwiseRedundancyFilter().fit(features, LABEL)
    assert fitted.groups_ == ((1,), (3,))
    assert fitted.get_support(indices=True).tolist() == [1, 3]
    assert not fitted.r2_[[0, 2]].any()
    assert not fitted.r2_[:, [0, 2]].any()
    with pytest.raises(ValueError, match="every feature is constant"):
        fitted.fit(features[:, [0, 2]], LABEL)


def test_two_valued_features_do_not_upset_the_regression() -> None:
    switch = np.tile([0.0, 1.0], 400)
    r2 = PairwiseRedundancyFilter().fit(np.column_stack([switch, switch * 5 - 2, CURRENT]), LABEL).r2_
    assert r2[0, 1] == pytest.approx(1)
    assert r2[2, 0] < 0.05


def test_the_given_ranking_decides_and_is_not_changed() -> None:
    ranking = ChiSquareRanking(bins=5, strategy="quantile")
    fitted = PairwiseRedundancyFilter(ranking=ranking).fit(FEATURES, LABEL)
    assert not hasattr(ranking, "scores_")
    np.testing.assert_array_equal(fitted.ranking_.scores_, ranking.fit(FEATURES, LABEL).scores_)
