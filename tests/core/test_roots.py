"""Roots beside those of SciPy."""

from __future__ import annotations

from collections.abc import Callable
from math import atan, exp

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from mavhums.core.roots import root_between
from mavhums.core.statistics import t_probability


@pytest.mark.parametrize(
    ("function", "high"),
    [
        (lambda x: exp(-x) - 0.3, 5.0),
        (lambda x: atan(x - 3e5), 1e6),
        (lambda x: x - 1e-9, 1e6),
        (lambda x: x, 1.0),
        (lambda x: x - 1.0, 1.0),
        (lambda x: -1.0 if x < 0.7 else 1.0, 1.0),
    ],
)
def test_a_root_is_that_of_scipy(function: Callable[[float], float], high: float) -> None:
    assert root_between(function, 0.0, high) == pytest.approx(
        brentq(function, 0.0, high, xtol=1e-15), abs=1e-15
    )


@given(
    middle=st.floats(1.0, 3000.0),
    width=st.floats(0.01, 1000.0),
    freedom=st.floats(1.0, 100.0),
    share=st.floats(0.01, 0.99),
)
def test_a_quantile_takes_few_questions(middle: float, width: float, freedom: float, share: float) -> None:
    asked = []

    def below(at: float) -> float:
        asked.append(at)
        return t_probability(freedom, (at - middle) / width) - share

    if below(0.0) < 0.0 < below(1e6):
        asked.clear()
        found = root_between(below, 0.0, 1e6)
        assert len(asked) < 80
        assert found == pytest.approx(brentq(below, 0.0, 1e6, xtol=1e-12), rel=1e-9, abs=1e-9)
