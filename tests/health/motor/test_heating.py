"""How fast an ESC heats beside the others: against responses that are known exactly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.core.arrays import Array
from mavhums.health.motor.heating import EscHeating
from mavhums.results.verdict import Indicator

RATES = np.array([1.0, 1.2, 0.9, 0.8])  # K/s by the square of a full thrust
TAUS_S = np.array([70.0, 60.0, 80.0, 75.0])


def shares(rates: Array = RATES, taus_s: Array = TAUS_S) -> list[float]:
    rises = rates * taus_s
    return [*(rises / ((rises.sum() - rises) / 3))]


def loads(seconds: int) -> Array:
    """Return the squared thrusts of a flight of hovers and climbs, shape (seconds, 4)."""
    rng = np.random.default_rng(4)
    climbs = np.repeat(rng.uniform(0.7, 1.4, seconds // 15 + 1), 15)[:seconds, None]
    asked: Array = 0.4 * climbs * rng.uniform(0.9, 1.1, (seconds, 4)) * np.array([1.0, 0.8, 1.1, 1.2])
    return asked


def response(
    load: Array, *, rates: Array = RATES, taus_s: Array = TAUS_S, air: float = 15.0, start: float = 15.0
) -> Array:
    """Return the exact response of dT/dt = q·u − (T − T_air)/τ to loads that hold for a second."""
    warmth, now, kept = np.empty_like(load), np.full(load.shape[1], start), np.exp(-1.0 / taus_s)
    for second, asked in enumerate(load):
        settled = air + taus_s * rates * asked
        warmth[second], now = settled + (now - settled) * kept**0.5, settled + (now - settled) * kept
    return warmth


def follow(warmth: Array, load: Array, cuts: tuple[int, ...] = ()) -> EscHeating:
    heating, bounds = EscHeating(), [0, *sorted(cuts), len(load)]
    for a, b in pairwise(bounds):
        for esc, celsius in enumerate(warmth[a:b].T):
            heating.hear(esc, np.arange(a, b, dtype=np.float64) + 0.5, celsius)
        for second in range(a, b):
            heating.add(second, load[second])
    return heating


def shown(heating: EscHeating) -> list[Indicator]:
    return [one for own in heating.indicators([0, 1, 2, 3]) for one in own]


@pytest.mark.parametrize(("air", "start"), [(15.0, 15.0), (-10.0, -10.0), (35.0, 60.0)])
def test_the_share_of_the_heating_is_the_indicator(air: float, start: float) -> None:
    load = loads(400)
    found = shown(follow(np.rint(response(load, air=air, start=start)), load))
    for one, share in zip(found, shares(), strict=True):
        assert one.value.estimate == pytest.approx(share, rel=0.02)
        assert abs(one.value.estimate - share) < one.value.high - one.value.low < 0.1 * share
        assert (one.windows, one.unit) == (6, "1")


def test_one_that_cools_less_is_seen_and_all_alike_are_not() -> None:
    load = loads(400)
    usual = np.array([one.value.estimate for one in shown(follow(response(load), load))])
    hot = shown(follow(response(load, taus_s=TAUS_S * np.array([1, 1, 1.5, 1])), load))
    grown = np.array([one.value.estimate for one in hot]) / usual
    assert grown[2] == pytest.approx(1.5, abs=0.05)
    assert grown[[0, 1, 3]].max() < 1.0
    alike = shown(follow(response(load, rates=1.5 * RATES, air=38.0, start=45.0), load))
    assert np.array([one.value.estimate for one in alike]) / usual == pytest.approx(np.ones(4), abs=0.02)


def test_what_a_flight_does_not_show_has_no_value() -> None:
    load = loads(400)
    warmth = response(load)
    assert shown(follow(warmth[:80], load[:80])) == [], "too short"
    assert shown(follow(np.full_like(warmth, 25.0), load)) == [], "the same throughout"
    assert shown(follow(np.rint(15.0 + (warmth - 15.0) / 40.0), load)) == [], "within a step of the sensor"
    warmth[:, 1] = 25.0
    assert [len(one) for one in follow(warmth, load).indicators([0, 1, 2, 3])] == [1, 0, 1, 1]
    warmth[:, 2] = np.nan
    assert shown(follow(warmth, load)) == [], "of two, nothing says which"


def test_single_damaged_and_missing_readings_change_little() -> None:
    load, rng = loads(400), np.random.default_rng(2)
    warmth = response(load)
    usual = shown(follow(warmth, load))
    warmth[rng.integers(0, 150, 8), rng.integers(0, 4, 8)] = 200.0
    warmth[150:170] = np.nan
    warmth[200:][rng.random((200, 4)) < 0.3] = np.nan
    for one, before in zip(shown(follow(warmth, load)), usual, strict=True):
        assert one.value.estimate == pytest.approx(before.value.estimate, rel=0.03)


@settings(max_examples=8, deadline=None)
@given(st.sets(st.integers(1, 249), max_size=12))
def test_it_does_not_depend_on_how_the_log_is_cut(cuts: set[int]) -> None:
    load = loads(250)
    heating = follow(response(load), load, (*cuts,))
    assert len(shown(heating)) == 4
    assert shown(heating) == shown(follow(response(load), load))
    assert shown(heating) == shown(heating), "asking changes nothing"


@given(
    st.lists(st.tuples(st.floats(-60, 250), st.floats(0, 1), st.integers(1, 200)), min_size=1, max_size=12),
    st.integers(0, 2**32 - 1),
)
def test_any_values_are_borne(steps: list[tuple[float, float, int]], seed: int) -> None:
    rng = np.random.default_rng(seed)
    levels = np.concatenate([np.full((lasts, 2), (celsius, thrust)) for celsius, thrust, lasts in steps])
    warmth = levels[:, :1] + rng.normal(0, rng.choice([0.0, 1.0, 50.0]), (len(levels), 4))
    warmth[rng.random(warmth.shape) < rng.random()] = np.nan
    load = levels[:, 1:] * rng.random((1, 4)) ** 2
    for one in shown(follow(warmth, load)):
        assert 0.0 < one.value.estimate < np.inf
        assert one.value.low < one.value.high
