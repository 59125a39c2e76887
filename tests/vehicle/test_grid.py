"""What lies between samples: interpolation, spacing, and what holds; on each side of every limit."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.vehicle.grid import _between, _last_reported, _spacing

NAN = np.nan


@pytest.mark.parametrize(
    ("at", "expected"), [(-0.1, NAN), (0.0, 1.0), (0.3, 1.5), (0.9, 2.5), (1.2, NAN), (2.5, NAN), (9.0, NAN)]
)
def test_a_signal_is_interpolated_over_no_more_than_a_gap(at: float, expected: float) -> None:
    """The samples are 1.2 s and then 1.3 s apart; from the last one on nothing lies between samples."""
    time_s, values = np.array([0.0, 1.2, 2.5]), np.array([[1.0], [3.0], [7.0]])
    np.testing.assert_allclose(_between(time_s, values, np.array([at])), [[expected]])


def test_spacing_and_state_hold_for_five_seconds() -> None:
    time_s = np.array([0.0, 5.0, 10.5])
    at = np.array([-1.0, 0.0, 4.9, 5.0, 10.5])
    np.testing.assert_array_equal(_spacing(time_s, at), [NAN, 5.0, 5.0, NAN, NAN])
    values = np.array([[1.0], [2.0], [3.0]])
    at = np.array([-1.0, 0.0, 4.9, 5.0, 10.0, 10.1, 15.5, 15.6])
    np.testing.assert_array_equal(
        _last_reported(time_s, values, at)[:, 0], [NAN, 1.0, 1.0, 2.0, 2.0, NAN, 3.0, NAN]
    )
    np.testing.assert_array_equal(_last_reported(time_s[:0], values[:0], at[:2]), [[NAN], [NAN]])
