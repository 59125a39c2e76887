"""What a second says for a loss or a lag: against the normal density, and against what health explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mavhums.health.axis.evidence import LossTest
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.grid import RATE_HZ
from tests.health.axis.test_pooled import GAIN, REFERENCE

LAGS = 6  # none, 0.3, 0.45, 0.65, 1 and 1.5 s more


def second(
    kept: float, *, lag: int = 0, noise: float = 0.0, drive2: float = 0.05, constant: bool = False
) -> np.ndarray:
    """Return the sums of a second whose response is a share of the gain, at a lag, beside noise.

    At another lag the drive is at right angles. It is balanced, or constant.
    """
    sums = np.zeros((LAGS, 4))
    sums[:, 0], sums[lag, 1] = drive2, kept * GAIN * drive2
    sums[:, 3] = np.sqrt(RATE_HZ * drive2) if constant else 0.0
    sums[:, 2] = (kept**2 + noise) * GAIN**2 * drive2
    return sums


def alarm_s(sums: np.ndarray, limits: AxisLimits | None = None, most_s: int = 300) -> tuple[int, LossTest]:
    """Return after how many such seconds a fault is certain; ``most_s`` if it is not."""
    test = LossTest(REFERENCE, limits or AxisLimits())
    return next((k for k in range(1, most_s) if test.feed(k, sums)), most_s), test


@pytest.mark.parametrize(
    ("kept", "found"), [(1.1, False), (1.0, False), (0.9, False), (0.7, True), (0.0, True)]
)
def test_a_loss_beyond_the_limit_is_found_the_sooner_the_larger_it_is(kept: float, found: bool) -> None:
    delay_s, test = alarm_s(second(kept))
    assert (delay_s < 300) is found
    assert test.lag_s == 0.0
    if found:
        assert delay_s <= alarm_s(second(kept + 0.1))[0]
        assert test.since_s == 0


def test_the_error_of_the_reference_excuses_what_it_explains() -> None:
    """A quarter less at a standard error of 8 % is healthy for 300 s, at 3 % a loss; half is one at both.

    However well its gain is known, the manoeuvres of a reference are others than those of the flight. Once a
    healthy minute has shown the gain, less is no error of the reference.
    """
    for error, kept, found in (
        (0.08, 0.74, False),
        (0.03, 0.74, True),
        (0.08, 0.5, True),
        (0.0, 0.82, False),
    ):
        test = LossTest(replace(REFERENCE, error=error), AxisLimits())
        assert any(test.feed(k, second(kept)) for k in range(1, 300)) is found
    fresh, known = (LossTest(replace(REFERENCE, error=0.08), AxisLimits()) for _ in range(2))
    assert not any(known.feed(k, second(1.0)) for k in range(1, 60))
    delays_s = [next(k for k in range(60, 360) if test.feed(k, second(0.6))) for test in (known, fresh)]
    assert delays_s[0] < delays_s[1]


@pytest.mark.parametrize(("kept", "times", "found"), [(0.72, 1, True), (0.72, 100, False), (0.5, 100, True)])
def test_manoeuvres_beyond_those_of_the_reference_may_lack_some_of_the_gain(
    kept: float, times: int, found: bool
) -> None:
    """A servo is too slow for them, or a surface stalls; a fifth at most, so that half is still a loss."""
    made = second(kept)
    test = LossTest(replace(REFERENCE, error=0.03, largest=made[0, 0] / times), AxisLimits())
    assert any(test.feed(k, made) for k in range(1, 200)) is found


def test_manoeuvres_beyond_those_of_the_reference_exclude_a_loss_later() -> None:
    drive2, cross = second(0.9)[0, :2].tolist()
    tests = [LossTest(replace(REFERENCE, largest=drive2 / times), AxisLimits()) for times in (1, 100)]
    alike, larger = (next(k for k in range(99) if test.excludes(drive2, cross)) for test in tests)
    assert alike < larger


@pytest.mark.parametrize(("explained", "error"), [(0.03, 0.54), (0.62, 0.074), (0.0, np.inf), (1.0, 0.05)])
def test_a_gain_is_known_no_better_than_the_rest_of_the_response_allows(
    explained: float, error: float
) -> None:
    """45 s are 112 independent rows of 0.4 s; a jackknife of nine blocks may be small by chance."""
    covariance = np.diag([(0.05 * GAIN) ** 2, 0.0])
    found = replace(REFERENCE, covariance=covariance, explained=explained).apart
    assert found == pytest.approx(error, rel=0.02)


def test_ten_minutes_of_a_larger_gain_do_not_make_a_smaller_one_a_loss() -> None:
    """Of a standard error of 2 %: 106 % for ten minutes, then 84 % for one; 70 % is still a loss."""
    for kept, found in ((0.84, False), (0.7, True)):
        test = LossTest(replace(REFERENCE, error=0.02), AxisLimits())
        seconds = [1.06] * 600 + [kept] * 60
        alarms = [test.feed(k, second(share)) for k, share in enumerate(seconds)]
        assert any(alarms) is found


def test_a_fault_says_nothing_about_the_error_of_the_reference() -> None:
    """After five minutes of it the next one is found nearly as soon as without it, not in 56 s for 11."""
    delays_s = []
    for lasts_s in (0, 300):
        test = LossTest(replace(REFERENCE, error=0.08), AxisLimits())
        seconds = [1.0] * 60 + [0.3] * lasts_s + [1.0] * 30
        assert not [test.feed(k, second(kept)) for k, kept in enumerate(seconds)][-1]
        delays_s.append(next(k for k in range(1, 300) if test.feed(len(seconds) + k, second(0.6))))
    assert delays_s[1] < 1.5 * delays_s[0]


def test_gusts_excuse_a_loss_as_far_as_their_size_explains_it() -> None:
    """They hide the root of their share beyond the reference's own: 0.2 and 0.95 of the gain."""
    calm, breeze, storm = (alarm_s(second(0.6, noise=noise))[0] for noise in (0.0, 0.14, 1.0))
    assert calm < breeze < 300
    assert storm == 300
    assert alarm_s(second(0.0, noise=0.3))[0] < 300


def test_a_trim_that_nothing_follows_is_a_loss_only_beyond_what_thrust_changes() -> None:
    """Of 1.1 % of the travel, over as many seconds as the filter of slow parts keeps a step, and of 5 %."""
    small, large = (second(0.0, drive2=RATE_HZ * trim**2, constant=True) for trim in (0.011, 0.05))
    assert alarm_s(small, most_s=8)[0] == 8
    assert alarm_s(large)[0] < alarm_s(small)[0]
    assert alarm_s(second(0.0, drive2=RATE_HZ * 0.011**2))[0] < alarm_s(small)[0]


def test_a_lag_is_slow_only_beyond_that_of_the_profile() -> None:
    at = 3
    delay_s, test = alarm_s(second(1.0, lag=at))
    assert delay_s < 30
    assert test.lag_s == 0.65
    assert test.probability(1.0) < 0.05
    assert alarm_s(second(1.0, lag=at), AxisLimits(lag_s=0.7))[0] == 300


def test_more_accepted_false_alarms_find_a_loss_sooner() -> None:
    few, many = (LossTest(REFERENCE, AxisLimits(), rate) for rate in (0.1, 100.0))
    delays_s = [next(k for k in range(1, 300) if test.feed(k, second(0.6))) for test in (many, few)]
    assert delays_s[0] < delays_s[1]


def test_a_loss_ends_as_certainly_as_it_begins() -> None:
    delay_s, test = alarm_s(second(0.5))
    end_s = next(k for k in range(1, 300) if not test.feed(delay_s + k, second(1.0)))
    assert 4 <= end_s <= 3 * delay_s
    assert not test.suspects


def test_a_second_without_a_drive_says_nothing() -> None:
    """An output that does not change, in an answer without any noise."""
    silent = replace(REFERENCE, variance=1e-9)
    still, driven = LossTest(silent, AxisLimits()), LossTest(silent, AxisLimits())
    for k in range(1, 6):
        assert not still.feed(k, second(0.0, drive2=0.0))
        assert still.excludes(0.0, 0.0) == 0
    delays_s = [next(k for k in range(6, 300) if test.feed(k, second(0.5))) for test in (still, driven)]
    assert delays_s[0] == delays_s[1]
    assert still.highest == driven.highest


def test_an_unknown_speed_excuses_a_loss_as_far_as_it_explains_it() -> None:
    """It lets no second exclude a loss of 40 % that a larger speed would hide, either."""
    for kept, found in ((0.75, False), (0.2, True)):
        test = LossTest(REFERENCE, AxisLimits())
        assert any(test.feed(k, second(kept), unknown=0.4) for k in range(1, 300)) is found
    excluded = {}
    for unknown in (0.0, 0.3, 0.7):
        test = LossTest(REFERENCE, AxisLimits())
        excluded[unknown] = sum(test.excludes(0.05, GAIN * 0.05, unknown) for _ in range(30))
    assert excluded == {0.0: 30, 0.3: 30, 0.7: 0}
