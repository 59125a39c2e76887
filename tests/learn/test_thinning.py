import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.learn import VectorThinning

RANDOM = np.random.default_rng(2)
LABEL = np.repeat([0, 1], [300, 100])
FEATURES = RANDOM.normal(size=(400, 3)) + LABEL[:, None]


def test_each_class_keeps_its_share_and_its_weight() -> None:
    thinning = VectorThinning(40, random_state=0).fit(FEATURES, LABEL)
    label, weight = LABEL[thinning.indices_], thinning.weights_
    assert len(label) <= 40
    assert (np.diff(thinning.indices_) > 0).all()
    assert (label == 1).sum() == pytest.approx(len(label) / 4, abs=2)
    assert weight[label == 0].sum() == pytest.approx(300)
    assert weight[label == 1].sum() == pytest.approx(100)


def test_clusters_represent_what_is_near() -> None:
    """Dense samples are represented by few, rare ones are not forgotten."""
    dense = RANDOM.normal(scale=0.01, size=(500, 1))
    rare = np.array([[10.0], [20.0], [30.0]])
    thinning = VectorThinning(4, random_state=0).fit(np.vstack([dense, rare]), np.zeros(503))
    assert {500, 501, 502} <= set(thinning.indices_)
    assert sorted(thinning.weights_) == [1, 1, 1, 500]


def test_the_unit_of_a_feature_has_no_say() -> None:
    first = VectorThinning(30, random_state=0).fit(FEATURES, LABEL)
    second = VectorThinning(30, random_state=0).fit(FEATURES * [1024, 1, 2**-10], LABEL)
    np.testing.assert_array_equal(first.indices_, second.indices_)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.integers(1, 40), st.integers(0, 3))
def test_weights_sum_to_the_samples_whatever_repeats(count: int, seed: int) -> None:
    values = np.random.default_rng(seed).integers(0, 3, size=(30, 2)).astype(float)
    label = np.repeat([0, 1], 15)
    thinning = VectorThinning(count, random_state=0).fit(values, label)
    assert thinning.weights_.sum() == 30
    assert len(thinning.indices_) <= max(2, count + 1)


def test_nothing_is_thinned_that_is_small_enough() -> None:
    thinning = VectorThinning(400).fit(FEATURES, LABEL)
    np.testing.assert_array_equal(thinning.indices_, np.arange(400))
    assert set(thinning.weights_) == {1.0}
