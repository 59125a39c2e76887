"""How much each rotor shakes the aircraft: against forces that are known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.core.arrays import Array
from mavhums.health.motor.vibration import RotorVibration, squared_motions
from mavhums.vehicle.grid import RATE_HZ

RADII = np.array([8e-6, 3e-6])


def turning(time_s: Array, hertz: Array, *, noise: float = 0.0) -> Array:
    """Return the force of rotors of these radii that turn at constant speeds, and of their blades."""
    speed = 2 * np.pi * hertz
    phase = speed * time_s[:, None] + np.array([1.0, 4.0])
    pull = RADII * speed**2
    across = np.stack([pull * np.cos(phase), pull * np.sin(phase), 5.0 * np.cos(2 * phase)], axis=2)
    own: Array = across.sum(axis=1) + np.array([0.1, 0.2, -9.8])
    own += np.random.default_rng(2).normal(0.0, noise, own.shape)
    return own


@pytest.mark.parametrize(
    ("rate_hz", "hertz"),
    [
        (1000.0, (92.0, 85.0)),
        (1000.0, (92.0, 89.0)),
        (200.0, (92.0, 85.0)),
        (200.0, (132.0, 121.0)),  # seen at 68 and 79 Hz, their blades' passing at 64 and 42 Hz
        (333.0, (192.0, 181.0)),
    ],
)
def test_a_rotor_moves_the_aircraft_by_its_radius_at_any_speed(
    rate_hz: float, hertz: tuple[float, float]
) -> None:
    time_s = 7.0 + np.arange(0.0, 0.5, 1 / rate_hz)
    speeds = np.tile(hertz, (time_s.size, 1))
    exact, _ = squared_motions(time_s, turning(time_s, np.array(hertz)), speeds)
    assert np.sqrt(exact) == pytest.approx(RADII, rel=0.02)
    squares, noise = squared_motions(time_s, turning(time_s, np.array(hertz), noise=2.0), speeds)
    assert (squares - noise) == pytest.approx(RADII**2, abs=5 * np.sqrt(noise.max() * RADII[0] ** 2))


@pytest.mark.parametrize(
    ("rate_hz", "hertz"),
    [
        (1000.0, (92.0, 91.5)),  # half a second tells no lines apart that are half a hertz apart
        (200.0, (92.0, 108.0)),  # its image
        (200.0, (60.0, 130.0)),  # its image has the place of the first one's blades
        (100.0, (99.8, 100.2)),  # both stand still
    ],
)
def test_rotors_whose_lines_coincide_have_no_value(rate_hz: float, hertz: tuple[float, float]) -> None:
    time_s = np.arange(0.0, 0.5, 1 / rate_hz)
    squares, _ = squared_motions(time_s, turning(time_s, np.array(hertz)), np.tile(hertz, (time_s.size, 1)))
    assert np.isnan(squares).any()
    assert (np.isnan(squares) | (np.abs(np.sqrt(squares) / RADII - 1.0) < 0.1)).all()


def test_noise_alone_has_the_square_that_it_is_said_to_have() -> None:
    rng, time_s = np.random.default_rng(1), np.arange(0.0, 0.5, 1e-3)
    speeds = np.tile([92.0, 80.0], (500, 1))
    found = np.array([squared_motions(time_s, rng.normal(0, 1, (500, 3)), speeds) for _ in range(400)])
    squares, noises = found[:, 0], found[:, 1] * 3.0 / 2.0  # by three axes, where a rotor has two
    assert squares.mean(axis=0) == pytest.approx(noises.mean(axis=0) / 1.5, rel=0.1)


def flight(cuts: list[int], *, pace: float = 1.0, silent: bool = False, seconds: int = 60) -> RotorVibration:
    """Two rotors whose speeds swing slowly, heard in blocks that end at these tenths of a second."""
    vibration = RotorVibration()
    time_s = np.arange(0.0, seconds, 1e-3)
    swing = 0.5 * pace**2 * np.stack([np.sin(pace * time_s), np.cos(pace * time_s)], axis=1)
    hertz = np.array([90.0, 82.0]) + swing
    phase = 2 * np.pi * hertz.cumsum(axis=0) * 1e-3
    pull = RADII * (2 * np.pi * hertz) ** 2
    plane = np.stack([pull * np.cos(phase), pull * np.sin(phase), 0 * pull], axis=2).sum(axis=1)
    for a, b in zip([0, *cuts], [*cuts, 10 * seconds], strict=True):
        rows = slice(100 * a, 100 * b)
        vibration.hear_force("ACC", time_s[rows], plane[rows])
        for esc in range(2 - silent):
            vibration.hear_speed(esc, time_s[rows][::100], 60.0 * hertz[rows][::100, esc])
        for second in range(a // 10, b // 10):
            vibration.add(second, np.ones(RATE_HZ, dtype=bool))
    return vibration


def test_the_radius_is_the_indicator_in_micrometres() -> None:
    indicators = flight([]).indicators([0, 1])
    assert [one.value.estimate for (one,) in indicators] == pytest.approx([8.0, 3.0], rel=0.03)
    assert [one.windows for (one,) in indicators] == [23, 23]  # blocks of 2.5 s; the last second is not whole


def test_a_motor_without_a_speed_or_with_one_that_swings_too_fast_has_none() -> None:
    assert [len(one) for one in flight([], silent=True).indicators([0, 1])] == [1, 0]
    assert flight([], pace=6.0).indicators([0, 1]) == [(), ()]


@settings(max_examples=5, deadline=None)
@given(st.sets(st.integers(1, 599), max_size=12))
def test_it_does_not_depend_on_how_the_log_is_cut(cuts: set[int]) -> None:
    vibration = flight(sorted(cuts))
    assert vibration.indicators([0, 1]) == flight([]).indicators([0, 1])
    assert vibration.indicators([0, 1]) == vibration.indicators([0, 1]), "asking changes nothing"
