"""A condition rests on a decidable window, of any telemetry, in flight, at its end and against a baseline."""

from __future__ import annotations

from collections import deque
from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks._fleet import compared
from mavhums.actuator.profile import Actuator
from mavhums.actuator.telemetry import tier_named
from mavhums.core.quantities import KEYS, column
from mavhums.health.actuator.monitor import ActuatorFindings, Monitor
from mavhums.health.actuator.past import compare_with_earlier_flights
from mavhums.health.decision.baseline import Baseline
from mavhums.health.verdict.actuator import TelemetrySources, verdict_of_actuator
from mavhums.results.verdict import Coverage
from mavhums_sim.conditions import Condition
from mavhums_sim.sensors import EscSide
from tests.health.flown import Telemetry, actuator_of, flown, reported, telemetry

FAULTS = {"none": 0.0, "friction": 0.7, "backlash": 0.3, "resistance": 0.3, "jam": 10.0}
START = datetime(2026, 1, 1, tzinfo=UTC)

BASELINES = {
    fault: Baseline(mean, error=0.001, flights=20, between=0.001, spread=0.002)
    for fault, mean in (("friction", 0.15), ("winding_resistance", 21.0), ("torque_constant", -0.1))
}
"""Of an actuator that was better in every flight before."""


CASES = st.tuples(
    st.sampled_from(["instrumented", "esc-signed", "esc-unsigned", "esc at the bus", "angles"]),
    st.sampled_from(sorted(FAULTS)),
    st.sampled_from(["cruise", "turns", "preflight"]),
    st.sampled_from([10.0, 25.0]),
)
WHOLE = [(0.0, 60.0)]


@cache
def sent(
    tier: str, fault: str, cyclogram: str, rate_hz: float
) -> tuple[Actuator, Telemetry, tuple[bool, ...]]:
    """Return the actuator, V1…V12 by a tier of telemetry over 60 s, and which of them are measured."""
    worn = () if fault == "none" else (Condition.constant(fault, FAULTS[fault]),)
    side: EscSide = "bus" if tier == "esc at the bus" else "motor"
    record = flown(*worn, rate_hz=rate_hz, seconds=60.0, cyclogram=cyclogram, seed=931, esc_side=side)
    seen, actuator = telemetry(record), actuator_of(esc_side=side)
    if tier == "angles":
        measured = np.isin(KEYS, ["V1", "V3"])
        seen = Telemetry(seen.time_s, np.where(measured, seen.values, np.nan))
    else:
        seen, measured = reported(seen, "esc-signed" if side == "bus" else tier, actuator)
    return actuator, seen, tuple(measured.tolist())


def shown(seen: Telemetry, spans: list[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return the samples in spans, each given by its start and length, s."""
    there = np.zeros(seen.time_s.size, dtype=np.bool_)
    for start_s, length_s in spans:
        there |= (seen.time_s >= start_s) & (seen.time_s < start_s + length_s)
    return there


@pytest.mark.slow
@given(
    flight=CASES,
    spans=st.lists(st.tuples(st.floats(0, 60), st.floats(0.1, 15)), min_size=1, max_size=12),
    against=st.booleans(),
)
@example(flight=("instrumented", "friction", "cruise", 10.0), spans=WHOLE, against=False)
@example(flight=("instrumented", "none", "cruise", 10.0), spans=WHOLE, against=False)
@example(flight=("esc-signed", "friction", "cruise", 10.0), spans=WHOLE, against=False)
@example(flight=("esc-unsigned", "friction", "cruise", 10.0), spans=WHOLE, against=False)
@example(flight=("esc-signed", "resistance", "cruise", 10.0), spans=WHOLE, against=True)
@example(flight=("angles", "jam", "turns", 25.0), spans=WHOLE, against=False)
@settings(max_examples=60, deadline=None)
def test_where_no_window_is_decidable_nothing_is_decided(
    flight: tuple[str, str, str, float], spans: list[tuple[float, float]], against: bool
) -> None:
    """The speed is known in some spans; elsewhere it is missing, as where its sign is unknown."""
    actuator, seen, measured = sent(*flight)
    values = seen.values.copy()
    values[~shown(seen, spans), column("V7")] = np.nan
    gave = np.tile(measured, (seen.time_s.size, 1))
    monitor, own = Monitor(1, actuator), BASELINES if against else {}
    for block in np.array_split(np.arange(seen.time_s.size), 13):
        bus_v = None if seen.bus_v is None else seen.bus_v[block]
        deque(monitor.feed(seen.time_s[block], values[block], gave[block], bus_v), maxlen=0)
        agrees(compared(monitor.findings(), actuator, own))
    deque(monitor.finish(), maxlen=0)
    findings, end_s = monitor.findings(), float(seen.time_s[-1])
    now = compared(findings, actuator, own)
    agrees(now)
    telemetry = TelemetrySources(1, actuator, tier_named("named"), dict.fromkeys(KEYS, "measured"))
    verdict = verdict_of_actuator(telemetry, findings, start_utc=START, end_s=end_s)
    verdict = compare_with_earlier_flights(verdict, own, start_utc=START, end_s=end_s)
    assert (verdict.condition, verdict.worst) == (now.condition, now.worst)
    assert verdict.coverage.decidable == now.coverage.decidable
    assert (verdict.reason is not None) == (verdict.condition == "undecided")


def agrees(findings: ActuatorFindings) -> None:
    rests_on: Coverage = findings.coverage
    assert rests_on.decidable <= rests_on.windows
    if rests_on.decidable == 0:
        assert (findings.condition, findings.worst) == ("undecided", "undecided")
        assert (findings.friction, findings.suspects, findings.evidence) == (None, (), ())
