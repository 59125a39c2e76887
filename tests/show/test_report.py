from __future__ import annotations

import re

import pytest

from mavhums.core.quantities import KEYS
from mavhums.results.assessment import Assessment
from mavhums.results.sections import FlightCopy, FlightIdentity
from mavhums.results.verdict import ALL, Evidence, Indicator, Interval, Since, Suspect
from mavhums.show.markdown_report import anonymous, markdown
from tests.show.conftest import new_assessment, new_verdict


def test_every_quantity_names_its_source() -> None:
    verdict = new_verdict("elevator", "normal", 0.2, 0.0)
    sources = {key: value for key, value in verdict.provenance.items() if key != "V11"}
    text = markdown(new_assessment(verdict.model_copy(update={"provenance": sources})))
    found = re.findall(r"^\| (V\d+) .* \| elevator \| DEBUG_FLOAT_ARRAY", text, re.MULTILINE)
    assert found == [key for key in KEYS if key != "V11"]
    assert "| telemetry tier | elevator | instrumented |" in text


def test_actuators_whose_sources_differ_in_numbers_share_a_row(assessment: Assessment) -> None:
    text = markdown(assessment)
    assert text.count("came from") == 1
    names = "elevator, rudder, aileron_left and aileron_right"
    row = rf"| V2 rotor rotation, ° | {names} | DEBUG_FLOAT_ARRAY\[EMA,3, 4, 1 and 2\].data\[1\] |"
    assert row in text


def test_a_log_without_a_profile_speaks_of_every_actuator() -> None:
    nothing = new_verdict("rudder", "undecided", 0.0, None, actuator=ALL)
    assert "## every actuator: undecided" in markdown(new_assessment(nothing))


def test_what_was_an_emergency_is_not_forgotten() -> None:
    verdict = new_verdict("elevator", "emergency", 0.3, 90.0, condition="normal")
    text = markdown(new_assessment(verdict))
    assert text.startswith("# EMERGENCY: elevator: friction 0.300 N·m (limit 0.875), 37.0s–1m40s, then ")
    assert "**EMERGENCY** 37.0s–1m40s, then normal" in text
    assert "- Now: normal since 1m30s" in text
    without = markdown(new_assessment(verdict.model_copy(update={"since": None, "evidence": ()})))
    assert "- Now: normal at the end" in without
    assert "**Why:**" not in without


def test_an_emergency_by_other_means_than_friction() -> None:
    bare = {"friction_nm": None, "network": None, "since": None}
    suspects = (Suspect(fault="friction", confidence=0.1), Suspect(fault="jam", confidence=0.9))
    verdict = new_verdict("elevator", "emergency", 1.0, 3.0, **bare, suspects=suspects)
    text = markdown(new_assessment(verdict))
    assert text.startswith("# EMERGENCY: elevator: friction 1.00 N·m (limit 0.875)\n")
    assert "inspect gearbox and linkage for a blockage" in text
    assert "| 91 of 91 s |" in text
    odd = verdict.model_copy(update={"suspects": (Suspect(fault="demagnetised", confidence=0.9),)})
    assert "inspect the actuator and its wiring" in markdown(new_assessment(odd))


def test_texts_from_outside_stay_texts() -> None:
    name = "a|b\n# x <b>[l](u) `c` \x1b[31m"
    verdict = new_verdict("elevator", "normal", 0.2, 0.0, actuator=name)
    text = markdown(new_assessment(verdict))
    row = next(line for line in text.splitlines() if line.startswith(r"| a\|"))
    assert row.startswith(r"| a\|b�# x \<b>\[l\](u) \`c\` �\[31m | normal |")
    assert "\x1b" not in text


def test_since_outlives_rounding() -> None:
    late = Since(flight_time_s=59.96, utc="2025-06-01T10:00:59Z")
    verdict = new_verdict("elevator", "degraded", 0.5, 1.0, since=late)
    assert markdown(new_assessment(verdict)).startswith("# DEGRADED: elevator degraded since 1m00s\n")


def test_evidence_of_any_kind_is_shown_and_of_very_much_the_first_and_the_last() -> None:
    one = Evidence(kind="supply_sag", start_s=0, end_s=1, value=0.0, limit=2.0, rule="below the bus")
    times = ({"start_s": float(k), "end_s": k + 1.0, "value": k / 10} for k in range(60))
    many = tuple(one.model_copy(update=each) for each in times)
    text = markdown(new_assessment(new_verdict("elevator", "degraded", evidence=many)))
    assert "- 19.0s to 20.0s: supply sag 1.9, below the bus\n- … 20 more findings" in text
    assert "- 59.0s to 1m00s: supply sag 5.9, below the bus" in text
    assert text.count(": supply sag") == 40 + 1  # the headline has the last


def test_indicators_of_a_suspect_are_in_a_table() -> None:
    value = Interval(estimate=0.21, low=0.19, high=0.23)
    own = Interval(estimate=0.05, low=0.04, high=0.06)
    for baseline, end in ((own, " 0.040 to 0.060 |"), (None, "\n")):
        backlash = Indicator(
            fault="backlash", quantity="dead band", unit="°", value=value, windows=9, baseline=baseline
        )
        text = markdown(new_assessment(new_verdict("elevator", "degraded", indicators=(backlash,))))
        assert f"| dead band, ° | 0.210 (0.190 to 0.230) | — |{end}" in text


@pytest.mark.parametrize(
    ("low", "high", "cell"),
    [
        (-0.00473, 0.00279, "-0.0010 (-0.0047 to 0.0028)"),
        (22.579, 22.669, "22.624 (22.579 to 22.669)"),
        (-230.0, 250.0, "10 (-230 to 250)"),
        (-0.00390, 0.00382, "0.0000 (-0.0039 to 0.0038)"),
        (0.2, 0.2, "0.200 (0.200 to 0.200)"),
    ],
)
def test_a_figure_has_as_many_digits_as_its_interval_supports(low: float, high: float, cell: str) -> None:
    value = Interval(estimate=(low + high) / 2, low=low, high=high)
    shown = Indicator(fault="x", quantity="loss", unit="1", value=value, windows=9, limit=0.08)
    verdict = new_verdict("elevator", "degraded", 0.5, 1.0, indicators=(shown,))
    assert f"| loss | {cell} | 0.08 |" in markdown(new_assessment(verdict))


def test_an_answer_to_publish_names_no_folder_and_no_board(assessment: Assessment) -> None:
    update = {
        "path": r"C:\logs of Jane\a.tlog",
        "flight": (FlightIdentity(vehicle=1, board="0BADC0DE"),),
        "copies": (FlightCopy(vehicle=1, log="/home/jane/b.BIN", sha256=None, counts=True),),
        "notices": ("the board is 0BADC0DE, not 77", "not compared with earlier flights"),
    }
    log = anonymous(assessment.model_copy(update={"log": assessment.log.model_copy(update=update)})).log
    assert (log.path, log.copies[0].log) == ("a.tlog", "b.BIN")
    assert log.notices == ("not compared with earlier flights",)
