"""Logs are scanned as they land: whole, each reported once, and whatever else goes wrong."""

from __future__ import annotations

import signal
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import pytest

from mavhums import Options, fleet
from mavhums.core.errors import MavhumsError
from mavhums.fleet.watch import LogWatcher
from mavhums.flights.store import database
from tests.conftest import Run
from tests.fleet_logs import moved, small

SETTLE_S = 60.0


@pytest.fixture(scope="module")
def data() -> bytes:
    return small(friction_nm=1.0, seconds=12.0)


@pytest.fixture
def inbox(tmp_path: Path) -> Path:
    folder = tmp_path / "inbox" / "D-W"
    folder.mkdir(parents=True)
    return folder


def watching(inbox: Path, store: Path) -> LogWatcher:
    options = fleet.ScanOptions(judging=Options(aircraft="folder"), workers=0)
    return LogWatcher([inbox.parent], store, options, settle_s=SETTLE_S)


@pytest.mark.slow
def test_a_log_is_judged_once_it_no_longer_changes_and_a_bad_one_stops_nothing(
    inbox: Path, tmp_path: Path, data: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = tmp_path / "store"
    watch = watching(inbox, store)
    log = inbox / "0.tlog"
    log.write_bytes(data[: len(data) // 2])
    (inbox / "bad.tlog").write_bytes(b"no log")
    assert watch.look(0.0) == []
    log.write_bytes(data)
    (bad,) = watch.look(SETTLE_S)
    assert "bad.tlog" in (bad.problem or "")
    assert watch.look(2 * SETTLE_S - 1) == [], "the log has grown since"
    (landed,) = watch.look(2 * SETTLE_S)
    assert (landed.aircraft, landed.problem) == ("D-W", None)
    assert [one.actuator for one in landed.findings] == ["elevator"]
    assert landed.conditions["emergency"] == 1
    (inbox / "1.tlog").write_bytes(moved(data, 86_400.0))
    assert watch.look(2 * SETTLE_S + 1) == []
    monkeypatch.setattr(database, "_PATIENCE_S", 0.0)
    with closing(sqlite3.connect(store)) as base:
        base.execute("BEGIN IMMEDIATE")
        with pytest.raises(MavhumsError, match="cannot be written"):
            watch.look(4 * SETTLE_S)
    (later,) = watch.look(4 * SETTLE_S + 1)
    assert later.path.endswith("1.tlog")
    assert watch.look(9 * SETTLE_S) == []
    again = watching(inbox, store)
    assert again.look(0.0) == again.look(SETTLE_S) == [], "the store has them"
    assert fleet.status(store).judged == 2


@pytest.mark.slow
def test_the_command_prints_a_line_a_log_and_ends_cleanly(
    run: Run, inbox: Path, tmp_path: Path, data: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    (inbox / "0.tlog").write_bytes(data)
    (inbox / "bad.tlog").write_bytes(b"no log")
    monkeypatch.setitem(sys.modules, "distributed", None)  # without workers it is not needed
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("mavhums.cli.fleet_scan.time.sleep", lambda _: signal.raise_signal(signal.SIGTERM))
    try:
        watch = ("fleet", "watch", inbox.parent, "--store", tmp_path / "store", "--aircraft", "folder")
        outcome = run(*watch, "--workers", "0", "--settle", "0")
    finally:
        signal.signal(signal.SIGTERM, before)
    assert outcome.code == 0
    assert "D-W: elevator EMERGENCY since flight 1 of 1" in outcome.out
    assert sum("bad.tlog" in line for line in outcome.out.splitlines()) == 1
    assert "stopped watching" in outcome.err


def test_a_mistake_ends_the_watch_before_it_begins(run: Run, tmp_path: Path) -> None:
    outcome = run("fleet", "watch", tmp_path / "nowhere", "--store", tmp_path / "store")
    assert outcome.code == 1
    assert "no such file or folder" in outcome.err
