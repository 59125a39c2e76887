"""A profile maps records of an on-board log, whose fields the log itself defines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums_sim import Flight, fly, write_dataflash
from tests.conftest import Run
from tests.log.ulog import writer

PROFILE = """\
name = "mine"
[[actuators]]
name = "flap"
servo = 30
pwm_us = [1000, 1500, 2000]
[actuators.fields.{key}]
message = "{message}"
field = "{field}"
where = {where}
scale = 2.0
"""


def profile(tmp_path: Path, key: str, message: str, field: str, where: str = "{}") -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(PROFILE.format(key=key, message=message, field=field, where=where), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def card(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("card") / "card.BIN"
    write_dataflash(fly(Flight(seed=2, duration_s=5.0, rate_hz=25.0, tiers=("csrv", "pwm"))), path)
    return path


@pytest.fixture
def ulog(tmp_path: Path) -> Path:
    path = tmp_path / "flight.ulg"
    path.write_bytes(writer.flight(5.0))
    return path


def exported(run: Run, log: Path, airframe: Path, tmp_path: Path) -> pd.DataFrame:
    outcome = run("export", log, "-o", tmp_path / "o.csv", "--airframe", airframe)
    assert outcome.code == ExitCode.OK, outcome.err
    return pd.read_csv(tmp_path / "o.csv")


def test_a_record_of_ardupilots_card_is_mapped(run: Run, card: Path, tmp_path: Path) -> None:
    table = mavhums.read_log(card, messages=["CSRV"]).messages["CSRV"]
    found = exported(run, card, profile(tmp_path, "V3", "CSRV", "Pos", "{ Id = 2 }"), tmp_path)
    expected = table.loc[table["Id"] == 2, "Pos"].to_numpy(dtype=np.float64)
    assert len(expected) > 50
    np.testing.assert_allclose(found["V3"], 2 * expected)


@pytest.mark.parametrize(
    ("message", "field", "where"),
    [("esc_status", "esc[3].esc_current", "{}"), ("actuator_outputs", "output[0]", "{ multi_id = 1 }")],
)
def test_a_topic_of_px4s_card_is_mapped(
    run: Run, ulog: Path, tmp_path: Path, message: str, field: str, where: str
) -> None:
    table = mavhums.read_log(ulog, messages=[message]).messages[message]
    if "multi_id" in where:
        table = table[table["component"] == 1]
    found = exported(run, ulog, profile(tmp_path, "V7", message, field, where), tmp_path)
    assert len(found) == len(table) > 20
    np.testing.assert_allclose(found["V7"], 2 * table[field].to_numpy(dtype=np.float64))


@pytest.mark.parametrize(
    ("message", "field", "where", "problem", "remedy"),
    [
        ("CSRV", "Posn", "{ Id = 2 }", "flap: fields.V3.field: CSRV has no field Posn", "did you mean Pos"),
        ("CSRV", "Pos", "{ Idd = 2 }", "flap: fields.V3.where: CSRV has no field Idd", "did you mean Id"),
        ("CSRV", "Pos", '{ Id = "2" }', "Id of CSRV is a number", "compare with a number"),
        ("CSRV", "Pos[1]", "{ Id = 2 }", "Pos of CSRV is no array", "write Pos"),
        ("MSG", "Message", "{}", "Message of MSG is text", "map a number"),
    ],
)
def test_what_the_log_does_not_define_is_named(
    run: Run, card: Path, tmp_path: Path, message: str, field: str, where: str, problem: str, remedy: str
) -> None:
    airframe = profile(tmp_path, "V3", message, field, where)
    for command in (("analyse", card), ("export", card, "-o", tmp_path / "o.csv")):
        outcome = run(*command, "--airframe", airframe)
        assert outcome.code == ExitCode.ERROR
        assert problem in outcome.err
        assert remedy in outcome.err


def test_a_record_that_the_log_does_not_have_gives_no_telemetry(run: Run, card: Path, tmp_path: Path) -> None:
    outcome = run("inspect", card, "--airframe", profile(tmp_path, "V3", "SERV", "Pos"))
    assert outcome.code == ExitCode.OK
    verdicts = mavhums.analyse(card, mavhums.Options(airframe=tmp_path / "mine.toml")).verdicts
    [verdict] = [each for each in verdicts if each.subject == "actuator"]
    assert verdict.condition in ("undecided", "unmonitored")
    assert verdict.remedy
