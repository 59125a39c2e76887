"""The airspeed, and a sensor that begins to lie, against flights in a known wind."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.vehicle.airspeed import AirspeedCheck, Speed
from mavhums.vehicle.grid import RATE_HZ

Array = NDArray[np.float64]

AIRSPEED = 18.0
WIND = np.array([4.0, -3.0])


def circling(
    seconds: int, scale: Array, *, turn_s: float = 40.0, noise: float = 0.3, climb: float = 0.0
) -> dict[str, Array]:
    """Circles at one airspeed in one wind; the sensor reads ``scale``, shape (seconds,), times the truth.

    After a minute it climbs and dives by turns, at up to ``climb`` m/s.
    """
    t = np.arange(seconds * RATE_HZ) / RATE_HZ
    heading = (2 * np.pi * t / turn_s + np.pi) % (2 * np.pi) - np.pi
    down = np.where(t > 60, climb * np.sin(2 * np.pi * t / 25.0), 0.0)
    level = np.sqrt(AIRSPEED**2 - down**2)[:, None]
    velocity = level * np.column_stack([np.cos(heading), np.sin(heading)]) + WIND
    random = np.random.default_rng(4)
    sensed = AIRSPEED * np.repeat(scale, RATE_HZ) + noise * random.normal(size=t.size)
    attitude = np.column_stack([np.zeros((t.size, 2)), heading])
    ground = np.hypot(*velocity.T)
    velocity = np.column_stack([velocity, down])
    columns = {"velocity": velocity, "attitude": attitude, "airspeed": sensed, "groundspeed": ground}
    columns["airspeed sensor"] = np.full(t.size, np.nan)
    return {name: np.asarray(values).reshape(seconds, RATE_HZ, -1) for name, values in columns.items()}


def in_pieces(whole: dict[str, Array], *cuts: int) -> list[Array]:
    """Return speed, trust, settled and source of a flight that comes in pieces of whole seconds."""
    speed, edges = Speed(), itertools.pairwise((0, *cuts, None))
    parts = [speed.feed({name: values[a:b] for name, values in whole.items()}) for a, b in edges]
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def trusted(scale: Array, **how: float) -> list[bool]:
    """Whether the speed is trusted, second by second."""
    _, flags, _, _ = Speed().feed(circling(len(scale), scale, **how))
    return [bool(flag) for flag in flags[::RATE_HZ]]


@pytest.mark.parametrize("factor", [0.8, 1.25, 1.5])
def test_a_sensor_that_begins_to_lie_is_noticed_within_ten_seconds(factor: float) -> None:
    found = trusted(np.where(np.arange(240) < 180, 1.0, factor))
    assert all(found[:180])
    assert not any(found[190:])


def test_a_sensor_that_always_reads_too_much_is_trusted() -> None:
    assert all(trusted(np.full(240, 1.15)))


def test_a_sensor_that_dies_is_doubted_at_once_and_its_return_is_noticed() -> None:
    scale = np.ones(400)
    scale[180:240] = 0.0
    found = trusted(scale)
    assert all(found[:180])
    assert not any(found[181:240])
    assert all(found[300:])


def test_a_sensor_that_never_worked_takes_nothing_away() -> None:
    speed, flags, settled, source = Speed().feed(circling(200, np.zeros(200)))
    assert not settled[:RATE_HZ].any()
    assert settled[60 * RATE_HZ :].all(), "turns settle the wind"
    assert flags.all()
    assert (source == 1).all()
    assert speed[-20:] == pytest.approx(AIRSPEED, rel=0.05)


def test_the_estimate_of_an_autopilot_without_a_sensor_is_not_used() -> None:
    """It says so now and then, and from 150 s on it has a sensor again."""
    whole = circling(200, np.full(200, 0.6))
    whole["airspeed sensor"][3], whole["airspeed sensor"][150] = 0.0, 1.0
    speed, _, settled, source = Speed().feed(whole)
    without = np.repeat((np.arange(200) >= 3) & (np.arange(200) < 150), RATE_HZ)
    assert np.array_equal(source == 1, without)
    assert settled[60 * RATE_HZ :].all()
    assert speed[100 * RATE_HZ : 150 * RATE_HZ] == pytest.approx(AIRSPEED, rel=0.05)
    assert np.array_equal(in_pieces(whole, 4, 100, 151)[0], speed)


def test_climbs_and_dives_are_no_lie_and_do_not_change_the_airspeed() -> None:
    """At 14 m/s down the level part of 18 m/s is 11: without it the sensor would read 60 % too much."""
    assert all(trusted(np.ones(400), climb=14.0))
    speed, _, _, source = Speed().feed(circling(400, np.zeros(400), climb=14.0))
    assert (source == 1).all()
    assert speed[120 * RATE_HZ :] == pytest.approx(AIRSPEED, rel=0.12)


def trusted_at(check: AirspeedCheck, speed: float, seconds: int) -> list[bool]:
    """Return whether a sensor that reads this speed is trusted in each second; no two readings are equal."""
    return [check.step(speed * (1.0 + 1e-9 * k), 18.5, settled=True) for k in range(seconds)]


@pytest.mark.parametrize(
    ("change", "doubted_s"),
    [(0.207, 5), (0.191, 8), (-0.157, 10), (0.157, 10), (0.143, 21), (0.104, 29), (0.0953, None)],
)
def test_the_smaller_the_change_the_longer_it_takes_to_doubt(change: float, doubted_s: int | None) -> None:
    check = AirspeedCheck()
    assert all(trusted_at(check, 18.0, 60))
    trusted = trusted_at(check, 18.0 * np.exp(change), 60)
    assert (trusted.index(False) + 1 if doubted_s else None) == doubted_s
    assert doubted_s or all(trusted)


def test_doubt_ends_only_after_half_a_minute_well_below_its_limit() -> None:
    """The mean over 30 s: 0.09 is too much, 0.07 is not."""
    check = AirspeedCheck()
    assert all(trusted_at(check, 18.5, 60))

    def trusted(change: float, seconds: int) -> list[bool]:
        return trusted_at(check, 18.5 * np.exp(change), seconds)

    assert trusted(0.25, 30) == [True] * 4 + [False] * 26
    assert not any(trusted(0.09, 60))
    assert trusted(0.07, 40)[-1] is True


@pytest.mark.parametrize(("alive_s", "doubted"), [(19, False), (20, True)])
def test_only_a_sensor_that_was_alive_for_twenty_seconds_can_die(alive_s: int, doubted: bool) -> None:
    check = AirspeedCheck()
    assert all(trusted_at(check, 18.0, alive_s))
    assert check.step(5.0, 18.5, settled=True) is not doubted


def test_a_sensor_that_repeats_one_number_while_the_airspeed_changes_is_not_trusted() -> None:
    check = AirspeedCheck()
    assert all(trusted_at(check, 18.0, 60))
    speeds = 18.5 - 0.5 * np.arange(1, 7)
    assert [check.step(18.0, speed, settled=False) for speed in speeds] == [True] * 4 + [False] * 2
    assert check.step(17.9, 16.0, settled=False)
    coarse = AirspeedCheck()
    assert all(coarse.step(18.0, speed, settled=True) for speed in (18.9, 17.1, 18.2) * 20)


def test_gusts_are_no_lie() -> None:
    gusts = 1.0 + 0.12 * np.sin(2 * np.pi * np.arange(400) / 7.0)
    assert all(trusted(gusts))


def test_nothing_is_compared_with_a_wind_that_is_not_known() -> None:
    """On one heading airspeed and wind look alike: the usual ratio is not learned there."""
    assert all(trusted(np.where(np.arange(240) < 120, 1.0, 1.25), turn_s=1e9))


def test_the_check_is_indifferent_to_the_ground() -> None:
    check = AirspeedCheck()
    assert all(check.step(99.0, 8.0, settled=True) for _ in range(300)), "too slow to show anything"
    assert all(check.step(np.nan, 18.0, settled=True) for _ in range(300))


def test_the_pieces_do_not_matter() -> None:
    scale = np.where(np.arange(240) < 150, 1.0, 1.3)
    whole = circling(240, scale)
    _, _, settled, source = expected = Speed().feed(whole)
    assert settled.all(), "a sensor needs no turns"
    assert (source == 0).all()
    for found, known in zip(in_pieces(whole, 1, 97, 153), expected, strict=True):
        assert np.array_equal(found, known)
