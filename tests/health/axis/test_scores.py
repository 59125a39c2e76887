"""Sums over seconds, a lag against a loss, and the evidence of one second: each against its definition."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from mavhums.health.axis.effectiveness import EffectivenessTracker, _late, _ratio, new_tracker
from mavhums.health.axis.reference import STANDARDS, constants
from mavhums.health.axis.regressions import FORMS, Columns, Lag, Shape
from mavhums.health.axis.scores import Pool, Scores, ServoLag
from mavhums.health.axis.thresholds import (
    EXTRA_LAGS_S,
    MANOEUVRE_DEVIATION,
    POOLED_ERROR,
)
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.grid import RATE_HZ
from tests.health.axis.flights import Array, excited, rows, steady
from tests.health.axis.test_pooled import GAIN, REFERENCE
from tests.health.present import present


def test_sums_are_of_usable_rows_without_the_nuisances() -> None:
    rng = np.random.default_rng(1)
    drive, answer, others = rng.normal(size=40), rng.normal(size=40), rng.normal(size=(40, 2))
    good = rng.random(40) > 0.3
    scores = Scores(np.array([0.5, -2.0]), 1e12)  # the memory never ends: nothing is slow
    sums = scores.feed(Columns(drive, others, answer, good))
    left = answer - others @ [0.5, -2.0]
    for second in range(2):
        at = slice(second * RATE_HZ, (second + 1) * RATE_HZ)
        d, y = drive[at][good[at]], left[at][good[at]]
        found = [
            float(getattr(sums, name)[second]) for name in ("drive2", "cross", "answer2", "driven", "raw")
        ]
        assert found == pytest.approx([d @ d, d @ y, y @ y, d.sum(), y.sum()])
        assert sums.count[second] == len(d)


def by_lag(*lags: tuple[float, float]) -> Array:
    """Return a second's sums: by lag the share of the response that it explains, and the gain it leaves."""
    sums = np.tile([1.0, 0.0, 1.0], (1 + len(EXTRA_LAGS_S), 1))
    for k, (share, gain) in enumerate(lags):
        drive2 = share / (gain * GAIN) ** 2
        sums[k] = drive2, gain * GAIN * drive2, 1.0
    return sums


def test_a_lag_is_a_slow_servo_where_it_explains_much_more_and_leaves_the_gain() -> None:
    loss = (0.5, 0.4)

    def slow(share: float, gain: float, count: int = 7, after: ServoLag | None = None) -> Any:
        return (after or ServoLag()).feed([by_lag(loss, (0.3, 1.0), (share, gain))] * count, GAIN)

    second = EXTRA_LAGS_S[1]
    assert slow(0.9, 1.0, count=6) == (None, False), "a single manoeuvre shows no lag"
    assert slow(0.54, 1.0) == (None, False)
    assert slow(0.56, 1.0) == (None, True)
    assert slow(0.64, 1.0) == (None, True)
    assert slow(0.66, 1.0) == (second, True)
    assert slow(0.66, 0.76) == (second, True)
    assert slow(0.66, 0.74) == (None, True)
    for share, gain, stays in ((0.56, 0.61, True), (0.56, 0.59, False), (0.54, 1.0, False)):
        slowness = ServoLag()
        slow(0.66, 0.76, after=slowness)
        assert slow(share, gain, after=slowness) == (second if stays else None, share > 0.55)
        assert slowness.lag == 2, "the lag that explained more so far"
    none = ServoLag()
    slow(0.54, 1.0, after=none)
    assert none.lag == 0


def test_a_lag_under_which_nothing_was_driven_explains_nothing() -> None:
    still = by_lag((0.5, 0.4))
    still[1] = 0.0
    assert ServoLag().feed([still] * 7, GAIN) == (None, False)


def test_a_second_weighs_the_loss_by_its_likelihood() -> None:
    """Its score is normal about −λ·K·drive², with the variance of the reference and of the manoeuvre."""
    for score, drive2 in ((0.3, 0.5), (-0.8, 0.5), (-0.8, 2.0)):
        lost = 0.4 * GAIN
        variance = (REFERENCE.variance + (MANOEUVRE_DEVIATION * GAIN) ** 2 * drive2) * drive2
        loss, whole = (norm.logpdf(score, mean, variance**0.5) for mean in (-lost * drive2, 0.0))
        assert _ratio(score, drive2, REFERENCE, 0.4) == pytest.approx(loss - whole)


def test_the_loss_to_detect_is_twice_that_of_the_profile() -> None:
    for degraded, loss in ((0.8, 0.4), (0.7, 0.6)):
        tracker = new_tracker("pitch", AxisLimits(effectiveness_degraded=degraded))
        assert (tracker._standards.loss, tracker._standards.full) == (loss, 1.0 - loss / 2.0)
        assert tracker._standards.error == STANDARDS["pitch"].error
    assert new_tracker("pitch")._standards == STANDARDS["pitch"]


@pytest.mark.parametrize(("axis", "column"), [("roll", 0), ("steering", 2)])
@pytest.mark.parametrize(("delay", "tau_s"), [(0, 0.0), (4, 0.1), (6, 0.2)])
def test_a_reference_finds_the_delay_and_the_lag(axis: str, column: int, delay: int, tau_s: float) -> None:
    flight, demand = steady(60), excited(60)
    flight["outputs"][:, column] = demand
    late = np.concatenate([np.zeros(delay), Lag(tau_s).feed(demand)])[: len(demand)]
    flight["yaw_rate" if axis == "steering" else "roll_rate"] = 2.0 * late
    tracker = EffectivenessTracker(FORMS[axis], STANDARDS[axis])
    tracker.feed(rows(flight))
    assert present(tracker.reference).shape == Shape(delay, tau_s)
    assert present(tracker.reference).gain == pytest.approx(2.0)


def test_demands_are_as_late_as_the_columns_of_a_shape() -> None:
    demand = np.arange(12.0)[:, None]
    found = _late(demand, Shape(2, 0.0))[:, 0]
    assert np.isnan(found[:6]).all()
    assert found[6:].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_pooled_seconds_are_the_fewest_that_are_certain_or_all_of_them() -> None:
    pool = Pool(REFERENCE, 60)
    assert pool.fewest() is None
    assert pool.whole() is None
    for k in range(60):
        pool.add(1.0, (0.5 if k < 40 else 1.0) * GAIN)
        if k == 8:
            assert pool.whole() is None, "a window has ten seconds"
        if k == 9:
            assert pool.whole() is not None
    n, latest = pool.fewest() or (0, None)
    whole = pool.whole()
    assert n == 10
    assert latest is not None
    assert whole is not None
    assert (latest.estimate, whole.estimate) == pytest.approx((1.0, 2 / 3))
    assert latest.high - latest.estimate == pytest.approx(latest.estimate - latest.low)
    assert latest.high - latest.estimate <= 1.96 * POOLED_ERROR
    pool.clear()
    assert pool.whole() is None


def test_constants_have_the_error_of_a_jackknife_over_blocks() -> None:
    """Of a mean of blocks whose length is one: the standard error of that mean."""
    answer = np.array([1.0, 2.0, 4.0, 8.0, 3.0, 5.0, 9.0, 7.0, 6.0])
    form: Any = FORMS["roll"]
    # K = −1 is fitted exactly in rows that another column marks; b is the mean of the rest.
    design = np.zeros((18, 3))
    design[:9, 1] = 1.0
    design[9:, 0] = np.arange(1.0, 10.0)
    response = np.append(answer, -np.arange(1.0, 10.0))
    order = np.arange(18).reshape(2, 9).T.ravel()  # one row of each kind in every block of two
    found = constants(form, 18.0, design[order], response[order])
    assert found["hard_over"].value == pytest.approx(answer.mean())
    assert found["hard_over"].error == pytest.approx(answer.std(ddof=1) / 3.0)
    assert constants(FORMS["yaw"], 18.0, design, response) == {}
