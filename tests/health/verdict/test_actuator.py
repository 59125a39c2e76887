"""From what a flight shows of an actuator to its verdict: silence, the digits shown, and its own baseline."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest

from mavhums.actuator.derive import SIGNED_BY_VOLTAGE
from mavhums.actuator.telemetry import TIERS
from mavhums.core.conditions import Condition
from mavhums.health.actuator.monitor import Monitor
from mavhums.health.verdict.actuator import TelemetrySources, verdict_of_actuator
from mavhums.results.reasons import Reason
from mavhums.results.verdict import Coverage, Evidence, Interval, OwnRecord, Suspect, Verdict
from tests.health.builders import indicator
from tests.health.flown import actuator_of

START = datetime(2026, 3, 1, 9, tzinfo=UTC)
VALUE = Interval(estimate=0.123456, low=0.112346, high=0.134567)
SHOWN = indicator("friction", 0.123456, 0.01111, scatter=0.0123456, baseline=VALUE)
FOUND = Evidence(kind="friction", start_s=1.23456, end_s=9.87654, value=0.123456, rule="")
OWN = OwnRecord(equation="own_current", setup="", rate_hz=25.0, duration_s=60.0, groups=())
NOTHING = Coverage(moving_fraction=0.1, windows=0, decidable=0)
SURE = Suspect(fault="friction", confidence=0.987654)


def verdict(condition: Condition = "degraded", end_s: float = 100.0, **changes: Any) -> Verdict:
    """Return the verdict on a flight whose telemetry ends at 90 s."""
    implausible = changes.pop("implausible", {"V5": (19, 100)})
    provenance = changes.pop("provenance", {"V5": "A.b", "V7": "A.c"})
    actuator = actuator_of().model_copy(update=changes.pop("actuator", {}))
    seen = Coverage(moving_fraction=0.123456, windows=50, decidable=7, late=5)
    parts: dict[str, Any] = {"evidence": (FOUND,), "indicators": (SHOWN,), "own": (OWN,), "suspects": (SURE,)}
    parts |= {"condition": condition, "worst": "emergency", "since_s": 41.23456, "last_s": 90.0}
    parts |= {"coverage": seen, "friction": VALUE} | changes
    findings: Any = replace(Monitor(1, actuator).findings(), **parts)
    telemetry = TelemetrySources(1, actuator, TIERS[0], provenance, 2, implausible)
    return verdict_of_actuator(telemetry, findings, start_utc=START, end_s=end_s)


@pytest.mark.parametrize(
    ("condition", "end_s", "judged", "expected"),
    [
        ("degraded", 100.0, "degraded", ()),
        ("degraded", 101.0, "undecided", ("silent",)),
        ("normal", 100.01, "undecided", ("silent",)),
        ("undecided", 101.0, "undecided", ("none_clear",)),
    ],
)
def test_silence_for_more_than_a_window_is_undecided_and_keeps_the_worst(
    condition: Condition, end_s: float, judged: Condition, expected: tuple[str, ...]
) -> None:
    found = verdict(condition, end_s)
    assert (found.condition, found.worst, found.reason_codes) == (judged, "emergency", expected)
    silent = end_s > 100.0
    assert (found.since is None, found.own) == (silent, () if silent else (OWN,))


@pytest.mark.parametrize(
    ("measured", "changes", "code"),
    [
        (("V6", "V7"), {"actuator": {"esc_side": "bus"}}, "bus_power"),
        (("V5",), {}, "not_measured"),
        (("V5", "V7"), {"coverage": NOTHING}, "telemetry_too_short"),
        (("V5", "V7"), {"no_friction": Reason("one_way")}, "one_way"),
        (("V5", "V7"), {"actuator": {"ema": None}}, "blanks"),
        (("V5", "V7"), {"coverage": NOTHING.model_copy(update={"windows": 9})}, "slow_motion"),
        (("V5", "V7"), {}, "none_clear"),
    ],
)
def test_what_binds_is_named(measured: tuple[str, ...], changes: dict[str, Any], code: str) -> None:
    provenance = dict.fromkeys(measured, f"A.b{SIGNED_BY_VOLTAGE}")
    assert verdict("undecided", provenance=provenance, **changes).reason_codes == (code,)


def test_absurd_values_are_named_before_what_else_is_missing() -> None:
    found = verdict("undecided", implausible={"V5": (21, 100)})
    assert found.reason_codes == ("implausible",)
    assert "21 % of the values of V5 are" in (found.reason or "")
    assert verdict("degraded", implausible={"V5": (21, 100)}).reason is None
