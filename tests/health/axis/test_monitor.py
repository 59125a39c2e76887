"""The episodes of an axis, what it shows of them, and what it looks back on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mavhums.core.conditions import Condition
from mavhums.health.axis.detectors import Alarm, AxisInput
from mavhums.health.axis.monitor import _MOST_EPISODES, AxisMonitor, _AxisState
from mavhums.vehicle.grid import RATE_HZ
from tests.health.axis.flights import changes_of, rows, steady

MASKED_S = 20


def alarm(end_s: int, fault: str = "tracking", condition: Condition = "degraded", since_s: int = 0) -> Alarm:
    since_s, rule = since_s or end_s - 1, f"{condition} at {end_s}"
    return Alarm("roll", end_s, fault, condition, since_s, 0.5, 0.4, rule, 0.9)


def episodes(*alarms: Alarm) -> list[tuple[str, int, int, str]]:
    monitor, state = AxisMonitor(1), _AxisState()
    for one in alarms:
        monitor._extend(state, one)
    return [(one.fault, one.since_s, one.end_s, one.rule) for one in state.episodes]


LAST = 10 + 2 * MASKED_S
GRAVE = alarm(11, condition="emergency")
LOSS, LAG = alarm(10, "effectiveness", since_s=5), alarm(15, "slow", since_s=5)


@pytest.mark.parametrize(
    ("alarms", "expected"),
    [
        # Alarms of one fault are one episode until a pause.
        ([alarm(10), alarm(LAST)], [("tracking", 9, LAST, f"degraded at {LAST}")]),
        ([alarm(10), alarm(LAST + 1)], [("tracking", 9, 10, "degraded at 10"), alarm(LAST + 1)]),
        ([alarm(10), alarm(11, "slow")], [alarm(10), alarm(11, "slow")]),
        # An episode keeps the reason of its worst moment.
        ([alarm(10), GRAVE, alarm(12)], [("tracking", 9, 12, "emergency at 11")]),
        ([GRAVE, alarm(12, condition="emergency")], [("tracking", 10, 12, "emergency at 12")]),
        # What first looks like a loss is the beginning of a lag, if it is no emergency and begins with it.
        ([LOSS, LAG], [("slow", 5, 15, "degraded at 15")]),
        ([LOSS._replace(since_s=6), LAG], [LOSS._replace(since_s=6), LAG]),
        ([LOSS._replace(condition="emergency"), LAG], [LOSS._replace(condition="emergency"), LAG]),
        ([LOSS._replace(fault="hard_over"), LAG], [LOSS._replace(fault="hard_over"), LAG]),
    ],
)
def test_alarms_make_episodes(alarms: list[Alarm], expected: list[Alarm | tuple[str, int, int, str]]) -> None:
    shown = [(e.fault, e.since_s, e.end_s, e.rule) if isinstance(e, Alarm) else e for e in expected]
    assert episodes(*alarms) == shown


def test_many_episodes_keep_the_first_and_the_last_ones() -> None:
    apart = 2 * MASKED_S + 2
    found = episodes(*(alarm(apart * k) for k in range(1, _MOST_EPISODES + 2)))
    assert len(found) == _MOST_EPISODES
    kept = [end_s // apart for _, _, end_s, _ in found]
    assert kept == [k for k in range(1, _MOST_EPISODES + 2) if k != _MOST_EPISODES // 2 + 1]


@pytest.mark.parametrize(("share", "missing", "known"), [(0.49, 0, True), (0.51, 0, False), (0.49, 1, False)])
def test_a_second_at_less_than_half_the_speed_of_flight_shows_a_take_off(
    monkeypatch: pytest.MonkeyPatch, share: float, missing: int, known: bool
) -> None:
    made = steady(14)
    made["speed"][2 * RATE_HZ : 3 * RATE_HZ] = share * made["speed"][4 * RATE_HZ]
    made["speed"][2 * RATE_HZ : 2 * RATE_HZ + missing] = np.nan
    made["speed"][9 * RATE_HZ : 10 * RATE_HZ] = 0.0  # in flight: it shows nothing
    flown = rows(made)
    flown.flying[: 4 * RATE_HZ] = False
    flown.flying[-RATE_HZ:] = False
    for block in (1, 5, 14):
        monitor = AxisMonitor(1)
        for begin in range(0, flown.seconds, block):
            list(monitor.feed(flown.cut(begin, min(begin + block, flown.seconds))))
        assert monitor.well("roll") == "unchanged", "without a reference"
        reference = SimpleNamespace(basis=SimpleNamespace(speed=float(flown.speed[4 * RATE_HZ])))
        monkeypatch.setattr(monitor._gains["roll"], "reference", reference)
        assert (monitor.well("roll") == "normal") is known


class Alarming:
    """A detector of alarms that are given."""

    def __init__(self, *alarms: Alarm) -> None:
        self._alarms = alarms

    def feed(self, seen: AxisInput) -> list[Alarm]:
        first, last = seen.rows.second, seen.rows.second + seen.rows.seconds
        return [one for one in self._alarms if first < one.end_s <= last]


def about(axis: str, end_s: int, fault: str = "hard_over", **how: Any) -> Alarm:
    return alarm(end_s, fault, **how)._replace(axis=axis)


def changes_by(*alarms: Alarm, skids: Alarming | None = None) -> list[tuple[str, float, str]]:
    """Return the changes that alarms make of a flight without a reference: axis, onset and condition."""
    monitor: Any = AxisMonitor(1)
    monitor._detectors, monitor._skids, monitor._responses = [Alarming(*alarms)], skids or Alarming(), {}
    for gain in monitor._gains.values():
        gain.feed = lambda rows: []
    return [(one.actuator, one.since_s, one.after) for one in changes_of(monitor, rows(steady(100)))]


@pytest.mark.parametrize(
    ("alarms", "skid_s", "counts"),
    [
        ([about("pitch", 50, "tracking")], 50 + MASKED_S, True),
        ([about("roll", 50)], 50 + MASKED_S, True),
        ([about("pitch", 50, "tracking")], 51 + MASKED_S, False),
        ([about("roll", 50, "effectiveness")], 51, False),
        ([about("pitch", 50), about("roll", 60 + MASKED_S)], 60, False),
        ([about("pitch", 50), about("roll", 61 + MASKED_S)], 60, True),
    ],
)
def test_a_skid_counts_soon_after_the_aircraft_went_astray_and_hides_what_follows(
    alarms: list[Alarm], skid_s: int, counts: bool
) -> None:
    changed = [axis for axis, *_ in changes_by(*alarms, skids=Alarming(about("yaw", skid_s)))]
    assert (("roll" if len(alarms) > 1 else "yaw") in changed) is counts


def test_a_graver_finding_keeps_the_earlier_onset() -> None:
    mild, grave = about("roll", 50, "slow", since_s=48), about("roll", 60, condition="emergency", since_s=55)
    assert changes_by(mild, grave) == [("roll", 48.0, "degraded"), ("roll", 48.0, "emergency")]
