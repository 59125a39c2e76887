"""Conditions of an actuator from its indicators, and their reasons, suspects and order."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

from mavhums.health.decision.conditions import ConditionTracker, Episode, Episodes, IndicatorChange, since
from tests.present import present


def test_only_friction_makes_normal_and_onsets_follow_each_other() -> None:
    tracker = ConditionTracker(1, "elevator")
    assert tracker.take("backlash", IndicatorChange("normal", 1.0, "play"), 20.0) is None
    assert tracker.condition == "undecided"
    found = present(tracker.take("friction", IndicatorChange("normal", 5.0, "friction"), 20.0))
    # The play was normal before; the friction decides.
    assert (found.after, found.since_s, found.fault) == ("normal", 5.0, "friction")
    found = present(tracker.take("backlash", IndicatorChange("degraded", 2.0, "play"), 20.0))
    assert (found.since_s, found.rule, tracker.since_s) == (5.0, "play", 5.0)
    assert tracker.take("friction", IndicatorChange("degraded", 7.0, "friction"), 20.0) is None
    assert tracker.take("jam", IndicatorChange("degraded", 9.0, "jam"), 20.0) is None
    assert not tracker.jammed
    found = present(tracker.take("jam", IndicatorChange("emergency", 12.0, "jam"), 20.0))
    assert (tracker.jammed, found.before, tracker.worst) == (True, "degraded", "emergency")
    found = present(tracker.take("jam", IndicatorChange("normal", 20.0, "jam"), 20.0))
    # What remains is the play, which is older than the friction; not before the jam's own onset.
    assert (found.after, found.fault, found.since_s) == ("degraded", "backlash", 12.0)
    assert (tracker.condition, tracker.worst) == ("degraded", "emergency")


def test_a_window_that_disagrees_counts_towards_the_peak_of_what_follows() -> None:
    episodes = Episodes()
    episodes.extend(0.7, 9.0, agrees=False)
    episodes.begin_decided("degraded", 5.0, 10.0, 0.5)
    assert [*episodes] == [Episode("degraded", 5.0, 10.0, 0.7)]
    for value, agrees, peak in (
        (0.6, True, 0.7),
        (0.9, False, 0.7),
        (0.8, True, 0.9),
        (1.2, True, 1.2),
        (2.0, False, 1.2),
    ):
        episodes.extend(value, 20.0, agrees=agrees)
        assert [*episodes] == [Episode("degraded", 5.0, 20.0, peak)]
    episodes.begin_decided("emergency", 18.0, 22.0, 1.5)
    episodes.begin_decided("normal", 21.0, 23.0, 0.1)
    spans = [(one.condition, one.start_s, one.end_s) for one in episodes]
    assert spans == [("degraded", 5.0, 18.0), ("emergency", 18.0, 21.0), ("normal", 21.0, 23.0)]
    assert [one.peak for one in episodes] == [1.2, 2.0, 0.1]


def test_of_more_than_a_hundred_episodes_the_first_and_the_last_fifty_stay() -> None:
    episodes = Episodes()
    for k in range(130):
        episodes.begin(Episode("degraded", float(k), k + 5.0, 1.0))
    assert [one.start_s for one in episodes] == [*range(50), *range(80, 130)]
    assert [one.end_s for one in episodes][-2:] == [129.0, 134.0]


def test_an_onset_has_its_date_in_universal_time() -> None:
    start = datetime(2026, 3, 1, 23, 59, 58, tzinfo=timezone(timedelta(hours=1)))
    assert since(None, start) is None
    shown = present(since(62.34567, start))
    assert (shown.flight_time_s, shown.utc) == (62.346, "2026-03-01T23:01:00.345670+00:00")
