"""Which of several streams of one signal is used."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mavhums.vehicle.facts import Signal
from mavhums.vehicle.formats.base import angles_of
from mavhums.vehicle.grid import Grid, Seconds
from mavhums.vehicle.signals import (
    _MOVING_RAD_S,
    DERIVED,
    CandidateStream,
    Choice,
    SignalReader,
    body_rates,
)
from tests.present import present
from tests.vehicle.tables import table_of

Array = NDArray[np.float64]
GYRO, ESTIMATE = 0, 1


def angles(time_s: Array) -> Array:
    """Return an attitude that turns on and banks, with a whole turn of the heading each 40 s."""
    yaw = (np.pi + 2 * np.pi * time_s / 40) % (2 * np.pi) - np.pi
    return np.stack([0.6 * np.sin(time_s), 0.1 * np.cos(0.7 * time_s), yaw], axis=1)


def rates(time_s: Array) -> Array:
    """Return the body rates of that attitude, by its analytic derivative."""
    roll, pitch, yaw_rate = 0.6 * np.sin(time_s), 0.1 * np.cos(0.7 * time_s), 2 * np.pi / 40
    roll_rate, pitch_rate = 0.6 * np.cos(time_s), -0.07 * np.sin(0.7 * time_s)
    p = roll_rate - yaw_rate * np.sin(pitch)
    q = pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll)
    r = yaw_rate * np.cos(pitch) * np.cos(roll) - pitch_rate * np.sin(roll)
    return np.stack([p, q, r], axis=1)


def stream(
    name: str, hz: float, *, rank: int = 0, begin: float = 0.0, end: float = 60.0, times: float = 1.0
) -> Signal:
    time_s = np.arange(begin, end, 1 / hz)
    values = times * (angles(time_s) if name == "attitude" else rates(time_s))
    time_us = np.rint(1e6 * time_s).astype(np.int64)
    return Signal(1, name, f"{name}{rank}", time_us // 100 + rank, time_us, values, True, rank)


def used(*streams: Signal) -> Seconds:
    return present(Grid(0).feed(streams, final=True))


def test_attitude_at_10_hz_beats_a_gyro_at_2_hz() -> None:
    found = used(stream("attitude", 10), stream("rates", 2), stream("rates", 10, rank=ESTIMATE))
    assert set(found.ranks["rates"][5:55].tolist()) == {ESTIMATE}
    error = found.signals["rates"][10:50] - rates((np.arange(800) / 20) + 10.0).reshape(40, 20, 3)
    assert np.abs(error).max() < 0.01  # 2 Hz: 0.02


@given(st.sampled_from([4.0, 10.0, 25.0]), st.floats(0.0, 20.0), st.floats(0.0, 20.0))
def test_of_equal_streams_the_first_of_the_table_is_used(hz: float, gyro_s: float, other_s: float) -> None:
    gyro, other = stream("rates", hz, begin=gyro_s), stream("rates", hz, rank=1, begin=other_s)
    assert set(used(stream("attitude", hz), gyro, other).ranks["rates"][35:55].tolist()) == {GYRO}


def test_a_stream_that_dies_is_replaced_and_used_again() -> None:
    parts = [stream("rates", 10, end=30), stream("rates", 10, begin=50, end=90)]
    rest = stream("attitude", 10, end=90), stream("rates", 10, rank=ESTIMATE, end=90)
    by_second = used(*parts, *rest).ranks["rates"]
    assert set(by_second[10:29].tolist()) == {GYRO}
    assert set(by_second[33:50].tolist()) == {ESTIMATE}
    assert set(by_second[65:88].tolist()) == {GYRO}


def test_one_lost_second_changes_nothing() -> None:
    parts = [stream("rates", 10, end=30), stream("rates", 10, begin=30.5), stream("rates", 10, rank=1)]
    assert set(used(*parts, stream("attitude", 10)).ranks["rates"][5:55].tolist()) == {GYRO}


@pytest.mark.parametrize("times", [57.3, -1.0, 0.0])
def test_rates_that_contradict_the_attitude_are_not_used(times: float) -> None:
    found = used(stream("attitude", 10), stream("rates", 25, times=times), stream("rates", 10, rank=ESTIMATE))
    assert set(found.ranks["rates"][10:55].tolist()) == {ESTIMATE}


def test_an_attitude_alone_gives_the_rates() -> None:
    found = used(stream("attitude", 25))
    error = found.signals["rates"][5:55] - rates((np.arange(1000) / 20) + 5.0).reshape(50, 20, 3)
    assert np.abs(error).max() < 0.02


def test_angles_are_interpolated_the_shorter_way_round() -> None:
    time_us = np.arange(0, 4_000_000, 400_000)
    turning = np.array([[3.0 if k % 2 else -3.0, 0.0, 0.0] for k in range(time_us.size)])
    found = used(Signal(1, "attitude", "ATTITUDE", time_us // 1000, time_us, turning))
    roll = found.signals["attitude"][:3, :, 0]
    assert np.abs(roll).min() > 2.9


def test_the_sender_that_came_first_is_used_from_then_on() -> None:
    fields, reader = np.zeros(1, dtype=[("xyz", "f4", 3)]), SignalReader()
    senders = [table_of("vehicle_angular_velocity", fields, component=n) for n in (2, 3)]
    assert [[one.name for one in reader.read({each.name: each})] for each in senders] == [["rates"], []]


def chosen(*spacings: tuple[int, list[float]]) -> list[int]:
    """Return the stream of each second of those that come with these spacings, s, by rank."""
    still = np.zeros((len(spacings[0][1]), 20, 1))
    streams = [CandidateStream(rank, still, still[:, :, 0] + np.c_[values]) for rank, values in spacings]
    ranks: list[int] = Choice(1.2).step(len(still), streams).tolist()
    return ranks


def test_a_stream_is_left_for_one_that_costs_a_fifth_less() -> None:
    """Cost: mean spacing over ten seconds, times 1.5 after the first, times 2.25 of what is derived."""
    for spacing, used in ((0.11, 0), (0.10, 1)):  # 0.2 · 0.8 / 1.5 = 0.107
        assert chosen((0, [0.2] * 3), (1, [1.2, spacing, spacing]))[0] == 0
        assert chosen((0, [0.2] * 30), (1, [1.2] + [spacing] * 29))[-1] == used
    for spacing, used in ((0.08, 0), (0.07, DERIVED)):  # 0.2 · 0.8 / 2.25 = 0.071
        assert chosen((0, [0.2] * 30), (DERIVED, [1.2] + [spacing] * 29))[-1] == used
    lost = chosen((0, [0.2] * 10 + [1.2] * 10), (1, [0.2] * 20))
    assert lost.index(1) == 11  # two of ten: 0.4 · 0.8 > 0.3


def test_an_outage_of_the_whole_link_shows_nothing_about_a_stream() -> None:
    before, outage, after = [0.2] * 10, [1.2] * 10, [1.2] * 10
    lost = chosen((0, before + outage + after), (1, before + outage + [0.2] * 10))
    assert lost.index(1) == 21  # as soon as without the outage: the second silent second of the first stream


@pytest.mark.parametrize(
    ("moving", "agrees", "used"),
    [
        (0.95 * _MOVING_RAD_S, True, 0),  # noise would be compared
        (1.05 * _MOVING_RAD_S, True, 1),
        (1.05 * _MOVING_RAD_S, False, 0),  # where no stream agrees, the attitude is wrong
    ],
)
def test_a_stream_is_doubted_in_motion_where_another_agrees(moving: float, agrees: bool, used: int) -> None:
    length, rows = 200, 20
    values, spacing = np.full((length, rows, 1), moving), np.full((length, rows), 0.2)
    signs = ((0, -1), (1, 1 if agrees else -1), (DERIVED, 1))
    several = [CandidateStream(rank, sign * values, spacing) for rank, sign in signs]
    assert Choice(1.2).step(length, several, several[-1])[-1] == used


def test_body_rates_are_those_of_the_rotation_between_two_attitudes() -> None:
    """Against the rotation vector, also where yaw goes through south; each angle alone and all together."""
    before = np.array([[0.5, 0.3, 3.14], [-1.0, -0.6, -3.14], [0.2, 1.2, 0.0], [0.0, 0.0, 0.0]])
    steps = np.array([[1e-5, -2e-5, 3e-3], [0.0, 0.0, -4e-3], [0.0, 3e-5, 0.0], [1e-5, 0.0, 0.0]])
    steps[:2] = [[0.01, -0.02, 0.02], [-0.01, 0.015, -0.02]]
    after = (before + steps + np.pi) % (2 * np.pi) - np.pi
    first, second = (Rotation.from_euler("ZYX", angles[:, ::-1]) for angles in (before, after))
    expected = (first.inv() * second).as_rotvec() / 0.02
    np.testing.assert_allclose(body_rates(before, after, 0.02), expected, rtol=3e-4, atol=2e-4)


def test_quaternions_become_the_angles_of_the_rotation() -> None:
    angles = np.array([[0.5, 0.3, 3.0], [-2.0, -1.2, -0.7], [1, 0, 0], [0.0, -0.9, 0.0], [0.1, 0.2, -3.0]])
    x, y, z, w = Rotation.from_euler("ZYX", angles[:, ::-1]).as_quat().T
    np.testing.assert_allclose(angles_of(np.column_stack([w, x, y, z])), angles, atol=1e-12)
