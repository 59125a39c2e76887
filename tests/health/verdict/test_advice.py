"""What the maintainer is advised: the gravest condition, and the parts that the suspected fault concerns."""

from __future__ import annotations

from typing import Any

import pytest

from mavhums.core.conditions import Condition
from mavhums.health.actuator import detectors
from mavhums.health.axis import detectors as axis_detectors
from mavhums.health.verdict import with_advice
from mavhums.results.verdict import Candidate, Evidence, Suspect
from tests.health.builders import verdict

GEAR, PLAY = (detectors.to_inspect(fault) for fault in ("friction", "backlash"))
SLOW, EACH = (axis_detectors.to_inspect(fault) for fault in ("slow", "effectiveness"))
WIRING = "the actuator and its wiring"


def advice(actuator: str, condition: Condition, **known: Any) -> str:
    return with_advice(verdict(condition, actuator=actuator, **known)).advice or ""


def evidence(*found: tuple[str, str]) -> tuple[Evidence, ...]:
    return tuple(Evidence(kind=kind, start_s=0.0, end_s=1.0, value=1.0, rule=rule) for kind, rule in found)


def suspects(**sure: float) -> tuple[Suspect, ...]:
    return tuple(Suspect(fault=fault, confidence=confidence) for fault, confidence in sure.items())


LAGS, FOLLOWS = "its speed lags its output (80 %): the ESC, the motor", "its speed follows: the propeller, or"


@pytest.mark.parametrize("condition", ["degraded", "emergency"])
@pytest.mark.parametrize(
    ("rules", "parts"),
    [
        ((), "propeller, motor, ESC and wiring"),
        ((("thrust", "emergency: the ESC"), ("speed", LAGS)), "motor, ESC and wiring"),
        ((("speed", FOLLOWS), ("thrust", "x: the ESC")), "propeller"),
    ],
)
def test_the_speed_of_a_motor_separates_its_propeller_from_the_rest(
    condition: Condition, rules: tuple[tuple[str, str], ...], parts: str
) -> None:
    text = advice("motor 2", condition, subject="motor", evidence=evidence(*rules))
    assert f"inspect the {parts} of motor 2" in text
    assert text.startswith("do not fly") == ("without propellers" in text) == (condition == "emergency")


@pytest.mark.parametrize(
    ("known", "parts"),
    [
        ({"suspects": suspects(friction=0.6, backlash=0.9)}, PLAY),
        ({"suspects": suspects(friction=0.9, backlash=0.6)}, GEAR),
        ({"suspects": suspects(unheard=0.9, backlash=0.6)}, PLAY),
        # Without a suspect the latest evidence decides, and a suspect goes before any evidence.
        ({"evidence": evidence(("friction", ""), ("backlash", ""))}, PLAY),
        ({"evidence": evidence(("backlash", "")), "suspects": suspects(friction=0.1)}, GEAR),
        ({}, WIRING),
        ({"subject": "axis", "suspects": suspects(slow=0.6)}, SLOW),
        ({"subject": "axis", "suspects": suspects(friction=0.6)}, WIRING),
    ],
)
@pytest.mark.parametrize("actuator", ["rudder", "yaw"])
def test_the_surest_suspect_names_the_parts(known: dict[str, Any], parts: str, actuator: str) -> None:
    assert advice(actuator, "degraded", **known).startswith(f"inspect {parts} before the next flight")
    # What went by counts more than the present.
    grave = advice(actuator, "normal", worst="emergency", **known)
    assert grave.startswith(f"do not fly; inspect {parts}; repair ")
    assert ("each surface" in grave.rpartition(";")[2]) == (known.get("subject") == "axis")


def test_another_axis_or_a_candidate_with_evidence_comes_first() -> None:
    axis: dict[str, Any] = {"subject": "axis", "suspects": suspects(effectiveness=0.9)}
    assert advice("yaw", "degraded", **axis, consequence_of="roll").startswith("repair what roll control")
    likely, plain = (Candidate(surface=f"{one} elevon", servo=1, because=one) for one in ("left", None))
    for candidates, first in (((likely, plain), "left elevon first, then "), ((plain, likely), ""), ((), "")):
        found = advice("roll", "degraded", **axis, candidates=candidates)
        assert found.startswith(f"inspect {first}{EACH} before")
