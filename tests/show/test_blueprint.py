from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from mavhums.core.quantities import KEYS
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Verdict
from tests.show.conftest import new_assessment, new_verdict

pytest.importorskip("rerun", reason="layouts need the extra 'viewer'")

from mavhums.show.blueprint import Lane, Surroundings, layout

EVENTS = "Events: click one to go there"
ALL = frozenset({*KEYS, "network"})
FRICTION = {"friction": ("Friction, N·m", "/x/friction")}


def names(part: Any) -> Iterator[str]:
    if getattr(part, "name", None):
        yield str(part.name)
    for child in getattr(part, "contents", ()):
        if not isinstance(child, str):
            yield from names(child)


def lane(verdict: Verdict, present: frozenset[str]) -> Lane:
    root = f"/vehicle_1/{verdict.actuator}"
    return Lane(
        root, verdict.actuator, verdict.condition, verdict.worst, present, FRICTION if "V3" in present else {}
    )


def tree(assessment: Assessment, **present: frozenset[str]) -> list[str]:
    ranked = [verdict for verdict in assessment.ranked() if verdict.actuator in present]
    lanes = [lane(verdict, present[verdict.actuator]) for verdict in ranked]
    return list(names(layout(lanes).root_container))


def test_the_answer_comes_first_then_the_worst_actuator(assessment: Assessment) -> None:
    found = tree(assessment, aileron_left=ALL, elevator=ALL, rudder=ALL)
    assert found[:4] == [
        "Condition of every axis and actuator",
        "elevator: emergency",
        "Friction, N·m",
        "Network: classes",
    ]
    assert found.index("rudder: undecided") < found.index("aileron_left: normal") < found.index(EVENTS)
    assert found[-1] == "Report"
    live = layout([Lane("/vehicle_1/elevator", "elevator", "normal", "normal", ALL)], live=True)
    assert [*names(live.root_container)][-1] == EVENTS


def test_all_twelve_quantities_are_named_with_their_units(assessment: Assessment) -> None:
    titles = [name for name in tree(assessment, elevator=ALL) if name.startswith("V")]
    shown = " ".join(titles).replace(",", "").split()
    assert {*KEYS} <= {*shown}
    assert {"V1, V3 angle, °", "V6, V9, V12 power, W", "V5 supply current, A"} <= {*titles}


def test_what_is_absent_gets_no_plot(assessment: Assessment) -> None:
    found = tree(assessment, elevator=frozenset({"V3"}), rudder=frozenset())
    assert "V3 angle, °" in found
    assert not [name for name in found if name.startswith("Network") or name.startswith("rudder")]
    only = tree(assessment, elevator=frozenset({"network"}))
    assert only[1:] == ["elevator: emergency", "Network: classes", "P(fault)", EVENTS, "Report"]


def test_a_tab_says_what_was_worse() -> None:
    verdict = new_verdict("elevator", "emergency", 0.3, 90.0, condition="normal")
    assert "elevator: normal, was emergency" in tree(new_assessment(verdict), elevator=ALL)


def test_many_actuators_leave_room_below() -> None:
    lanes = [Lane(f"/vehicle_1/servo_{k}", f"servo_{k}", "normal", "normal", ALL) for k in range(32)]
    left: Any = next(iter(layout(lanes).root_container.contents))
    assert left.row_shares[0] == pytest.approx(0.5)


def test_beside_the_actuators_are_modes_airframe_and_map() -> None:
    one = Lane("/vehicle_1/elevator", "elevator", "normal", "normal", ALL)
    around = Surroundings(("/flight_mode/vehicle_1",), "/airframe/vehicle_1", ("/position/vehicle_1",))
    found = list(names(layout([one], around).root_container))
    assert found[-4:] == ["Airframe, seen from behind", "Where it was", EVENTS, "Report"]
    bare = list(names(layout([one]).root_container))
    assert not {"Airframe, seen from behind", "Where it was"} & set(bare)
