"""One actuator through a flight: windows, changes, the actuator's own baseline, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.core.quantities import column
from mavhums.engine.events import Event
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.events import ConditionChanged, Indication, Window
from mavhums.learn import default_model
from mavhums_sim import Flight, fly
from mavhums_sim.conditions import Condition
from tests.health.flown import Telemetry, actuator_of, flown, sensed, telemetry, watch
from tests.present import present

Array = NDArray[np.float64]


def data_sheet(friction: float, *, seconds: float = 30.0, rate_hz: float = 100.0) -> Telemetry:
    """The elevator of the paper's single-mass model."""
    flight = Flight(41, seconds, {"elevator": (friction, friction)}, rate_hz=rate_hz)
    return telemetry(sensed(fly(flight)))


def windows_of(events: Iterable[Event]) -> list[Window]:
    return [event for event in events if isinstance(event, Window)]


def test_what_is_found_is_held_through_standstill() -> None:
    seen = data_sheet(1.0)
    seen.values[seen.time_s > 18.0, 6] = 0.0
    events, findings = watch(seen)
    assert windows_of(events)[-1].friction_nm is None
    assert windows_of(events)[-1].condition == "emergency"
    assert findings.condition == "emergency"
    assert findings.coverage.decidable < findings.coverage.windows
    assert findings.friction is not None
    first, last = windows_of(events)[0].moving_fraction, windows_of(events)[-1].moving_fraction
    assert last == 0.0
    assert 0.4 < first < 1.0
    assert findings.coverage.moving_fraction == pytest.approx(18 / 30 * first, abs=0.1)


def test_seconds_without_samples_end_no_window_twice() -> None:
    seen = data_sheet(0.3)
    there = (seen.time_s < 12.0) | (seen.time_s > 16.0)
    events, findings = watch(Telemetry(seen.time_s[there], seen.values[there]))
    ends = [window.end_s for window in windows_of(events)]
    assert ends == sorted(set(ends))
    assert findings.condition == "normal"


def test_an_interval_wider_than_the_limits_are_apart_decides_nothing() -> None:
    seen = data_sheet(0.3)
    seen.values[:, 4] += np.random.default_rng(0).normal(0.0, 0.8, seen.time_s.size)
    events, findings = watch(seen)
    windows = windows_of(events)
    assert findings.coverage.decidable < len(windows)
    assert all(w.friction_nm is None or w.friction_nm.high - w.friction_nm.low <= 0.6 for w in windows)


def test_a_change_says_what_changed_it_and_since_when() -> None:
    record = flown(Condition.step("backlash", 0.3, 40.0), rate_hz=25.0, seconds=80.0)
    events, findings = watch(telemetry(record))
    first, last = [e for e in events if isinstance(e, ConditionChanged)]
    assert (first.after, first.fault, first.since_s) == ("normal", "friction", 0.0)
    assert (last.before, last.after, last.fault) == ("normal", "degraded", "backlash")
    assert last.since_s == findings.since_s == pytest.approx(40.0, abs=10.0)
    assert "backlash reliably above 0.15 °" in last.rule
    assert "1 false alarm per 100 h" in last.rule
    assert last.time_s >= 40.0


def test_an_indication_is_a_95_percent_interval_of_every_window_that_shows_the_fault() -> None:
    events, findings = watch(telemetry(flown(rate_hz=25.0)))
    windows = [w for w in windows_of(events) if w.friction_nm]
    shown = [e for e in events if isinstance(e, Indication) and e.fault == "friction"]
    assert np.concatenate([e.end_s for e in shown]).tolist() == [w.end_s for w in windows]
    low = np.concatenate([e.low for e in shown])
    assert low.tolist() == [w.friction_nm.low for w in windows if w.friction_nm]
    friction = next(i for i in findings.indicators if i.fault == "friction")
    assert friction.value.low < friction.value.estimate < friction.value.high
    assert friction.windows == 4
    assert (friction.limit, friction.baseline) == (0.375, None)


class Contrary:
    """Says the contrary of the packaged network."""

    def __getattr__(self, name: str) -> Any:
        return getattr(default_model(), name)

    def classify_windows(self, features: Array) -> tuple[Array, NDArray[np.bool_]]:
        probabilities, inside = default_model().classify_windows(features)
        order = [self.window_classes.index(name) for name in ("friction_emergency", "normal")]
        probabilities[:, order] = probabilities[:, order[::-1]]
        return probabilities, inside

    def votes(self, values: Array) -> NDArray[np.int8]:
        votes = default_model().votes(values)
        return np.where(votes >= 0, 1 - votes, votes).astype(np.int8)

    def probability(self, share: float) -> float:
        return share


@pytest.mark.parametrize(("friction", "condition"), [(0.225, "normal"), (1.0, "emergency")])
@pytest.mark.parametrize("contrary", [False, True])
def test_who_decides_decides_alone(friction: float, condition: str, contrary: bool) -> None:
    judge = Contrary() if contrary else default_model()
    other = {"normal": "emergency", "emergency": "normal"}[condition]
    said = other if contrary else condition
    events, findings = watch(data_sheet(friction), networks=[judge])
    assert [e.after for e in events if isinstance(e, ConditionChanged)] == [condition]
    answer = present(findings.network)
    assert (answer.decides, answer.condition) == ("physics", said)
    assert (present(findings.network).share_of_samples > 0.5) == (said == "emergency")
    assert (present(findings.network).first_emergency_s is None) == (said == "normal")
    assert "network" not in {item.kind for item in findings.evidence}
    events, findings = watch(data_sheet(friction), networks=[judge], decide="network")
    changes = [e.after for e in events if isinstance(e, ConditionChanged)]
    # A network may be sure of a fault before it is sure how grave it is.
    assert changes == [said] or (changes == ["degraded", said] and said == "emergency")
    assert (findings.condition, present(findings.network).decides) == (said, "network")
    assert {item.kind for item in findings.evidence} == {"network"}
    assert [suspect.fault for suspect in findings.suspects] == ["friction"] * (said == "emergency")


def test_without_limits_the_network_decides_and_without_a_network_nobody() -> None:
    bare = actuator_of().model_copy(update={"limits": None})
    _, findings = watch(data_sheet(1.0), actuator=bare, networks=[default_model()])
    assert (findings.condition, present(findings.network).decides) == ("emergency", "network")
    _, findings = watch(data_sheet(1.0), actuator=bare)
    assert (findings.condition, findings.network) == ("undecided", None)
    _, findings = watch(data_sheet(1.0), decide="network")  # no network is for this airframe
    assert (findings.condition, findings.network) == ("emergency", None)


def test_the_first_emergency_is_the_first_window_in_which_the_network_says_so() -> None:
    """The friction passes the limit of an emergency, 0.875 N·m, at 28 s."""
    flight = Flight(seed=41, duration_s=60.0, rate_hz=50.0, friction_nm={"elevator": (0.225, 1.6)})
    growing = telemetry(sensed(fly(flight)))
    events, findings = watch(growing, networks=[default_model()], decide="network")
    windows = [e for e in events if isinstance(e, Window) and e.network == "friction_emergency"]
    first_s = present(present(findings.network).first_emergency_s)
    assert first_s == windows[0].start_s + 5.0
    assert 26.0 < first_s < 38.0
    episodes = [item for item in findings.evidence if item.kind == "network"]
    assert [item.rule.split(":")[0] for item in episodes] == ["degraded", "emergency"]
    assert episodes[1].start_s == pytest.approx(first_s, abs=3.0)


OWN = {"friction": Baseline(mean=0.225, error=0.001, flights=12, between=0.003, spread=0.004)}


@pytest.mark.parametrize(("worn_nm", "seed"), [(0.08, 401), (0.0, 402)])
def test_wear_far_below_the_limit_is_a_drift_from_the_own_baseline(worn_nm: float, seed: int) -> None:
    worn = (Condition.constant("friction", worn_nm),) if worn_nm else ()
    seen = telemetry(flown(*worn, rate_hz=25.0, seconds=100.0, seed=seed))
    assert watch(seen)[1].worst == "normal"
    findings = watch(seen, baselines=OWN)[1]
    drifts = [e for e in findings.evidence if e.kind == "friction_drift"]
    friction = next(i for i in findings.indicators if i.fault == "friction")
    assert friction.baseline == OWN["friction"].prediction().significant(5)
    if not worn:
        assert (findings.worst, drifts) == ("normal", [])
        return
    assert findings.condition == findings.worst == "degraded"
    assert [suspect.fault for suspect in findings.suspects] == ["friction"]
    assert findings.suspects[0].confidence >= 0.99
    [drift] = drifts
    assert drift.limit == 0.225
    assert drift.value - 0.225 == pytest.approx(0.08, abs=0.02)
    assert "from its own baseline" in drift.rule
    assert "over 12 flights" in drift.rule
    assert findings.since_s == drift.start_s == 0.0


def test_a_flight_shorter_than_a_window_is_not_judged() -> None:
    events, findings = watch(data_sheet(1.0, seconds=9.0))
    assert [e for e in events if not isinstance(e, Indication)] == []
    assert (findings.condition, findings.coverage.windows) == ("undecided", 0)


@pytest.mark.parametrize(
    ("friction", "begin_s", "seed", "expected"), [(0.0, 0.0, 933, "normal"), (0.7, 50.0, 900, "emergency")]
)
def test_windows_too_poor_each_by_itself_are_judged_together(
    friction: float, begin_s: float, seed: int, expected: str
) -> None:
    """Light air: the autopilot's corrections move the surface for moments only."""
    worn = (Condition.constant("friction", friction),) if friction else ()
    still = telemetry(flown(*worn, rate_hz=15.0, seconds=100.0, cyclogram="cruise", seed=seed))
    events, findings = watch(Telemetry(still.time_s + begin_s, still.values))
    assert findings.since_s == begin_s
    assert 0 < findings.coverage.decidable < 20
    (change,) = [event for event in events if isinstance(event, ConditionChanged)]
    assert (change.after, change.time_s) == (expected, findings.last_s)
    assert "over the whole flight" in change.rule
    assert present(findings.friction).low < 0.225 + friction < present(findings.friction).high


@pytest.mark.parametrize("friction", [0.0, 0.75])
def test_motion_too_brief_for_any_window_decides_nothing(friction: float) -> None:
    """At 10 Hz hardly a sample of light air has neighbours that move with it."""
    worn = (Condition.constant("friction", friction),) if friction else ()
    seen = telemetry(flown(*worn, rate_hz=10.0, seconds=100.0, cyclogram="cruise", seed=931))
    events, findings = watch(seen)
    assert findings.coverage.decidable == 0
    assert not [event for event in events if isinstance(event, ConditionChanged)]
    assert (findings.condition, findings.worst, findings.friction) == ("undecided", "undecided", None)


def test_a_fault_that_no_run_of_windows_shows_is_an_alarm_at_the_finish() -> None:
    """Light air presses the gear's other flank for moments only; over the flight often enough."""
    for worn in ((), (Condition.constant("backlash", 0.3),)):
        seen = telemetry(flown(*worn, rate_hz=25.0, seconds=100.0, cyclogram="cruise", seed=902))
        events, findings = watch(seen)
        alarms = [e for e in events if isinstance(e, ConditionChanged) and e.after == "degraded"]
        assert [suspect.fault for suspect in findings.suspects] == ["backlash"] * len(worn)
        assert len(alarms) == len(worn)
        for alarm in alarms:
            assert (alarm.fault, alarm.time_s) == ("backlash", findings.last_s)
            assert "backlash reliably above" in alarm.rule
            assert alarm.rule.endswith(", over the whole flight")


def test_a_bias_larger_than_the_play_is_found_in_flight_with_the_load_on_one_flank() -> None:
    worn = Condition.constant("sensor_bias", 0.8)
    seen = telemetry(flown(worn, rate_hz=25.0, seconds=100.0, cyclogram="cruise", seed=901))
    events, findings = watch(seen)
    (alarm,) = [e for e in events if isinstance(e, ConditionChanged) and e.after == "degraded"]
    assert alarm.fault == "sensor_bias"
    assert alarm.time_s < findings.last_s - 30.0


def test_which_direction_is_called_positive_changes_no_verdict() -> None:
    """A servo mounted the other way round: all that has a direction changes its sign."""
    worn = telemetry(flown(Condition.constant("friction", 0.4), rate_hz=25.0))
    turned = Telemetry(worn.time_s, worn.values.copy())
    directed = ("V1", "V2", "V3", "V4", "V5", "V7", "V8", "V10", "V11")
    turned.values[:, [column(key) for key in directed]] *= -1
    one, other = watch(worn)[1], watch(turned)[1]
    assert (other.condition, other.since_s) == (one.condition, one.since_s) == ("degraded", 0.0)
    assert [i.fault for i in other.indicators] == [i.fault for i in one.indicators]
    for mine, theirs in zip(one.indicators, other.indicators, strict=True):
        sign = -1 if mine.fault == "sensor_bias" else 1
        assert theirs.value.estimate == pytest.approx(sign * mine.value.estimate, rel=1e-6, abs=1e-9)
        width = theirs.value.high - theirs.value.low
        assert width == pytest.approx(mine.value.high - mine.value.low, rel=1e-6)
