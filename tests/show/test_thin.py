from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.show.curves import Thinner

CAPACITY = 16


def thinned(
    values: np.ndarray, cuts: list[int], keep: str = "extremes"
) -> tuple[np.ndarray, np.ndarray, int]:
    time = np.arange(len(values), dtype=float)
    thinner = Thinner(values.shape[1], CAPACITY, keep)  # type: ignore[arg-type]
    bounds = [0, *sorted(cut % (len(values) + 1) for cut in cuts), len(values)]
    for begin, end in pairwise(bounds):
        thinner.add(time[begin:end], values[begin:end])
    return *thinner.rows(), thinner.group


@settings(max_examples=200, deadline=None)
@given(size=st.integers(1, 20000), seed=st.integers(0, 99), cuts=st.lists(st.integers(0, 20000), max_size=5))
def test_no_peak_is_lost_and_no_more_rows_are_kept_than_fit(size: int, seed: int, cuts: list[int]) -> None:
    values = np.random.default_rng(seed).normal(size=(size, 3))
    values[:, 1] = np.nan
    time, kept, group = thinned(values, cuts)
    assert time.size <= CAPACITY + 2
    assert time.size >= min(size, CAPACITY // 2)
    assert (np.diff(time) > 0).all()
    assert (time[0], time[-1]) == (0, size - 1)
    assert kept[:, 0].max() == values[:, 0].max()
    assert kept[:, 2].min() == values[:, 2].min()
    assert np.isnan(kept[:, 1]).all()
    if size <= CAPACITY:
        np.testing.assert_array_equal(kept, values)
    assert np.isin(kept[:, 0], values[:, 0]).all()
    assert size <= group * CAPACITY


@pytest.mark.parametrize("size", [100, 1000])
def test_each_group_keeps_its_own_extremes_in_their_order(size: int) -> None:
    values = np.random.default_rng(size).normal(size=(size, 1))
    time, kept, group = thinned(values, [])
    for row in range(0, len(kept) // 2 * 2, 2):
        part = values[int(time[row]) : int(time[row + 1]) + 1, 0]
        assert len(part) <= group
        assert sorted(kept[row : row + 2, 0]) == sorted({part.min(), part.max()} if len(part) > 1 else part)
        if len(part) > 1:
            assert (kept[row, 0] < kept[row + 1, 0]) == (part.argmin() < part.argmax())


def test_what_is_not_a_number_hides_no_number() -> None:
    values = np.full((1000, 1), np.nan)
    values[500] = 7.0
    _, kept, _ = thinned(values, [])
    assert np.nanmax(kept) == 7.0


def test_whole_rows_stay_whole() -> None:
    values = np.stack([np.arange(999.0), -np.arange(999.0)], axis=1)
    time, kept, _ = thinned(values, [3, 500], keep="first")
    np.testing.assert_array_equal(kept[:, 0], time)
    np.testing.assert_array_equal(kept[:, 1], -time)
