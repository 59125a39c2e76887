"""Airspeed, as vehicles report it and as the wind triangle gives it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.log import Table
from mavhums.vehicle.airspeed import Airspeeds, Current, WindTriangle
from tests.vehicle.tables import table_of

SECOND = 1_000_000


def reported(*speeds: float, first_s: int = 0, vehicle: int = 1) -> dict[str, Table]:
    """Return reports of the airspeed, one a second."""
    fields = np.array([(speed,) for speed in speeds], dtype=[("airspeed", "f4")])
    time_us = (first_s + np.arange(len(speeds))) * SECOND
    return {"VFR_HUD": table_of("VFR_HUD", fields, time_us=time_us, system=vehicle)}


def test_an_airspeed_holds_three_seconds_and_none_is_below_zero() -> None:
    airspeeds = Airspeeds()
    airspeeds.feed(reported(20.0, np.nan, -1.0, 0.0))
    ends = np.array([0, 3, 4, 6]) * SECOND + np.array([-1, -1, 0, 1])
    np.testing.assert_array_equal(airspeeds.at(1, ends), [np.nan, 20.0, 0.0, np.nan])
    airspeeds.feed(reported(25.0, first_s=10))
    np.testing.assert_array_equal(airspeeds.at(1, np.array([9, 10, 13]) * SECOND), [np.nan, 25.0, 25.0])


def test_each_actuator_asks_for_all_of_a_block_and_a_minute_before_it() -> None:
    airspeeds = Airspeeds()
    airspeeds.feed(reported(*np.arange(200.0)))
    airspeeds.feed(reported(*np.arange(200.0), vehicle=2))
    for _ in range(2):
        np.testing.assert_array_equal(airspeeds.at(1, np.arange(200) * SECOND), np.arange(200.0))
    airspeeds.feed(reported(200.0, 201.0, first_s=200))
    np.testing.assert_array_equal(airspeeds.at(1, np.arange(139, 202) * SECOND), np.arange(139.0, 202.0))
    assert np.isnan(airspeeds.at(1, np.array([138 * SECOND]))[0]), "forgotten"
    np.testing.assert_array_equal(airspeeds.at(2, np.array([3, 130]) * SECOND), [3.0, 130.0])
    assert airspeeds.at(1, np.array([], dtype=np.int64)).size == 0


def test_a_current_is_known_beside_a_slip_out_of_turns_and_an_error_of_the_compass() -> None:
    """The boat changes its speed as well, and some of its reports are not finite."""
    current, yaw_rate, rng = Current(), 0.08, np.random.default_rng(3)
    for k in range(240):
        way, speed = yaw_rate * (k if k < 120 else 240 - k), rng.uniform(0.5, 3.0)
        turn = yaw_rate if k < 120 else -yaw_rate
        ahead, across = np.array([np.cos(way), np.sin(way)]), np.array([-np.sin(way), np.cos(way)])
        velocity = speed * ahead - 0.5 * turn * across + np.array([0.4, -0.3])
        current.step(velocity, way + 0.1, turn)
        current.step(velocity * np.nan, way, turn)
        current.step(velocity, way, np.nan)
    assert current.velocity == pytest.approx([0.4, -0.3], abs=0.02)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.floats(-1e4, 1e4)] * 2, st.floats(-7.0, 7.0), st.floats(-40.0, 40.0)), max_size=40
    )
)
def test_no_velocity_ends_the_estimates(reports: list[tuple[float, float, float, float]]) -> None:
    triangle, current = WindTriangle(), Current()
    for north, east, heading, yaw_rate in reports * 3:
        triangle.step(np.array([north, east]), heading)
        current.step(np.array([north, east]), heading, yaw_rate)
    assert np.isfinite([*triangle.wind, *current.velocity]).all()
