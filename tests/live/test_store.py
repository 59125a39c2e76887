"""A live session and a fleet's store: judged by the flights there, and its recording is kept there."""

from __future__ import annotations

import json
import signal
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from mavhums import fleet
from mavhums.app.settings import Options
from mavhums.core.errors import ExitCode
from mavhums.live.setup import LiveOptions, prepare
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim.link import EPOCH_US
from tests.conftest import Run
from tests.fleet.stores import write_store
from tests.flights import START, flown, shown, verdict
from tests.live.conftest import verdicts
from tests.live.programs import free_port, running
from tests.live.programs import mavhums as command
from tests.live.test_command import send

NOW = datetime.fromtimestamp(EPOCH_US / 1e6, tz=UTC)


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with flights of an aircraft whose elevator has hardly any friction."""
    before = -(START - NOW).days - 100
    flights = [flown(verdict(shown(0.1)), day=before + day) for day in range(12)]
    write_store(tmp_path / "store", {"D-A": flights})
    return tmp_path / "store"


@pytest.mark.slow
def test_a_session_is_judged_by_the_flights_in_a_store(
    store: Path, worn_pieces: list[Piece], tmp_path: Path
) -> None:
    recording = tmp_path / "live.tlog"
    history, since = fleet.past(store, "D-A", NOW)
    assert not since
    address = f"udpin:{free_port()}"
    session = prepare(
        LiveOptions(urls=[address], record=recording, judging=Options(airframe="paper", history=history))
    )
    session.take(list(worn_pieces))
    live = session.close()
    assert "friction_drift" in live.to_json()
    judging = Options(airframe="paper", aircraft="=D-A")
    (kept,) = fleet.keep([recording], store, judging)
    assert kept.assessment
    assert json.dumps(verdicts(kept.assessment)) == json.dumps(verdicts(live))
    assert fleet.status(store).judged == 13


@pytest.mark.slow
def test_a_renamed_aircraft_has_its_flights_under_either_name(store: Path) -> None:
    before = fleet.past(store, "D-A", NOW).history.flights
    fleet.rename(store, "D-A", "D-B")
    assert len(before) == 12
    assert [fleet.past(store, name, NOW).history.flights for name in ("D-A", "D-B")] == [before, before]
    assert fleet.past(store, "D-C", NOW).history.flights == ()


@pytest.mark.parametrize("place", ["store", "flights"])
@pytest.mark.slow
def test_the_recording_is_kept_at_the_end(
    place: str, store: Path, worn_pieces: list[Piece], tmp_path: Path, run: Run
) -> None:
    port, recording = free_port(), tmp_path / "live.tlog"
    named = ("--aircraft", "D-A") if place == "store" else ()
    keep = ("--record", recording, "--history", tmp_path / place, "--keep", *named)
    with running(tmp_path, "live", *command("live", f"udpin:{port}", *keep)) as live:
        live.wait_for(lambda: "listening: udpin:127.0.0.1:" in live.output)
        send(port, worn_pieces)
        time.sleep(0.5)
        code = live.stop(signal.SIGINT)
    assert f"{recording} is kept in {tmp_path / place}" in live.output
    if place == "store":
        told = [one for log, one in fleet.verdicts(store, "D-A") if log == str(recording)]
        options = fleet.ScanOptions(workers=0)
        assert fleet.scan([recording], store, options) == (0, 0, 1)
    else:
        (file,) = (tmp_path / place).glob("live-*.json")
        told = list(json.loads(file.read_text())["assessment"]["verdicts"])
    assert len(told) == 4
    again = run("analyse", recording, "--json", *(("--aircraft", "=D-A") if named else ()))
    assert code == again.code


def test_what_is_missing_is_told_before_the_start(run: Run, store: Path, tmp_path: Path) -> None:
    for more, told in (
        (("--history", store), "name --aircraft NAME"),
        (("--history", tmp_path / "flights", "--aircraft", "D-A"), "name --history STORE"),
        (("--history", store, "--aircraft", "D-A", "--keep"), "--record FILE"),
        (("--history", store, "--aircraft", "D-A", "--baseline-from", "2026-03-01"), "fleet repairs"),
    ):
        refused = run("live", f"udpin:{free_port()}", "--duration", "1", *more)
        assert refused.code == ExitCode.USAGE
        assert told in refused.err


def test_nothing_received_is_nothing_kept(run: Run, store: Path, tmp_path: Path) -> None:
    keep = ("--record", tmp_path / "live.tlog", "--history", store, "--aircraft", "D-A", "--keep")
    outcome = run("live", f"udpin:{free_port()}", "--duration", "0.2", *keep)
    assert outcome.code == ExitCode.ERROR
    assert "nothing was recorded" in outcome.err
    assert fleet.status(store).judged == 12
