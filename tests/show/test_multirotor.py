"""A multirotor in report, recording and tables: each motor where it sits, in the colour of its condition."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mavhums.core.conditions import Condition
from mavhums.health.decision.events import ConditionChanged
from mavhums.results.assessment import Assessment
from mavhums.results.sections import OutputUsage, VehicleUsage
from mavhums.results.verdict import Coverage, Interval, Verdict
from mavhums.show.curves import EvidenceCollector
from mavhums.show.headline import headline
from mavhums.show.html import page
from mavhums.show.markdown_report import markdown
from mavhums.show.outline import motors, multirotor
from mavhums.show.tables import usage
from mavhums.show.words import place_of
from tests.show.conftest import new_assessment

PLACES = {"motor 1": 45.0, "motor 2": -135.0, "motor 3": -45.0, "motor 4": 135.0}


def output(servo: int, name: str, bearing: float) -> OutputUsage:
    return OutputUsage(
        servo=servo, name=name, named_by="parameters", commanded=True, range_us=(1150, 1150, 1950),
        least_us=1150, greatest_us=1950, span=1.0, travelled_us=800, travelled=1.0, reversals=0,
        held_s=60.0, at_low_s=0.0, at_high_s=6.0, mean_us=1550.0, bearing_deg=bearing,
    )  # fmt: skip


@pytest.fixture
def assessment() -> Assessment:
    lost = Verdict(
        subject="motor", vehicle=1, actuator="motor 3", condition="emergency", worst="emergency",
        effectiveness=Interval(estimate=0.1, low=0.0, high=0.2),
        coverage=Coverage(moving_fraction=0.8, windows=60, decidable=50),
    )  # fmt: skip
    outputs = tuple(output(servo, *place) for servo, place in enumerate(PLACES.items(), 1))
    flown = {"kind": "quadrotor", "firmware": "ArduPilot", "armed_s": 60.0, "forward_s": 0.0}
    used = VehicleUsage.model_validate({"vehicle": 1, "outputs": outputs} | flown)
    return new_assessment(lost, usage=(used,))


def test_each_motor_is_drawn_where_it_sits(assessment: Assessment) -> None:
    parts, body = multirotor(motors(assessment, 1), assessment.verdicts)
    assert [part.name for part in parts] == list(PLACES)
    assert [part.condition for part in parts] == ["undecided", "undecided", "emergency", "undecided"]
    middle_x, middle_y = 160.0, 156.0
    for part in parts:
        assert (part.x > middle_x) == (PLACES[part.name] > 0), "right of the nose is right"
        assert (part.y < middle_y) == (abs(PLACES[part.name]) < 90), "the nose is up"
    assert len(body) == len(parts) + 2
    assert motors(assessment, 2) == {}


def test_report_and_tables_speak_of_motors(assessment: Assessment) -> None:
    text = page(assessment, EvidenceCollector())
    drawn = re.findall(r'<g class="(\w+)"><title>(motor \d): \w+</title>', text)
    assert ("emergency", "motor 3") in drawn
    assert "thrust left" in text
    assert "10 % (0–20)" in text
    assert "thrust left" in markdown(assessment)
    assert "control left" not in markdown(assessment)
    assert headline(assessment).text.startswith("motor 3 (front left) ")
    [table] = [usage(used, several=False) for used in assessment.usage]
    assert table.rows[2] == ["motor 3 (servo 3)", "front left", "50 %", "100 %", "10 %"]
    assert not re.search("trim|surface|stops", " ".join(column.title for column in table.columns))


def test_an_octas_places_differ() -> None:
    places = [place_of(angle) for angle in (22.5, 67.5, 112.5, 157.5, -22.5, -67.5, -112.5, -157.5)]
    assert len(set(places)) == 8


def test_the_recording_draws_the_motors_in_their_colours(assessment: Assessment, tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk")
    from tests.show.test_recording import write

    why = "emergency: motor 3 of quad X lost 90 % of its thrust"
    alarm = ConditionChanged(1, "motor 3", 20.0, 19.5, "undecided", "emergency", why)
    path = write(tmp_path / "c.rrd", [alarm], assessment)
    coloured: dict[str, list[bool]] = {}
    changes = 0
    for part in chunk.RrdReader(path).stream():
        columns = part.to_record_batch().schema.names
        if part.entity_path.endswith("/part") and any("colors" in column for column in columns):
            name = part.entity_path.split("/")[-2].replace("\\", "")
            coloured.setdefault(name, []).append(part.is_static)
            changes += part.to_record_batch().num_rows
    assert sorted(coloured) == sorted(PLACES)
    assert not any(map(any, coloured.values())), "a static colour would hide those of the conditions"
    assert changes > len(PLACES), "the lost motor's changes"


@pytest.mark.parametrize("condition", ["normal", "undecided"])
def test_a_motor_that_never_changes_has_the_condition_of_its_verdict(
    condition: Condition, assessment: Assessment, tmp_path: Path
) -> None:
    pytest.importorskip("rerun.chunk")
    from tests.show.test_recording import rows, write

    [lost] = assessment.verdicts
    verdict = lost.model_copy(update={"condition": condition, "worst": condition, "effectiveness": None})
    path = write(tmp_path / "c.rrd", [], new_assessment(verdict))
    assert rows(path, "/vehicle_1/motor_3", "StateChange:state")[1] == [[condition]]


@pytest.mark.parametrize(("least_us", "range_us"), [(1498, "never commanded"), (None, "no pulse in the log")])
def test_an_output_that_the_log_does_not_record_is_not_called_at_rest(
    least_us: int | None, range_us: str, assessment: Assessment
) -> None:
    at_rest = {"name": "rudder", "commanded": False, "bearing_deg": None, "least_us": least_us}
    rudder = assessment.usage[0].outputs[0].model_copy(update=at_rest)
    used = assessment.usage[0].model_copy(update={"outputs": (rudder,)})
    [row] = usage(used, several=False).rows
    assert row[:2] == ["rudder (servo 1)", range_us]
