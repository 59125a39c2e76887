"""What is said of vehicles without a profile, and of actuators that are not judged."""

from __future__ import annotations

import pytest

from mavhums.actuator.plausibility import NOT_USED
from mavhums.actuator.telemetry import TIERS, Tier
from mavhums.core.conditions import Condition
from mavhums.health.verdict.actuator import unjudged_actuator, unjudged_vehicle, with_refused
from mavhums.health.verdict.obstacles import unjudged
from mavhums.results.reasons import Reason
from mavhums.results.verdict import ALL, Verdict
from mavhums.vehicle.surfaces import Surfaces
from tests.health.builders import outputs
from tests.health.flown import actuator_of

JUDGED, SEEN = (next(one for one in TIERS if one.judged == judged) for judged in (True, False))
FROM_ESC = next(one for one in TIERS if one.from_esc)
SURFACES = Surfaces(outputs(aileron=1, rudder=2), "profile")


@pytest.mark.parametrize(
    ("vehicle", "tier", "condition"),
    [
        (1, SEEN, "unmonitored"),
        (1, JUDGED, "undecided"),
        (None, SEEN, "undecided"),
        (None, JUDGED, "undecided"),
    ],
)
def test_a_vehicle_whose_servos_report_nothing_is_unmonitored(
    vehicle: int | None, tier: Tier | None, condition: Condition
) -> None:
    [found] = unjudged_vehicle(vehicle, tier)
    assert (found.vehicle, found.actuator, found.condition) == (vehicle, ALL, condition)
    assert found.tier == (tier and tier.name)
    assert (found.reason_codes == ("no_vehicle",)) == (vehicle is None)


@pytest.mark.parametrize(("tier", "each"), [(None, True), (SEEN, True), (JUDGED, False)])
def test_each_known_surface_without_feedback_is_unmonitored(tier: Tier | None, each: bool) -> None:
    found = [*unjudged_vehicle(1, tier, surfaces=SURFACES)]
    names = [SURFACES.named(moved) for moved in SURFACES.moved]
    assert [one.actuator for one in found] == (names if each else [ALL])
    assert {one.condition for one in found} == {"unmonitored" if each else "undecided"}
    # A log without a vehicle has no surface either.
    assert [one.actuator for one in unjudged_vehicle(None, tier, surfaces=SURFACES)] == [ALL]


GAP = Reason("own_still", quantity="friction")
BLANK: dict[str, object] = {"ema": None, "limits": None}


@pytest.mark.parametrize(
    ("changes", "tier", "keys", "expected"),
    [
        ({}, JUDGED, ("V3",), ["left_out"]),
        ({}, SEEN, ("V1", "V3"), ["left_out"]),
        (BLANK, JUDGED, ("V3",), ["blanks"]),
        (BLANK, JUDGED, (), ["blanks", "left_out"]),
        ({**BLANK, "travel_deg": None}, JUDGED, ("V3",), ["blanks"]),
        ({"esc": None}, FROM_ESC, (), ["esc_unnamed"]),
        ({"esc": 2}, FROM_ESC, (), ["left_out"]),
    ],
)
def test_why_an_actuator_with_telemetry_is_not_judged(
    changes: dict[str, object], tier: Tier, keys: tuple[str, ...], expected: list[str]
) -> None:
    actuator = actuator_of().model_copy(update=changes)
    provenance = dict.fromkeys(keys, "A.b")
    found = unjudged_actuator(1, actuator, tier, provenance)
    assert (found.condition, found.actuator, found.provenance) == ("undecided", actuator.name, provenance)
    assert found.reason_codes == (*expected,)
    assert ("no travel_deg" in (found.reason or "")) is ("travel_deg" in changes)
    assert unjudged_actuator(1, actuator, tier, provenance, GAP).reason_codes == (GAP.code, *expected)


@pytest.mark.parametrize(("tier", "keys"), [(None, ()), (None, ("V3",)), (SEEN, ()), (SEEN, ("V1",))])
def test_an_actuator_without_feedback_is_unmonitored(tier: Tier | None, keys: tuple[str, ...]) -> None:
    provenance = dict.fromkeys(keys, "A.b")
    known, unknown = actuator_of(), actuator_of().model_copy(update={"travel_deg": None})
    by_angle = unknown.model_copy(update={"fields": {"V1": "A.b"}})
    angles = []
    for actuator in (known, by_angle, unknown):
        found = unjudged_actuator(1, actuator, tier, provenance, GAP)
        assert found.condition == "unmonitored"
        angles.append("no_angle" in found.reason_codes)
    assert angles == [False, False, True]


PROVENANCE = {
    "V4": "ESC_STATUS.voltage",
    "V5": "ESC_STATUS.current" + NOT_USED.format("the current is refreshed once a second"),
    "V7": "ESC_STATUS.rpm" + NOT_USED.format("the speed has no sign"),
}
REFUSED = "the current is refreshed once a second; the speed has no sign"


def undecided(*reasons: Reason, provenance: dict[str, str] = PROVENANCE) -> Verdict:
    return unjudged(1, "elevator", *reasons, provenance=provenance)


@pytest.mark.parametrize(("before", "after"), [([], REFUSED), ([GAP], f"{REFUSED}; {GAP.text}")])
def test_an_undecided_actuator_names_what_no_equation_can_use(before: list[Reason], after: str) -> None:
    found = with_refused(undecided(*before))
    assert (found.reason, found.reason_codes) == (after, ("refused", *(one.code for one in before)))
    assert found.remedy == "record V5 and V7 as sampled at the motor, with sign"
    assert with_refused(found) == found


def test_a_verdict_without_anything_refused_stays_as_it_is() -> None:
    for one in (
        undecided(GAP, provenance={"V4": PROVENANCE["V4"]}),
        undecided(GAP).model_copy(update={"condition": "normal"}),
        undecided(GAP).model_copy(update={"condition": "unmonitored"}),
    ):
        assert with_refused(one) is one
