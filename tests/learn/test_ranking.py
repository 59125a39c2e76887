from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from scipy.stats import chi2 as chi2_distribution
from sklearn.feature_selection import chi2

from mavhums.learn import ChiSquareRanking

Dataset = tuple[NDArray[np.float64], NDArray[np.int64]]


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    """Whole numbers with many equals, so that bins fill unevenly; two or three classes."""
    samples = draw(st.integers(4, 40))
    shape = (samples, draw(st.integers(1, 4)))
    features = draw(hnp.arrays(np.int64, shape, elements=st.integers(-20, 20)))
    labels = draw(hnp.arrays(np.int64, samples, elements=st.integers(0, 2)))
    return features.astype(np.float64), labels


def test_statistic_of_a_table_calculated_by_hand() -> None:
    # Low 30:10, high 20:40 → 100·(30·40 − 10·20)² / (40·60·50·50) = 50/3.
    feature = np.repeat([0.0, 0.0, 1.0, 1.0], [30, 10, 20, 40])[:, np.newaxis]
    label = np.repeat([0, 1, 0, 1], [30, 10, 20, 40])
    ranking = ChiSquareRanking().fit(feature, label)
    assert ranking.scores_[0] == pytest.approx(50 / 3)
    assert ranking.degrees_of_freedom_.tolist() == [1]
    assert ranking.p_values_[0] == pytest.approx(chi2_distribution.sf(50 / 3, 1))


@pytest.mark.parametrize("classes", [2, 3])
def test_agrees_with_scikit_learn_on_indicators_of_the_bins(classes: int) -> None:
    random = np.random.default_rng(1)
    label = random.integers(0, classes, 3000)
    feature = random.normal(size=3000) + label / 4
    edges = np.linspace(feature.min(), feature.max(), 13)
    indicators = np.eye(12)[np.clip(np.digitize(feature, edges) - 1, 0, 11)]
    occupied = indicators.any(axis=0)
    ranking = ChiSquareRanking().fit(feature[:, np.newaxis], label)
    assert ranking.scores_[0] == pytest.approx(chi2(indicators[:, occupied], label)[0].sum())
    assert ranking.degrees_of_freedom_[0] == (occupied.sum() - 1) * (classes - 1)


def test_quantile_bins_hold_equally_many_samples() -> None:
    feature = np.exp(np.arange(120.0) / 10)[:, np.newaxis]
    label = (np.arange(120) // 10) % 2
    # Each of the twelve bins of ten holds one class only: the statistic is the number of samples.
    assert ChiSquareRanking(strategy="quantile").fit(feature, label).scores_[0] == pytest.approx(120)
    assert ChiSquareRanking(strategy="width").fit(feature, label).scores_[0] < 60


@pytest.mark.parametrize("strategy", ["width", "quantile"])
def test_a_feature_alike_in_both_classes_scores_zero(strategy: Any) -> None:
    command = np.random.default_rng(2).normal(size=500)
    features = np.column_stack([np.tile(command, 2), np.full(1000, 3.7)])
    ranking = ChiSquareRanking(strategy=strategy).fit(features, np.repeat([False, True], 500))
    assert ranking.scores_.tolist() == [0, 0]
    assert ranking.p_values_.tolist() == [1, 1]
    assert ranking.degrees_of_freedom_[1] == 0


@pytest.mark.slow
@given(data=datasets())
def test_width_ignores_units_and_quantile_any_increasing_transformation(data: Dataset) -> None:
    features, label = data
    width = ChiSquareRanking()
    quantile = ChiSquareRanking(strategy="quantile")
    np.testing.assert_array_equal(
        width.fit(1024 * features, label).scores_, width.fit(features, label).scores_
    )
    np.testing.assert_array_equal(
        quantile.fit(features**3, label).scores_, quantile.fit(features, label).scores_
    )


@pytest.mark.parametrize("strategy", ["width", "quantile"])
def test_the_largest_floats_do_not_overflow(strategy: Any) -> None:
    largest = np.finfo(np.float64).max
    feature = np.repeat([-largest, largest], 10)[:, np.newaxis]
    assert ChiSquareRanking(strategy=strategy).fit(feature, np.repeat([0, 1], 10)).scores_[0] == 20


def test_keeps_the_best_and_among_equals_the_first() -> None:
    label = np.tile([0, 1], 20)
    features = np.column_stack([np.zeros(40), label, label, np.arange(40)])
    ranking = ChiSquareRanking(k=1).fit(features, label)
    assert ranking.get_support(indices=True).tolist() == [1]
    assert ranking.set_params(k=2).fit_transform(features, label).tolist() == features[:, 1:3].tolist()
    assert ranking.set_params(k="all").fit(features, label).get_support().all()
    many = np.outer(label, np.arange(50) % 2)
    assert ranking.set_params(k=3).fit(many, label).get_support(indices=True).tolist() == [1, 3, 5]
