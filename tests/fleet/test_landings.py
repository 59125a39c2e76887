"""A landing after the other, each a command of its own: nothing piles up, no needless word is said."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from mavhums_sim import Flight, fly, write_tlog
from tests.fleet_logs import moved
from tests.flights import flown, verdict

pytest.importorskip("deltalake")
pytest.importorskip("duckdb")

from mavhums import fleet
from mavhums.flights import store as stores
from mavhums.flights.store_tables import LOGS, SETTLED, Tables
from tests.fleet.stores import row_of

HOUR_S = 3_600.0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("landings") / "flight.tlog"
    write_tlog(fly(Flight(1, 12.0, rate_hz=25.0, tiers=("instrumented",))), path)
    return path.read_bytes()


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    called = [sys.executable, "-m", "mavhums", *map(str, arguments)]
    return subprocess.run(called, capture_output=True, text=True, check=False, timeout=300)


def landed(log: bytes, folder: Path, number: int) -> Path:
    path = folder / "D-A" / f"{number:03}.tlog"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(moved(log, HOUR_S * number))
    return path


@pytest.mark.slow
def test_small_files_are_joined_while_flights_land(
    log: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stores, "_COMPACT_FILES", 3)
    options = fleet.ScanOptions(aircraft="folder", workers=0)
    for number in range(6):
        assert fleet.scan([landed(log, tmp_path, number)], tmp_path / "store", options) == (1, 0, 0)
    tables = Tables(str(tmp_path / "store"))
    assert max(tables.files(LOGS), tables.files(SETTLED)) <= 3
    assert len({path for path, _ in fleet.verdicts(tmp_path / "store", "D-A")}) == 6


@pytest.mark.parametrize(("age_days", "removed"), [(6.9, False), (7.1, True)])
def test_joining_removes_files_that_no_version_of_the_last_week_needs(
    tmp_path: Path, age_days: float, removed: bool
) -> None:
    store, tables = stores.Store(tmp_path), Tables(str(tmp_path))
    for day in range(2):
        store.add_logs([row_of(flown(verdict(), day=day), "D-A")])
    small = {*(tmp_path / LOGS).glob("*.parquet")}
    tables.compact(LOGS)
    for entry in (tmp_path / LOGS / "_delta_log").glob("*.json"):
        aged = re.sub(
            r'(?<="deletionTimestamp":)\d+',
            lambda found: str(int(found[0]) - round(age_days * 86_400_000)),
            entry.read_text(encoding="utf-8"),
        )
        entry.write_text(aged, encoding="utf-8")
    Tables(str(tmp_path)).compact(LOGS)
    left = {*(tmp_path / LOGS).glob("*.parquet")}
    assert len(small) == 2
    assert len(left - small) == 1
    assert left & small == (set() if removed else small)
    assert len(stores.Store(tmp_path).query("SELECT * FROM logs").fetchall()) == 2


@pytest.mark.slow
def test_a_scan_whose_tidying_fails_has_not_failed(
    log: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def gone(*_: object) -> None:
        raise AttributeError("no longer there")

    monkeypatch.setattr(stores, "_COMPACT_FILES", 0)
    monkeypatch.setattr(Tables, "compact", gone)
    options = fleet.ScanOptions(aircraft="folder", workers=0)
    assert fleet.scan([landed(log, tmp_path, 0)], tmp_path / "store", options) == (1, 0, 0)
    assert "small files could not be joined: no longer there" in caplog.text
    assert fleet.verdicts(tmp_path / "store", "D-A")


@pytest.mark.slow
def test_fleet_commands_say_nothing_on_standard_error(log: bytes, tmp_path: Path) -> None:
    store = tmp_path / "store"
    command("warm-up")
    for arguments in (
        ("scan", landed(log, tmp_path, 0), "--to", store, "--aircraft", "folder", "--workers", "0"),
        ("status", store),
        ("worst", store),
        ("trend", store, "D-A"),
        ("repairs", store),
        ("export", store, "-o", tmp_path / "table.csv"),
    ):
        done = command("fleet", *arguments)
        assert done.stderr == "", arguments
        assert done.returncode in (0, 12), arguments
