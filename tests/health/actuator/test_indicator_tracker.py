"""One detector followed through a flight: what it decides, reports, suspects, and sums up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from mavhums.health.actuator.detector import Detector
from mavhums.health.actuator.indicator_tracker import IndicatorTracker, evidence_of, indicator_of, suspect_of
from mavhums.health.decision.conditions import IndicatorChange
from mavhums.health.decision.limits import Estimates, Levels
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.least_squares import Fit
from tests.present import present

NOTHING: Mapping[str, Fit] = {}
ERROR = 0.01


class Wear(Detector):
    """A detector that shows the given values; the quantity is normal up to 0.5."""

    fault = "wear"
    quantity = "wear"
    unit = "mm"
    inspect = "everything"

    def __init__(self, levels: Levels | None = None, whole: Estimates | None = None) -> None:
        self.levels = levels or Levels(0.5, 1.0)
        self._whole = whole

    def overall(self, flight: Mapping[str, Fit]) -> Estimates | None:
        return self._whole


class Bias(Wear):
    """The same, of a quantity that is normal near zero."""

    two_sided = True


class Friction(Wear):
    """Of friction the normal episodes are reported, too."""

    fault = "friction"


def one(value: float, error: float = ERROR, freedom: float = 9.0) -> Estimates:
    return Estimates(np.array([value]), np.array([error]), np.array([freedom]))


def tracker(detector: Wear | None = None) -> IndicatorTracker:
    return IndicatorTracker(detector or Wear(), false_alarms=FALSE_ALARMS)


def follow(
    followed: IndicatorTracker, values: Sequence[float], start_s: float = 0.0
) -> dict[int, IndicatorChange]:
    """Feed windows of 10 s that end a second after one another; return the changes by their windows."""
    array = np.array(values, dtype=float)
    end_s = start_s + 10.0 + np.arange(array.size, dtype=np.float64)
    estimates = Estimates(array, np.full(array.size, ERROR), np.full(array.size, 9.0))
    return {**followed.feed(estimates, end_s)}


def test_a_tracker_decides_and_says_from_which_window_on_and_since_when() -> None:
    followed = tracker()
    changes = follow(followed, [0.2] * 30 + [0.7] * 20 + [1.2] * 20)
    onsets = {k: (change.condition, change.since_s) for k, change in changes.items()}
    assert onsets == {0: ("normal", 0.0), 30: ("degraded", 35.0), 52: ("emergency", 55.0)}
    assert changes[30].rule == "degraded: wear reliably above 0.5 mm, with ≤ 1 false alarm per 100 h"
    assert changes[52].rule == "emergency: interval of wear reaches 1 mm, with ≤ 1 false alarm per 100 h"
    assert (followed.decision.condition, followed.decision.since_s) == ("emergency", 55.0)


def test_a_tracker_reports_its_episodes_with_their_peaks_and_limits() -> None:
    followed = tracker(Friction())
    follow(followed, [0.2] * 30 + [0.7] * 10 + [0.8] + [0.7] * 9 + [1.2] * 20)
    found = evidence_of(followed)
    assert {e.kind for e in found} == {"friction"}
    assert [(e.rule.partition(":")[0], e.start_s, e.end_s, e.limit) for e in found] == [
        ("normal", 0.0, 35.0, 0.5),
        ("degraded", 35.0, 55.0, 0.5),
        ("emergency", 55.0, 79.0, 1.0),
    ]
    assert found[-1].value == pytest.approx(1.2)


def test_of_other_faults_only_what_is_wrong_is_reported() -> None:
    followed = tracker()
    follow(followed, [0.2] * 30 + [0.7] * 10 + [0.8] + [0.7] * 19 + [0.2] * 30)
    (found,) = evidence_of(followed)
    assert found.value == pytest.approx(0.8)
    assert (found.kind, found.start_s, found.end_s, found.limit) == ("wear", 35.0, 65.0, 0.5)
    assert found.rule.startswith("degraded")
    assert followed.decision.condition == "normal"


def test_two_sides_count_alike() -> None:
    for sign in (1.0, -1.0):
        followed = tracker(Bias())
        changes = follow(followed, [0.1 * sign] * 30 + [0.7 * sign] * 30)
        assert [change.condition for change in changes.values()] == ["normal", "degraded"]
        suspect = present(suspect_of(followed))
        assert suspect.confidence > 0.99
        assert evidence_of(followed)[0].value == pytest.approx(0.7)
    below = tracker(Wear())
    assert [change.condition for change in follow(below, [-0.7] * 30).values()] == ["normal"]


def test_each_second_is_counted_once_in_the_scatter() -> None:
    """Windows that overlap are not as many windows: every tenth of them is a new one."""
    rng = np.random.default_rng(5)
    values = rng.normal(0.2, 0.05, 300)
    followed = tracker(Wear(whole=one(0.21)))
    assert indicator_of(followed, NOTHING) is None
    for a in range(0, 300, 7):
        follow(followed, values[a : a + 7].tolist(), float(a))
    indicator = present(indicator_of(followed, NOTHING))
    assert indicator.windows == 30
    assert indicator.scatter == pytest.approx(np.std(values[::10], ddof=1))


def test_an_indicator_is_the_whole_flights_with_its_interval_and_limits() -> None:
    followed = tracker(Wear(whole=one(0.21, 0.02, 20.0)))
    follow(followed, [0.2] * 30)
    indicator = present(indicator_of(followed, NOTHING))
    half = stats.t.ppf(0.975, 20.0) * 0.02
    assert indicator.value.estimate == pytest.approx(0.21)
    assert (indicator.value.low, indicator.value.high) == pytest.approx((0.21 - half, 0.21 + half))
    assert (indicator.fault, indicator.quantity, indicator.unit) == ("wear", "wear", "mm")
    assert (indicator.limit, indicator.emergency) == (0.5, 1.0)
    for whole in (None, one(np.nan)):
        silent = tracker(Wear(whole=whole))
        follow(silent, [0.2] * 30)
        assert indicator_of(silent, NOTHING) is None


def test_what_the_whole_flight_shows_ends_no_episode_of_its_windows() -> None:
    """The windows show nothing for six seconds and are normal then; the whole flight is degraded."""
    followed = tracker(Friction(whole=one(0.7)))
    follow(followed, [np.nan] * 6 + [0.2] * 30)
    followed.conclude(NOTHING, 0.0, 46.0)
    spans = [(e.rule.partition(":")[0], e.start_s, e.end_s) for e in evidence_of(followed)]
    assert spans == [("normal", 6.0, 45.0), ("degraded", 0.0, 46.0)]


@given(
    runs=st.lists(
        st.tuples(st.sampled_from([np.nan, 0.2, 0.52, 0.7, 1.2]), st.integers(1, 40)), min_size=1, max_size=12
    ),
    whole=st.sampled_from([np.nan, 0.2, 0.7, 1.2]),
)
def test_no_evidence_ends_before_it_begins(runs: list[tuple[float, int]], whole: float) -> None:
    followed = tracker(Friction(whole=one(whole)))
    values = [value for value, count in runs for _ in range(count)]
    end_s = 10.0 + len(values)
    follow(followed, values)
    followed.conclude(NOTHING, 0.0, end_s)
    assert all(0.0 <= e.start_s <= e.end_s <= end_s for e in evidence_of(followed))
