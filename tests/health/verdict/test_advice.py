"""What the maintainer is advised: the gravest condition, and the parts that the suspected fault concerns."""

from __future__ import annotations

from typing import Any

import pytest

from mavhums.core.conditions import Condition
from mavhums.health.verdict import with_advice
from mavhums.results.verdict import Candidate, Evidence, Suspect, Verdict

EACH = "each surface of the axis, its linkage and its servo, by moving it on the ground"
SLOW = "each servo of the axis for speed under load, its supply and its linkage for binding"
GEAR, PLAY = "gearbox, bearings and hinge line", "gear and linkage for play"
WATCH = "before the next flight, and watch the trend over flights"
MENDED = "repair or replace the actuator and test it on the ground"


def advice(actuator: str, condition: Condition, worst: Condition | None = None, **known: Any) -> str:
    told = Verdict(vehicle=1, actuator=actuator, condition=condition, worst=worst or condition, **known)
    return with_advice(told).advice or ""


def evidence(*found: tuple[str, str]) -> tuple[Evidence, ...]:
    return tuple(Evidence(kind=kind, start_s=0.0, end_s=1.0, value=1.0, rule=rule) for kind, rule in found)


def suspects(**sure: float) -> tuple[Suspect, ...]:
    return tuple(Suspect(fault=fault, confidence=confidence) for fault, confidence in sure.items())


@pytest.mark.parametrize(
    ("condition", "rules", "told"),
    [
        ("degraded", (), f"inspect the propeller, motor, ESC and wiring of motor 2 {WATCH}"),
        (
            "emergency",
            (
                ("thrust", "emergency: the ESC"),
                ("speed", "its speed lags its output (80 %): the ESC, the motor"),
            ),
            "do not fly; inspect the motor, ESC and wiring of motor 2; "
            "replace what failed and test it without propellers",
        ),
        (
            "degraded",
            (("speed", "its speed follows its output: the propeller, or"), ("thrust", "x: the ESC")),
            f"inspect the propeller of motor 2 {WATCH}",
        ),
        ("normal", (), "keep the log for the trend over flights"),
    ],
)
def test_the_speed_of_a_motor_tells_its_propeller_from_the_rest(
    condition: Condition, rules: tuple[tuple[str, str], ...], told: str
) -> None:
    assert advice("motor 2", condition, subject="motor", evidence=evidence(*rules)) == told


@pytest.mark.parametrize(
    ("known", "parts"),
    [
        ({"suspects": suspects(friction=0.6, backlash=0.9)}, PLAY),
        ({"suspects": suspects(friction=0.9, backlash=0.6)}, GEAR),
        ({"suspects": suspects(unheard=0.9, backlash=0.6)}, PLAY),
        # Without a suspect the latest evidence tells, and a suspect goes before any evidence.
        ({"evidence": evidence(("friction", ""), ("backlash", ""))}, PLAY),
        ({"evidence": evidence(("backlash", "")), "suspects": suspects(friction=0.1)}, GEAR),
        ({}, "the actuator and its wiring"),
        ({"subject": "axis", "suspects": suspects(slow=0.6)}, SLOW),
        ({"subject": "axis", "suspects": suspects(friction=0.6)}, "the actuator and its wiring"),
    ],
)
@pytest.mark.parametrize("actuator", ["rudder", "yaw"])
def test_the_surest_suspect_names_the_parts(known: dict[str, Any], parts: str, actuator: str) -> None:
    assert advice(actuator, "degraded", **known) == f"inspect {parts} {WATCH}"
    # What went by counts more than the present.
    grave = advice(actuator, "normal", "emergency", **known)
    ground = "repair and check the travel of each surface on the ground"
    assert grave == f"do not fly; inspect {parts}; {ground if known.get('subject') == 'axis' else MENDED}"


def test_another_axis_or_a_candidate_with_evidence_comes_first() -> None:
    axis: dict[str, Any] = {"subject": "axis", "suspects": suspects(effectiveness=0.9)}
    assert advice("yaw", "degraded", **axis, consequence_of="roll") == (
        "repair what roll control shows, then fly and judge again"
    )
    told, plain = (Candidate(surface=f"{one} elevon", servo=1, because=one) for one in ("left", None))
    assert advice("roll", "degraded", **axis, candidates=(told, plain)) == (
        f"inspect left elevon first, then {EACH} {WATCH}"
    )
    assert advice("roll", "degraded", **axis, candidates=(plain, told)) == f"inspect {EACH} {WATCH}"
    assert advice("roll", "degraded", **axis) == f"inspect {EACH} {WATCH}"
