"""Which rows of a multirotor's flight are judged: take-off, dips, leans, landings and gaps, row by row."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mavhums.core.arrays import Array
from mavhums.health.motor import evidence as e
from mavhums.health.motor.hypotheses import hypotheses_of
from mavhums.vehicle.grid import RATE_HZ
from tests.health.motor.test_hypotheses import QUAD

NOISE_SD = np.array([0.07, 0.07, 0.027])
HOVER = 0.4
AIRBORNE, SETTLED, LANDED, GRACE = (round(seconds * RATE_HZ) for seconds in (4.0, 15.0, 1.4, 0.3))


class Craft:
    """A quad whose rows come one by one."""

    def __init__(self) -> None:
        self.state, self.rules, self.hypotheses = e.new_state(4), e.rules_for(1.0), hypotheses_of(4)

    def fly(self, rows: int, mean: float = HOVER, **how: Any) -> Array:
        """Fly rows alike; return what they show."""
        effort = how.get("effort", np.zeros(3)) @ np.linalg.pinv(QUAD)
        found = np.zeros((rows, e.COLUMNS))
        e.follow(
            np.tile(mean + effort, (rows, 1)),
            np.tile(how.get("rates", np.zeros(3)), (rows, 1)),
            np.full(rows, how.get("upright", 1.0)),
            np.full(rows, how.get("hover", HOVER)),
            np.full(rows, how.get("grounded", False)),
            np.full(rows, how.get("spacing", 1.0)),
            QUAD,
            self.rules,
            self.hypotheses,
            self.state,
            found,
        )
        return found

    def count(self, which: int) -> int:
        return int(self.state.counts[which])


def flown(rows: int, mean: float = HOVER, **how: Any) -> Craft:
    craft = Craft()
    craft.fly(1)  # its thrust answers in the next row
    craft.fly(rows, mean, **how)
    return craft


def test_windows_are_judged_once_it_has_settled_in_the_air() -> None:
    craft = Craft()
    found = craft.fly(1 + SETTLED + 50)
    assert (craft.count(e.ALOFT), craft.count(e.FLOWN)) == (SETTLED + 50, SETTLED + 50)
    assert craft.count(e.JUDGED) == 50
    assert np.flatnonzero(found[:, 6]).tolist() == [*range(SETTLED + 1, SETTLED + 51)]
    assert not found[:, :6].any()


def test_it_lands_where_it_says_so_or_where_the_thrust_stays_below_half() -> None:
    craft = flown(200)
    craft.fly(2, grounded=True)
    assert craft.count(e.ALOFT) == 0
    assert craft.count(e.FLOWN) == 200
    assert np.isnan(craft.state.now[:3]).all()
    for share, rows, lands in ((0.49, LANDED + 1, True), (0.49, LANDED, False), (0.51, LANDED + 1, False)):
        craft = flown(200)
        craft.fly(rows + 1, share * HOVER)
        assert craft.count(e.ALOFT) == (0 if lands else 201 + rows)


def test_a_dip_is_not_judged_and_a_long_one_parts_the_windows() -> None:
    for share, dips in ((0.69, True), (0.71, False)):
        craft = flown(SETTLED + 100)
        before = craft.count(e.JUDGED)
        craft.fly(1, share * HOVER)
        found = craft.fly(10, share * HOVER)
        assert (craft.count(e.JUDGED) == before + 1) is dips
        assert (not found[:, 6].any()) is dips
        craft.fly(LANDED + 5, share * HOVER)
        assert (craft.count(2) == 0) is dips, "the row counter of whole windows"
        assert craft.count(e.ALOFT) == SETTLED + 100 + 1 + 10 + LANDED + 5


@pytest.mark.parametrize(("share", "judged"), [(1.42, 30), (1.44, 0)])
def test_a_climb_far_above_the_thrust_of_a_hover_is_not_judged(share: float, judged: int) -> None:
    craft = flown(SETTLED + 100)
    craft.fly(1, share * HOVER)
    before = craft.count(e.JUDGED)
    craft.fly(30, share * HOVER)
    assert craft.count(e.JUDGED) == before + judged
    assert craft.count(e.ALOFT) == SETTLED + 131


@pytest.mark.parametrize(("rows", "dead"), [(GRACE, 0), (GRACE + 1, AIRBORNE)])
def test_a_lean_is_judged_for_a_moment_and_then_only_after_a_while(rows: int, dead: int) -> None:
    bank = np.cos(np.radians(60))
    craft = flown(SETTLED + 100)
    craft.fly(rows, upright=bank + 0.001)
    assert craft.count(e.TIPPED) == 0
    craft.fly(rows, upright=bank - 0.001)
    assert craft.count(e.TIPPED) == rows
    craft.fly(10, upright=0.7)
    found = craft.fly(AIRBORNE + 20)
    shown = np.flatnonzero(found[:, 6])
    assert shown[0] == max(dead - 1, 0)
    assert len(shown) == AIRBORNE + 20 - shown[0]


@pytest.mark.parametrize("missing", ["upright", "rates", "mean"])
def test_a_gap_parts_the_windows(missing: str) -> None:
    craft = flown(SETTLED + 100)
    judged, aloft = craft.count(e.JUDGED), craft.count(e.ALOFT)
    how: dict[str, Any] = {missing: np.full(3, np.nan) if missing == "rates" else np.nan}
    craft.fly(1, **how)
    assert craft.count(e.ALOFT) == aloft
    # Rows after it: one more without the thrust before it, and a window of 1.4 s that bounds the losses.
    rows = round(1.4 * RATE_HZ) + (missing == "mean")
    craft.fly(rows)
    assert craft.count(e.JUDGED) == judged
    craft.fly(1)
    assert craft.count(e.JUDGED) == judged + 1


def test_the_trim_is_the_mean_of_the_effort_after_the_take_off() -> None:
    effort, half = np.array([0.04, -0.02, 0.01]), AIRBORNE // 2
    craft = Craft()
    craft.fly(1, effort=np.ones(3))
    craft.fly(half, effort=np.ones(3))
    assert np.isnan(craft.state.now[:3]).all()
    craft.fly(1, effort=effort)
    for k in range(1, 30):
        craft.fly(1, 0.4 + 0.005 * k, effort=k * effort)
    # The first row still has the effort before; the mean is over the rows since half of the take-off.
    rows = [np.ones(3), *(max(k, 1) * effort for k in range(29))]
    last = 0.545 + 29 * effort @ np.linalg.pinv(QUAD)
    assert craft.state.now == pytest.approx([*np.mean(rows, axis=0), HOVER, *last])
    assert craft.state.trim[craft.count(0) % 64] == pytest.approx(np.mean(rows, axis=0))
    assert craft.state.effort[craft.count(0) % 64] == pytest.approx(half * np.ones(3) + np.sum(rows, axis=0))


def test_a_loss_is_named_with_its_share_and_its_onset_and_forgotten_on_the_ground() -> None:
    craft = flown(SETTLED + 200)
    shown = craft.fly(12, effort=0.9 * HOVER * QUAD[1])
    first = np.flatnonzero(shown[:, 0])[0]
    assert 1 < first < 8
    assert shown[first:, 0].tolist() == [2.0] * (12 - first)
    assert shown[first:, 2].min() >= craft.rules.threshold
    assert shown[-1, 1] == pytest.approx(12, abs=2)
    assert 0.3 < shown[-1, 4] < shown[-1, 3] < shown[-1, 5] < 0.7
    craft.fly(1, grounded=True)
    assert np.isneginf(craft.state.values).all()


def test_the_effort_of_a_turn_is_learned_less_and_forgotten_slowly() -> None:
    long, effort = round(40.0 * RATE_HZ), np.array([0.04, -0.02, 0.01])
    for rate, weight in ((0.0, 1.0), (0.1, 0.5), (0.3, 0.1)):
        craft = flown(long + AIRBORNE)
        craft.fly(1, effort=effort)
        craft.fly(1, rates=np.array([0.0, 0.0, rate]))
        assert craft.state.now[:3] == pytest.approx(effort * np.array([1.0, 1.0, weight]) / long)


@pytest.mark.parametrize("how", [{"rates": np.full(3, 3e38)}, {"spacing": np.nan}, {"spacing": np.inf}])
def test_a_row_that_nothing_measures_is_not_judged(how: dict[str, Any]) -> None:
    """The largest number of a message is no body rate; the test goes on after it."""
    craft = flown(SETTLED)
    judged = craft.count(e.JUDGED)
    assert not craft.fly(2, **how).any()
    craft.fly(SETTLED)
    assert np.isfinite(craft.state.values).all()
    assert craft.count(e.JUDGED) > judged
