"""What the residuals of an attitude rest on."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.health.axis.residuals import _OwnSpeed
from tests.health.axis.flights import rows, steady


@pytest.mark.parametrize("cut", [100, 7, 1])
def test_the_usual_speed_is_the_median_of_the_first_minute_that_was_flown(cut: int) -> None:
    """Every other second is flown: those of 1, 3, … 119; each later one counts for nothing."""
    flight = steady(140)
    second = np.repeat(np.arange(140), 20)
    flight["speed"][:] = second
    flight["speed"][::20] = np.nan
    whole = rows(flight)
    whole.flying[:] = second % 2 == 1
    own = _OwnSpeed()
    found = np.concatenate([own.feed(whole.cut(k, min(k + cut, 140))) for k in range(0, 140, cut)])
    flown = [[s for s in range(min(k, 119) + 1) if s % 2] for k in range(140)]
    expected = np.repeat([np.median(one) if one else np.nan for one in flown], 20)
    np.testing.assert_array_equal(found, expected)
