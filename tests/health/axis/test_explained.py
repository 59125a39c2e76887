"""How much of an axis's response a demand explains, against shares that the flight is made of."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from mavhums.health.axis.explained import explained_by
from mavhums.vehicle.grid import RATE_HZ
from tests.health.axis.flights import excited, late, rolling, rows, steady

NONE = np.empty((120 * RATE_HZ, 0))


def test_a_demand_that_the_axis_follows_explains_nearly_all_and_another_one_nearly_nothing() -> None:
    flight = rolling(120, lambda time_s: 2.0 + 0.0 * time_s, noise=0.0)
    share, rest = explained_by("roll", flight, flight.outputs[:, 0], NONE)
    assert 0.99 < share <= 1.0
    assert rest == pytest.approx(0.0, abs=1e-9)
    assert 0.0 <= explained_by("roll", flight, excited(120, seed=9), NONE)[0] < 0.1


def test_what_a_demand_leaves_another_one_explains() -> None:
    """Noise carries a quarter of the power of the second demand: of the rest that demand explains 4/5."""
    flight, one, other = steady(120), excited(120, seed=1), excited(120, seed=2)
    noise = np.random.default_rng(3).normal(size=one.size)
    flight["roll_rate"] = 2.0 * late(one) + late(other) + 0.5 * late(other).std() * noise
    share, rest = explained_by("roll", rows(flight), one, other[:, None])
    # The first demand has four times the power of the second, and that 1.25 with its noise.
    assert share == pytest.approx(4.0 / 5.25, abs=0.06)
    assert rest == pytest.approx(4.0 / 5.0, abs=0.03)


def test_a_flight_that_is_too_short_shows_nothing() -> None:
    flight = rolling(20, lambda time_s: 2.0 + 0.0 * time_s)
    assert explained_by("roll", flight, flight.outputs[:, 0], NONE[: 20 * RATE_HZ]) == (0.0, 0.0)


def test_an_output_moves_pitch_before_turns_have_settled_the_speed() -> None:
    flight, demand = steady(120), excited(120)
    flight["pitch_rate"] = lfilter([0.4], [1.0, -0.8], demand)
    flown = rows(flight)
    flown.settled[:] = False
    assert explained_by("pitch", flown, demand, NONE)[0] > 0.9
