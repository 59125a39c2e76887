"""Named values of a servo, drafted into a profile that is used as it is."""

from __future__ import annotations

from pathlib import Path

import pytest

import mavhums
from mavhums.actuator.draft import draft_profile, guesses_for
from mavhums.actuator.profile import load_airframe
from tests.conftest import REAL_LOGS, needs

LUA = REAL_LOGS / "sitl" / "plane_lua_csrv.link1.tlog"


def test_each_output_gets_its_own_names_in_the_quantities_order() -> None:
    names = {"S1Pos", "S1Cmd", "S1V", "S1A", "S1Spd", "S1RPM", "S12Pos", "S1MT", "Pos", "XS1Pos"}
    found = {guess.key: guess.name for guess in guesses_for(1, names)}
    assert [*found] == ["V1", "V3", "V4", "V5", "V7", "V10"]
    assert [*found.values()] == ["S1Cmd", "S1Pos", "S1V", "S1A", "S1RPM", "S1Spd"]
    assert [guess.name for guess in guesses_for(12, names)] == ["S12Pos"]
    assert list(guesses_for(2, names)) == []


@needs(LUA)
def test_a_drafted_profile_finds_the_jam_unedited(tmp_path: Path) -> None:
    drafted = tmp_path / "drafted.toml"
    drafted.write_text(draft_profile(LUA), encoding="utf-8")
    assert drafted.read_text(encoding="utf-8").count("# GUESS") == 24
    mapped = load_airframe(drafted).actuators[0].fields
    names = {key: mapping.where["name"] for key, mapping in mapped.items()}
    assert names == {"V1": "S1Cmd", "V3": "S1Pos", "V4": "S1V", "V5": "S1A"}
    assessment = mavhums.analyse(LUA, mavhums.Options(airframe=drafted))
    verdicts = {v.actuator: v for v in assessment.verdicts if v.subject == "actuator"}
    jammed = verdicts.pop("aileron_1")
    assert jammed.worst == "emergency"
    jam = next(evidence for evidence in jammed.evidence if evidence.kind == "jam")
    assert jam.start_s == pytest.approx(91.0, abs=5.0)
    assert jam.end_s == pytest.approx(131.0, abs=8.0)
    assert len(verdicts) == 5
    for verdict in verdicts.values():
        assert verdict.worst in ("undecided", "learning")
        assert "own_too_slow" in verdict.reason_codes
