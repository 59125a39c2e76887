"""Student's t against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import stdtr, stdtrit

from mavhums.core.statistics import t_probability, t_quantile

FREEDOM = st.one_of(st.floats(0.2, 200.0), st.floats(0.2, 1e9))


@given(FREEDOM, st.floats(-60.0, 60.0))
def test_a_probability_is_scipys(freedom: float, value: float) -> None:
    assert t_probability(freedom, value) == pytest.approx(stdtr(freedom, value), rel=1e-7, abs=1e-250)


@given(FREEDOM, st.floats(1e-12, 1.0 - 1e-12))
def test_a_quantile_is_scipys(freedom: float, probability: float) -> None:
    found = t_quantile(freedom, probability)
    assert found == pytest.approx(stdtrit(freedom, probability), rel=1e-7, abs=1e-12)


def test_shapes_fit_each_other_and_what_is_not_defined_is_nan() -> None:
    freedom = np.array([[1.0], [9.0], [np.inf], [0.0], [np.nan]])
    found = t_quantile(freedom, np.array([0.0, 0.5, 0.975, 1.0]))
    np.testing.assert_allclose(found[:3, 1:3], stdtrit(freedom[:3], [0.5, 0.975]), atol=1e-12)
    assert (found[:3, [0, 3]] == [-np.inf, np.inf]).all()
    assert np.isnan(found[3:]).all()
    assert np.isnan(t_probability(freedom[3:], 1.0)).all()
    beyond = t_probability(np.array([1.0, 9.0, 1e9]), np.array([-np.inf, np.inf, 1e300]))
    assert beyond.tolist() == [0.0, 1.0, 1.0]
