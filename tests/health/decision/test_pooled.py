"""Standard errors steadied by those of the flight so far, and the scatter of numbers that come one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.health.decision.limits import Estimates, PooledErrors
from mavhums.health.estimation.random_effects import RunningVariance

Array = NDArray[np.float64]
errors = st.lists(st.one_of(st.floats(1e-3, 10.0), st.just(np.nan)), min_size=1, max_size=60)


def estimates(error: Array) -> Estimates:
    return Estimates(np.where(np.isnan(error), np.nan, 1.0), error, np.full(error.size, 9.0))


@given(errors)
def test_an_error_never_falls_below_the_windows_own(error: list[float]) -> None:
    own = np.array(error)
    found = PooledErrors().feed(estimates(own))
    shown = np.isfinite(own)
    assert (found.error[shown] >= own[shown]).all()
    assert (found.error[shown] <= max(own[shown], default=0.0) * (1 + 1e-12)).all()
    assert (found.freedom >= 9.0).all()
    assert (found.freedom <= 45.0).all()


def test_a_window_too_sure_of_itself_gets_the_flights_error() -> None:
    found = PooledErrors().feed(estimates(np.array([0.1] * 40 + [0.0001])))
    assert found.freedom[-1] == 45.0
    mean_square = (9 * 0.0001**2 + 36 * (40 * 0.1**2 + 0.0001**2) / 41) / 45
    assert found.error[-1] == pytest.approx(np.sqrt(mean_square))
    assert found.freedom[0] == 9.0


@given(st.lists(st.floats(-1e6, 1e6), max_size=40))
def test_the_scatter_is_the_standard_deviation(numbers: list[float]) -> None:
    scatter = RunningVariance()
    for number in numbers:
        scatter.add(number)
    assert scatter.count == len(numbers)
    if len(numbers) < 2:
        assert scatter.deviation is None
    else:
        assert scatter.deviation == pytest.approx(np.std(numbers, ddof=1), rel=1e-6, abs=1e-6)
