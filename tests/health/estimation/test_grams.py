"""The sums of a flight in parts of equal length, against sums that are made at the end."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.health.estimation.least_squares import Groups, row_length
from mavhums.health.estimation.thresholds import WINDOW_S


def parts(windows: int) -> list[list[int]]:
    """Return the windows of each part: up to sixteen parts; in each but the last two the same number."""
    size = 1
    while -(-(windows - 1) // size) > 16:
        size *= 2
    closed = [[*range(k, min(k + size, windows - 1))] for k in range(0, windows - 1, size)]
    return [*closed, [windows - 1]]


@pytest.mark.parametrize("windows", [1, 2, 3, 16, 17, 18, 19, 33, 34, 35, 70, 131])
@pytest.mark.parametrize("block", [1000, 13])
def test_a_flight_is_kept_in_parts_of_equal_length(windows: int, block: int) -> None:
    """A window's number is in its sums; between any two there are windows without a sample."""
    index = np.concatenate([WINDOW_S * 3 * np.arange(windows) + k for k in (0, WINDOW_S - 1)])
    index.sort()
    rows = np.zeros((index.size, row_length(1)))
    rows[:, 0] = 2.0
    rows[:, 1:] = (index // (3 * WINDOW_S))[:, None] + 1.0
    groups = Groups(1, lambda gram: gram.ravel()[:1])
    for k in range(0, index.size, block):
        groups.feed(index[k : k + block], rows[k : k + block])
    expected = parts(windows)
    found = groups.parts()
    assert [count for count, _ in found] == [4 * len(one) for one in expected]
    assert [float(sums[0]) for _, sums in found] == [2.0 * sum(k + 1 for k in one) for one in expected]
