"""A live session and a fleet's store: judged by the flights there, and its recording is kept there."""

from __future__ import annotations

import json
import signal
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

import mavhums
from mavhums import fleet
from mavhums.app.settings import Options
from mavhums.core.errors import ExitCode
from mavhums.live.setup import LiveOptions, prepare
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim.link import EPOCH_US
from tests.conftest import Run
from tests.fleet.stores import add, row_of, write_store
from tests.flights import START, flown, shown, verdict
from tests.live.conftest import Rig, verdicts
from tests.live.programs import free_port, hearing

BEFORE = (datetime.fromtimestamp(EPOCH_US / 1e6, tz=UTC) - START).days - 100
FLIGHTS = [flown(verdict(shown(0.1)), day=BEFORE + day) for day in range(12)]


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with flights of an aircraft whose elevator has hardly any friction."""
    write_store(tmp_path / "store", {"D-A": FLIGHTS})
    return tmp_path / "store"


@pytest.mark.slow
def test_a_session_is_judged_by_the_flights_in_a_store(
    store: Path, worn_pieces: list[Piece], tmp_path: Path
) -> None:
    recording = tmp_path / "live.tlog"
    judging = Options(airframe="paper", store=store, aircraft="=D-A")
    session = prepare(LiveOptions(urls=[f"udpin:{free_port()}"], record=recording, judging=judging))
    session.take(list(worn_pieces))
    live = session.close()
    assert "friction_drift" in live.to_json()
    assert live.earlier_flights == 12
    kept = mavhums.analyse(recording, judging, keep=True)
    assert json.dumps(verdicts(kept)) == json.dumps(verdicts(live))
    assert fleet.status(store).judged == 13


@pytest.mark.slow
def test_the_board_names_the_aircraft_in_flight(worn_pieces: list[Piece], tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.hear(worn_pieces)
    board = rig.end().log.flight[0].board
    store = tmp_path / "store"
    rows = (row_of(flight, f"board {board}")._replace(board=board) for flight in FLIGHTS)
    add(store, *rows, compares=False)
    judging = Options(airframe="paper", store=store)
    session = prepare(LiveOptions(urls=[f"udpin:{free_port()}"], judging=judging))
    for start in range(0, len(worn_pieces), 200):
        session.take(list(worn_pieces[start : start + 200]))
        session.tick()
    live = session.close()
    assert "friction_drift" in live.to_json()
    assert live.earlier_flights == 12


@pytest.mark.slow
def test_the_recording_is_kept_at_the_end(
    store: Path, worn_pieces: list[Piece], tmp_path: Path, run: Run
) -> None:
    recording = tmp_path / "live.tlog"
    keep = ("--record", recording, "--store", store, "--keep", "--aircraft", "D-A")
    with hearing(tmp_path, worn_pieces, *keep) as live:
        time.sleep(0.5)
        code = live.stop(signal.SIGINT)
    assert f"{recording} is kept in {store}" in live.output
    assert len([log for log, _ in fleet.verdicts(store, "D-A") if log == str(recording)]) == 4
    assert fleet.scan([recording], store, fleet.ScanOptions(workers=0)) == (0, 0, 1)
    again = run("analyse", recording, "--json", "--aircraft", "=D-A", "--store", store)
    assert code == again.code


def test_what_is_missing_is_reported_before_the_start(run: Run, store: Path, tmp_path: Path) -> None:
    for more, code, reason in (
        (("--store", tmp_path / "absent"), ExitCode.ERROR, "no store of flights"),
        (("--store", store, "--keep"), ExitCode.USAGE, "--record FILE"),
    ):
        refused = run("live", f"udpin:{free_port()}", "--duration", "1", *more)
        assert refused.code == code
        assert reason in refused.err


def test_nothing_received_is_nothing_kept(run: Run, store: Path, tmp_path: Path) -> None:
    keep = ("--record", tmp_path / "live.tlog", "--store", store, "--aircraft", "D-A", "--keep")
    outcome = run("live", f"udpin:{free_port()}", "--duration", "0.2", *keep)
    assert outcome.code == ExitCode.ERROR
    assert "nothing was recorded" in outcome.err
    assert fleet.status(store).judged == 12
