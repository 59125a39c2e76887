"""What the speeds of ESCs say of a loss of thrust: speed goes with the root of thrust, known exactly here."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike

from mavhums.core.arrays import Array
from mavhums.health.motor.speeds import EscSpeeds, SpeedCause, SpeedsBesideThrust
from mavhums.vehicle.grid import RATE_HZ
from tests.present import present

LOST_S = 40.0


def speeds_of(
    seconds: int,
    motors: int,
    halves: Callable[[int, int], ArrayLike],
    *,
    thrust: Callable[[int], ArrayLike] = lambda _: 0.25,
    decided: bool = False,
) -> SpeedsBesideThrust:
    """Return what motors turn at whose speeds in the halves of each second, and whose thrusts, are given."""
    heard = EscSpeeds()
    speeds = SpeedsBesideThrust(heard, tuple(range(1, motors + 1)))
    for second in range(seconds):
        for motor in range(motors):
            own = np.repeat(np.broadcast_to(halves(motor, second), 2), 2) + np.array([0.0, 1.0, 0.0, 1.0])
            heard.hear(motor, second + np.array([0.1, 0.3, 0.6, 0.8]), own)
        asked = np.broadcast_to(thrust(second), (RATE_HZ, motors)).astype(np.float64)
        decided_s = LOST_S + 1.0 if decided and second > LOST_S else None
        speeds.add(second, asked, np.ones(RATE_HZ, dtype=bool), decided_s)
    return speeds


def cause(left: float, *, thrust: float = 0.36, sags: float = 1.0, from_s: int = 0) -> SpeedCause | None:
    """Motor 2 of four keeps a share of its speed from 40 s on, beside a battery that sags."""
    heard, rng = EscSpeeds(), np.random.default_rng(1)
    speeds = SpeedsBesideThrust(heard, (5, 6, 7, 8))
    for second in range(from_s, 60):
        time_s = second + np.arange(10) / 10
        for motor in range(4):
            share = (left if motor == 1 else 1.0) * sags if second >= LOST_S else 1.0
            heard.hear(motor + 4, time_s, -1000.0 * share * (1.0 + 0.001 * rng.standard_normal(10)))
        asked = np.full((RATE_HZ, 4), thrust)
        decided_s = LOST_S + 1.0 if second > LOST_S else None
        speeds.add(second, asked, np.ones(RATE_HZ, dtype=bool), decided_s)
    return speeds.cause(1, LOST_S)


@pytest.mark.parametrize(
    ("left", "thrust", "words"),
    [
        (0.25, 0.36, "its speed collapsed: the ESC"),
        (0.25, 0.95, "its speed collapsed at full output: desynchronisation"),
        (0.8, 0.36, "its speed lags its output (80 % of what its output gave before)"),
        (0.93, 0.36, "its speed lags its output"),
        # Speeds that agree by chance are no better than those of other motors: 0.945 may be 0.954.
        (0.945, 0.36, "its speed follows its output"),
        (0.9395, 0.36, "its speed lags its output"),  # by 0.9 % of a scatter of 2 % in 18 bins: 0.9487
        (1.0, 0.36, "its speed follows its output (100 % of what its output gave before)"),
    ],
)
def test_the_cause_is_where_the_speed_leaves_the_thrust(left: float, thrust: float, words: str) -> None:
    for sags in (1.0, 0.9):
        found = present(cause(left, thrust=thrust, sags=sags))
        assert found.words.startswith(words)
        assert found.ratio == pytest.approx(left, rel=0.005)
        assert (found.start_s, found.end_s) == (40.5, 49.5)  # 0.4 s after the onset, 8 s after the decision


@pytest.mark.parametrize("escs", [(0, 1, 2, 3), (1, 2, 3, 4), (7, 3, 4, 0)])
def test_the_esc_of_a_motor_is_the_one_whose_speed_follows_its_output(escs: tuple[int, ...]) -> None:
    """Motor 2 loses a blade: its output rises, and the speed of its ESC with it, whatever its number."""
    heard, rng = EscSpeeds(), np.random.default_rng(4)
    speeds = SpeedsBesideThrust(heard, (5, 6, 7, 8))
    for second in range(60):
        asked = 0.3 * (1.0 + 0.1 * rng.standard_normal((2, 4)))
        asked[:, 1] *= 1.8 if second >= LOST_S else 1.0
        for half in range(2):
            time_s = second + 0.5 * half + np.array([0.1, 0.3])
            for motor, esc in enumerate(escs):
                heard.hear(esc, time_s, 9000.0 * asked[half, motor] ** 0.5 + np.array([0.0, 1.0]))
            heard.hear(9, time_s, 2000.0 + np.array([0.0, 1.0]))  # of another motor
        rows = np.repeat(asked, RATE_HZ // 2, axis=0)
        speeds.add(second, rows, np.ones(RATE_HZ, dtype=bool), LOST_S + 1.0 if second > LOST_S else None)
    found = present(speeds.cause(1, LOST_S))
    assert found.words.startswith("its speed follows its output")
    assert f"(ESC {escs[1]}, whose speed follows" in found.words
    assert found.ratio == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(("after", "shown"), [(0.0225, True), (0.0199, False)])
def test_a_thrust_of_two_hundredths_is_the_least_that_shows_a_speed(after: float, shown: bool) -> None:
    """Speed goes with the root of thrust down to 0.02; below, the idle of the motor decides it."""

    def thrust(second: int) -> Array:
        return np.array([0.09, 0.09 if second < LOST_S else after, 0.09, 0.09])

    speeds = speeds_of(60, 4, lambda k, second: 900.0 * thrust(second)[k] ** 0.5, thrust=thrust, decided=True)
    found = speeds.cause(1, LOST_S)
    assert (found is not None) is shown
    assert found is None or found.ratio == pytest.approx(1.0, rel=0.005)


def test_too_little_before_or_a_battery_that_collapsed_says_nothing() -> None:
    assert cause(0.8, from_s=31) is None  # 18 half seconds
    assert cause(0.8, from_s=30) is not None
    assert cause(1.0, sags=0.2) is None, "all of them collapsed"


def test_a_loss_that_is_known_late_is_held_against_the_time_before_it() -> None:
    """Only whole half seconds before the onset are usual, and those from 0.4 s after it are new."""

    def halves(motor: int, second: int) -> ArrayLike:
        if motor == 0 and second >= 30:
            return [880.0 if second == 30 else 660.0 if second % 2 else 700.0, 680.0]
        return 900.0 if second % 2 else 1100.0

    found = present(speeds_of(40, 3, halves).cause(0, 30.2))
    assert (found.start_s, found.end_s) == (31.0, 40.0)
    usual = [1100.5, 900.5] * 15
    before = np.mean([*usual, *usual])
    own = np.array([[660.5 if s % 2 else 700.5, 680.5] for s in range(31, 40)]).ravel() / before
    rest = np.repeat([900.5 if s % 2 else 1100.5 for s in range(31, 40)], 2) / before
    assert found.ratio == pytest.approx(np.mean(own / rest), rel=2e-3)


def test_speeds_are_means_of_half_seconds_unless_they_only_repeat_themselves() -> None:
    heard = EscSpeeds()
    heard.hear(0, np.array([0.0, 0.2, 0.5, 0.7, 1.1]), np.array([100.0, -200.0, 300.0, np.nan, 300.0]))
    heard.hear(1, np.array([0.1, 0.3]), np.array([0.0, 0.0]))
    np.testing.assert_equal([heard.at(k, [0, 1]) for k in range(2)], [[150.0, 0.0], [300.0, np.nan]])
    assert np.isnan(heard.at(2, [0])).all(), "a speed that repeats itself is no report"
    for time_s, speeds in (([0.1, 0.2], [100.0, 200.0]), ([0.6], [200.0]), ([1.1, 1.2], [np.nan, -300.0])):
        heard.hear(2, np.array(time_s), np.array(speeds))
    assert [heard.at(k, [2])[0] for k in range(3)] == pytest.approx([150.0, np.nan, 300.0], nan_ok=True)
    heard.hear(1, np.array([1.1]), np.array([0.0]))
    assert heard.at(2, [1]).tolist() == [0.0], "a motor at rest turns alike"
    assert heard.escs_of([1, 2]) == [0, 1]
    assert heard.escs_of([5, 6]) == [0, 1], "numbered as the motors"
    assert heard.escs_of([2, 1]) == [1, 0]
    heard.forget(1, 1)
    assert np.isnan(heard.at(0, [0])).all()
    assert heard.at(1, [0]).tolist() == [300.0]


@pytest.mark.parametrize(("left", "words"), [(0.833, "its speed lags"), (0.836, None)])
def test_a_speed_that_scattered_before_must_lag_by_more(left: float, words: str | None) -> None:
    """Twenty bins 10 % beside their mean scatter by 10.26 %: that of three after it is known to 11.6 %."""

    def halves(motor: int, second: int) -> ArrayLike:
        return 999.5 if motor else [1099.5, 899.5] if second < 10 else 1000.0 * left - 0.5

    found = speeds_of(12, 3, halves).cause(0, 10.0)
    assert (found is None) is (words is None)
    assert found is None or found.words.startswith(words or "")
