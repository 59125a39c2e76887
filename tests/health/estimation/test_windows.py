"""Windows slide over slots, the missing ones empty, in memory that a gap does not fill."""

from __future__ import annotations

import itertools
import tracemalloc

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mavhums.health.estimation.slots import Windows

gaps = st.lists(st.sampled_from([1, 1, 1, 2, 3, 9, 10, 11, 500]), min_size=1, max_size=40)


def naive(index: list[int], slots: int, empty: float) -> list[list[float]]:
    held = {number: float(k + 1) for k, number in enumerate(index)}
    return [[held.get(n, empty) for n in range(last - slots + 1, last + 1)] for last in index]


@given(gaps, st.integers(1, 12), st.sampled_from([0.0, -1.0]), st.data())
def test_windows_are_those_of_a_dictionary(
    gap: list[int], slots: int, empty: float, data: st.DataObject
) -> None:
    index = np.cumsum(gap) + data.draw(st.integers(-5, 10**9))
    sums = np.arange(1.0, len(gap) + 1.0)[:, None]
    windows = Windows(1, slots, empty)
    bounds = [0, *sorted(data.draw(st.sets(st.integers(1, len(gap))))), len(gap)]
    found = [windows.feed(index[a:b], sums[a:b]) for a, b in itertools.pairwise(bounds) if b > a]
    assert np.concatenate(found)[:, :, 0].tolist() == naive(index.tolist(), slots, empty)


def test_a_jump_of_the_clock_takes_no_memory() -> None:
    windows = Windows(20)
    windows.feed(np.array([0]), np.ones((1, 20)))
    tracemalloc.start()
    after = windows.feed(np.array([10**9, 10**9 + 1, 3 * 10**9]), np.ones((3, 20)))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000
    assert after[:, :, 0].sum(axis=1).tolist() == [1.0, 2.0, 1.0]
