"""The simulator's on-board log: DFReader reads it, and it is judged as the telemetry log is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mavhums import analyse, read_log
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Verdict
from mavhums_sim import Flight, FlightRecord, fly, write_dataflash, write_tlog
from mavhums_sim.link import BOOT_US, EPOCH_US
from tests.conftest import Run
from tests.log.dataflash.peer import by_dfreader, differing_columns
from tests.present import present

NOT_IN_CSRV = [1, 5, 7, 8, 10, 11]  # but V7, which follows from V10


@pytest.fixture(scope="module")
def record() -> FlightRecord:
    worn = {"elevator": (1.0, 1.0), "rudder": (0.6, 0.6)}
    return fly(Flight(11, 40.0, worn, rate_hz=50.0, tiers=("csrv", "pwm")))


@pytest.fixture(scope="module")
def on_board(record: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("on_board") / "flight.BIN"
    write_dataflash(record, path)
    return path


def test_dfreader_reads_what_was_flown(record: FlightRecord, on_board: Path) -> None:
    theirs = by_dfreader(on_board)
    assert differing_columns(read_log(on_board).tables, theirs) == []
    fields, rows = theirs["CSRV"]
    own = np.array([row for row in rows if row[fields.index("Id")] == 2], dtype=np.float64)
    flown = record.actuators["elevator"]
    assert np.array_equal(own[:, 0], BOOT_US + np.rint(flown.time_s * 1e6))
    assert np.allclose(own[:, fields.index("Pos")], flown.values[:, 2], rtol=1e-6)
    assert np.allclose(own[:, fields.index("Speed")] / 6, flown.values[:, 9], rtol=1e-6, atol=1e-9)
    assert np.allclose(own[:, fields.index("A")], flown.esc[:, 1], rtol=1e-6)


def test_the_date_is_the_flights(on_board: Path) -> None:
    log = read_log(on_board)
    assert log.span is not None
    assert abs(log.span[0] - EPOCH_US) <= 1000
    assert not log.losses.any


def test_what_no_on_board_log_carries_is_refused(simulate: Run, tmp_path: Path) -> None:
    path = tmp_path / "flight.BIN"
    with pytest.raises(ValueError, match="no tier 'instrumented'"):
        write_dataflash(fly(Flight(duration_s=2.0)), path)
    assert not path.exists()
    refused = simulate("flight", "-o", path, "--duration", "2", "--tier", "instrumented")
    assert refused.code == 2
    assert "no tier" in refused.err


def by_actuator(assessment: Assessment) -> dict[str, Verdict]:
    return {verdict.actuator: verdict for verdict in assessment.verdicts}


@pytest.mark.slow
def test_a_flight_recorded_twice_gets_the_same_verdicts(
    record: FlightRecord, on_board: Path, tmp_path: Path
) -> None:
    """The telemetry log carries what CSRV carries, and nothing else of the actuators."""
    carried = np.where(np.isin(np.arange(12), NOT_IN_CSRV), np.nan, 1.0)
    actuators = {name: replace(one, values=one.values * carried) for name, one in record.actuators.items()}
    flight = replace(record.flight, tiers=("instrumented", "pwm"))
    write_tlog(replace(record, actuators=actuators, flight=flight), tmp_path / "flight.tlog")
    ours, theirs = by_actuator(analyse(on_board)), by_actuator(analyse(tmp_path / "flight.tlog"))
    healthy = dict.fromkeys(("aileron_left", "aileron_right"), "normal")
    assert {name: verdict.condition for name, verdict in ours.items()} == healthy | {
        "elevator": "emergency",
        "rudder": "degraded",
    }
    for name, verdict in ours.items():
        other = theirs[name]
        assert (verdict.condition, verdict.worst) == (other.condition, other.worst)
        assert verdict.tier == "csrv"
        estimates = [present(one.friction_nm).estimate for one in (verdict, other)]
        assert estimates[0] == pytest.approx(estimates[1], abs=0.01)
        assert {s.fault for s in verdict.suspects} == {s.fault for s in other.suspects}


def test_the_command_line_writes_one(simulate: Run, tmp_path: Path) -> None:
    path = tmp_path / "flight.BIN"
    assert simulate("flight", "-o", path, "--duration", "3").code == 0
    truth = json.loads((tmp_path / "flight.truth.json").read_text())
    assert truth["flights"][0]["tiers"] == ["csrv", "esc-unsigned", "pwm"]
    assert len(read_log(path).tables["CSRV"]) == 1200
