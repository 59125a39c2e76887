"""What goes wrong in a scan: nothing is lost, nothing counts twice, and the same command resumes."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from threading import Timer

import psutil
import pytest

from mavhums.core.errors import MavhumsError
from mavhums_sim import Flight, fly, write_tlog
from tests.conftest import Run
from tests.fleet_logs import moved

pytest.importorskip("distributed")

from mavhums import fleet
from tests.fleet.stores import add

FLIGHTS = 6
DAY_S = 86_400.0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("log") / "flight.tlog"
    write_tlog(fly(Flight(1, 21.0, rate_hz=25.0, tiers=("instrumented",))), path)
    return path.read_bytes()


@pytest.fixture(scope="module")
def logs(log: bytes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some flights of one aircraft."""
    folder = tmp_path_factory.mktemp("faults") / "D-A"
    folder.mkdir()
    for day in range(FLIGHTS):
        (folder / f"{day:02}.tlog").write_bytes(moved(log, DAY_S * day))
    return folder


@pytest.fixture(scope="module")
def options(scheduler: str) -> fleet.ScanOptions:
    return fleet.ScanOptions(aircraft="folder", scheduler=scheduler)


@pytest.fixture(scope="module")
def expected(logs: Path, options: fleet.ScanOptions, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The verdicts of a scan in which nothing goes wrong."""
    store = tmp_path_factory.mktemp("expected") / "store"
    fleet.scan([logs], store, options)
    return told(store)


def told(store: str | Path) -> list[str]:
    return [f"{log} {verdict.model_dump_json()}" for log, verdict in fleet.verdicts(store, "D-A")]


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Let no file grow beyond a size, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.slow
@pytest.mark.parametrize("size", [100, 40_000])
def test_a_full_disk_is_told_and_the_scan_resumes(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path, size: int
) -> None:
    few = sorted(logs.iterdir())[:2]
    fleet.scan(few, tmp_path / "store", options)
    with files_up_to(size), pytest.raises(MavhumsError, match="cannot be written") as full:
        fleet.scan([logs], tmp_path / "store", options)
    assert "\n" not in full.value.problem
    done = fleet.scan([logs], tmp_path / "store", options)
    assert done.judged + done.known == FLIGHTS
    assert told(tmp_path / "store") == expected


@pytest.mark.slow
def test_more_batches_than_are_in_flight_are_all_judged(
    logs: Path,
    options: fleet.ScanOptions,
    expected: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(import_module("mavhums.fleet.scan"), "_MOST", 1)
    monkeypatch.setattr(import_module("mavhums.fleet.scan"), "_IN_FLIGHT", 2)
    assert fleet.scan([logs], tmp_path / "store", options) == (FLIGHTS, 0, 0)
    assert told(tmp_path / "store") == expected


@pytest.mark.slow
def test_one_landing_after_the_other_needs_no_workers(
    logs: Path, expected: list[str], run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    store = tmp_path / "store"
    for log in sorted(logs.iterdir()):
        landed = run("fleet", "scan", log, "--store", store, "--aircraft", "folder", "--workers", "0")
        assert landed.code == 0
    assert told(store) == expected
    kept = run("analyse", log, "--store", store, "--keep", "--aircraft", "folder")
    assert kept.code == 0
    assert told(store) == expected


@pytest.mark.slow
def test_one_broken_log_of_twenty_stops_nothing(
    log: bytes, options: fleet.ScanOptions, tmp_path: Path
) -> None:
    folder = tmp_path / "D-A"
    folder.mkdir()
    for number in range(20):
        data = b"broken" if number == 7 else moved(log, 3600.0 * number)
        (folder / f"{number:02}.tlog").write_bytes(data)
    assert fleet.scan([folder], tmp_path / "store", options) == (19, 1, 0)
    assert fleet.scan([folder], tmp_path / "store", options) == (0, 0, 20)
    assert "07.tlog" in fleet.status(tmp_path / "store").failures[0].problem
    assert len(fleet.verdicts(tmp_path / "store", "D-A")) == 4 * 19


@pytest.mark.slow
def test_flights_in_another_format_are_judged_again(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    fleet.scan([logs], tmp_path / "store", options)
    with closing(sqlite3.connect(tmp_path / "store")) as base, base:
        base.execute("UPDATE flight SET format = format + 1")
    assert fleet.scan([logs], tmp_path / "store", options) == (FLIGHTS, 0, 0)
    assert told(tmp_path / "store") == expected


@pytest.mark.slow
def test_a_restored_backup_goes_on(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    fleet.scan(sorted(logs.iterdir())[:3], tmp_path / "store", options)
    shutil.copy(tmp_path / "store", tmp_path / "backup")
    (tmp_path / "store").unlink()
    (tmp_path / "backup").rename(tmp_path / "restored")
    assert fleet.scan([logs], tmp_path / "restored", options) == (FLIGHTS - 3, 0, 3)
    assert told(tmp_path / "restored") == expected


def test_a_writer_waits_for_one_that_writes_a_new_file(tmp_path: Path) -> None:
    store = tmp_path / "store"
    writes = sqlite3.connect(store, isolation_level=None, check_same_thread=False)
    writes.execute("BEGIN IMMEDIATE")  # SQLite refuses another journal mode now, at once
    writes.execute("CREATE TABLE other (x)")
    end = Timer(0.3, writes.execute, ("COMMIT",))
    end.start()
    add(store)
    end.join()
    writes.close()
    assert fleet.worst(store) == []


@pytest.mark.skipif(not hasattr(os, "setresuid"), reason="folders have no permissions here")
def test_a_store_in_a_folder_that_may_not_be_written_is_read() -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as folder, ExitStack() as undone:  # others may look into it
        store = Path(folder) / "100 %?.sqlite"
        add(store)
        assert fleet.worst(store) == []  # what is imported on the way, others may not read
        store.chmod(0o444)
        Path(folder).chmod(0o555)
        if os.geteuid() == 0:  # nothing is forbidden to it
            os.setresuid(65534, 65534, 0)
            undone.callback(os.setresuid, 0, 0, 0)
        else:
            undone.callback(Path(folder).chmod, 0o755)
        assert fleet.worst(store) == []
        with pytest.raises(MavhumsError, match="cannot be written: attempt to write a readonly database"):
            fleet.change_repairs(store, add=[fleet.Repair(None, None, datetime.now(UTC))])
        assert [path.name for path in Path(folder).iterdir()] == [store.name]


def test_a_store_that_cannot_be_reached_is_told(run: Run) -> None:
    for address, shown, told in (
        ("postgresql://nobody@127.0.0.1:9/fleet", "nobody@127.0.0.1:9/fleet", "check the address"),
        ("postgresql://nobody:a@b@127.0.0.1:9/fleet", "nobody:***@127.0.0.1:9/fleet", "check the address"),
        ("postgresql://nobody@nowhere:port/fleet", "nowhere:port/fleet", "is not an address of a database"),
        ("s3://nowhere/store", "s3://nowhere/store", "is not an address of a database"),
    ):
        outcome = run("fleet", "status", "--store", address)
        assert outcome.code == 1
        assert f"{shown}: " in outcome.err
        assert told in outcome.err
        assert "a@b" not in outcome.err


_DRIVER = """
import os, signal, sys
from importlib import import_module
from mavhums import fleet

def die(done, total):
    if done == 5:
        os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    import_module("mavhums.fleet.scan")._COMMIT_LOGS = 2
    fleet.scan([sys.argv[1]], sys.argv[2], fleet.ScanOptions(aircraft="folder"), progress=die)
"""


@pytest.mark.slow
def test_a_killed_scan_keeps_what_it_committed_and_its_workers_end(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    script = tmp_path / "driver.py"
    script.write_text(_DRIVER, encoding="utf-8")
    store = tmp_path / "store"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    driver = subprocess.Popen(
        [sys.executable, script, logs, store], env=environment, stderr=subprocess.DEVNULL
    )
    children: set[psutil.Process] = set()
    while driver.poll() is None:
        children.update(psutil.Process(driver.pid).children(recursive=True))
        time.sleep(0.05)
    assert driver.returncode == -signal.SIGKILL
    assert children
    kept = fleet.status(store).judged
    assert kept in (4, 5)  # a slow machine commits after a time
    assert fleet.scan([logs], store, options) == (FLIGHTS - kept, 0, kept)
    assert told(store) == expected
    _, alive = psutil.wait_procs(children, timeout=60)
    assert not alive
