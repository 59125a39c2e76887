"""An actuator's indicators beside its earlier flights: power, false alarms, and what does not count."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.core.conditions import Condition
from mavhums.core.statistics import NORMAL_95
from mavhums.health.actuator.past import compare_with_earlier_flights
from mavhums.health.decision.baseline import Baseline
from mavhums.results.sections import NetworkAnswer
from mavhums.results.verdict import Coverage, Evidence, Indicator, Suspect, Verdict
from tests.health import builders
from tests.health.builders import indicator
from tests.present import present

START = datetime(2026, 3, 1, 9, tzinfo=UTC)
KNOWN = Baseline(mean=0.2, error=0.001, flights=20, between=0.004, spread=0.005)
WINDOWS = 10


def shown(value: float, *, error: float = 0.003, fault: str = "friction") -> Indicator:
    known = {"quantity": "Coulomb friction", "unit": "N·m", "windows": WINDOWS}
    return indicator(fault, value, NORMAL_95 * error, scatter=error * WINDOWS**0.5, **known)


def judged(
    *indicators: Indicator,
    condition: Condition = "normal",
    known: Baseline = KNOWN,
    rate: float = 1.0,
    **given: Any,
) -> Verdict:
    """Return the verdict on a flight of 100 s beside the baseline of each indicator."""
    coverage = Coverage(moving_fraction=0.5, windows=91, decidable=5)
    alone = builders.verdict(condition, coverage=coverage, indicators=indicators, **given)
    baselines = {one.fault: known for one in indicators}
    return compare_with_earlier_flights(alone, baselines, start_utc=START, end_s=100.0, false_alarms=rate)


def departs(verdict: Verdict) -> bool:
    return any(item.kind.endswith("_drift") for item in verdict.evidence)


@pytest.mark.parametrize(("fault", "way"), [("friction", 1.0), ("friction", -1.0), ("sensor_bias", -1.0)])
def test_the_power_curve_of_a_rise(fault: str, way: float) -> None:
    """A fall of friction is no wear; a sensor's bias counts either way."""
    sizes = (0.0, 0.01, 0.015, 0.03, 0.04, 0.08)
    found = [departs(judged(shown(0.2 + way * size, fault=fault))) for size in sizes]
    risen = way > 0.0 or fault == "sensor_bias"
    assert found == [False, False, False, *[risen] * 3]


def test_what_a_departure_adds_to_a_verdict() -> None:
    play = shown(0.1, fault="backlash")
    jam = Suspect(fault="jam", confidence=0.2)
    verdict = judged(shown(0.25), condition="undecided", reason="none", suspects=(jam,))
    assert (verdict.condition, verdict.worst, verdict.reason) == ("degraded", "degraded", None)
    assert present(verdict.since).flight_time_s == 0.0
    (drift,) = verdict.evidence
    assert (drift.kind, drift.start_s, drift.end_s) == ("friction_drift", 0, 100)
    assert (drift.value, drift.limit) == (0.25, 0.2)
    assert drift.rule.startswith(
        "degraded: Coulomb friction +0.05 N·m from its own baseline of 0.2 N·m over 20"
    )
    assert [one.fault for one in verdict.suspects] == ["friction", "jam"]
    assert verdict.suspects[0].confidence > 0.98
    assert verdict.coverage.decidable == WINDOWS
    (now,) = verdict.indicators
    assert (now.baseline, now.baseline_flights) == (KNOWN.prediction().significant(5), 20)
    assert judged(play).indicators[0].baseline is not None


def test_a_limit_that_decided_keeps_its_condition_and_its_onset() -> None:
    found = Evidence(kind="friction", start_s=40.0, end_s=100.0, value=0.9, rule="emergency: interval")
    sure = Suspect(fault="friction", confidence=1.0)
    verdict = judged(shown(0.9), condition="emergency", evidence=(found,), suspects=(sure,))
    assert (verdict.condition, verdict.worst, verdict.since) == ("emergency", "emergency", None)
    assert [item.kind for item in verdict.evidence] == ["friction_drift", "friction"]
    assert [(one.fault, one.confidence) for one in verdict.suspects] == [("friction", 1.0)]


def test_what_is_no_evidence_beside_earlier_flights() -> None:
    """A shaft that was held; silence, whose condition stays open; friction that a network decides."""
    jam = Evidence(kind="jam", start_s=4.0, end_s=9.0, value=3.0, rule="emergency: jam")
    assert not departs(judged(shown(0.3), condition="emergency", evidence=(jam,)))
    silent = judged(shown(0.3), condition="undecided", reason_codes=("silent",), reason="silent")
    assert (silent.condition, silent.worst, silent.reason) == ("undecided", "degraded", "silent")
    answer = NetworkAnswer.model_construct(condition="normal", decides="network")
    both = judged(shown(0.3), shown(0.3, fault="backlash"), network=answer)
    assert [item.kind for item in both.evidence] == ["backlash_drift"]
    physics = judged(shown(0.3), network=answer.model_copy(update={"decides": "physics"}))
    assert [item.kind for item in physics.evidence] == ["friction_drift"]


@pytest.mark.slow
@pytest.mark.parametrize(("heavy", "unlike"), [(False, False), (True, True)])
def test_false_alarms_are_as_rare_as_promised(heavy: bool, unlike: bool) -> None:
    """Healthy flights of 100 s whose windows have Student's t4 or normal scatter; baselines of ten flights.

    Where they are ``unlike``, some are ten times as noisy as others. The rate is asked for 250 times as high,
    so that it can be counted: an alarm in 16 flights, beyond the largest of a flight.
    """
    rng = np.random.default_rng(4)
    between, flights, count, alarms, rate = 0.011, 10, 3000, 0, 39.0
    for _ in range(count):
        within = 0.008 * 10 ** (rng.uniform(-0.5, 0.5, flights + 1) if unlike else np.zeros(flights + 1))
        windows = 0.22 + between * rng.standard_normal((flights + 1, 1))
        windows = windows + within[:, None] * scatter(rng, (flights + 1, WINDOWS), heavy)
        now, *past = [shown(float(f.mean()), error=float(f.std(ddof=1)) / WINDOWS**0.5) for f in windows]
        alarms += departs(judged(now, known=present(Baseline.of(past)), rate=rate))
    promised = min(rate / 36_000 * 91 / WINDOWS, 0.01) * count
    assert alarms <= promised + 3 * np.sqrt(promised)
    assert alarms >= 0.05 * promised


def scatter(rng: np.random.Generator, shape: tuple[int, ...], heavy: bool) -> NDArray[np.float64]:
    return rng.standard_t(4, shape) / np.sqrt(2.0) if heavy else rng.standard_normal(shape)
