"""What goes wrong in a scan: nothing is lost, nothing counts twice, and the same command resumes."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from threading import Timer

import psutil
import pytest

from mavhums.core.errors import MavhumsError
from tests.conftest import Run, files_up_to
from tests.fleet_logs import small

pytest.importorskip("distributed")

from mavhums import Options, fleet
from tests.fleet.stores import add, verdicts_of, write_logs

FLIGHTS = 6


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some flights of one aircraft."""
    return write_logs(tmp_path_factory.mktemp("faults") / "D-A", *[small()] * FLIGHTS)


@pytest.fixture(scope="module")
def options(scheduler: str) -> fleet.ScanOptions:
    return fleet.ScanOptions(judging=Options(aircraft="folder"), scheduler=scheduler)


@pytest.fixture(scope="module")
def expected(
    logs: Path, options: fleet.ScanOptions, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, list[str]]:
    """The verdicts of a scan in which nothing goes wrong."""
    store = tmp_path_factory.mktemp("expected") / "store"
    fleet.scan([logs], store, options)
    return verdicts_of(store, "D-A")


@pytest.mark.slow
@pytest.mark.parametrize("size", [100, 40_000])
def test_a_full_disk_is_reported_and_the_scan_resumes(
    logs: Path, options: fleet.ScanOptions, expected: dict[str, list[str]], tmp_path: Path, size: int
) -> None:
    few = sorted(logs.iterdir())[:2]
    fleet.scan(few, tmp_path / "store", options)
    with files_up_to(size), pytest.raises(MavhumsError, match="cannot be written") as full:
        fleet.scan([logs], tmp_path / "store", options)
    assert "\n" not in full.value.problem
    done = fleet.scan([logs], tmp_path / "store", options)
    assert done.judged + done.known == FLIGHTS
    assert verdicts_of(tmp_path / "store", "D-A") == expected


@pytest.mark.slow
def test_more_batches_than_are_in_flight_are_all_judged(
    logs: Path,
    options: fleet.ScanOptions,
    expected: dict[str, list[str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(import_module("mavhums.fleet.judging"), "_MOST", 1)
    monkeypatch.setattr(import_module("mavhums.fleet.judging"), "_IN_FLIGHT", 2)
    assert fleet.scan([logs], tmp_path / "store", options) == (FLIGHTS, 0, 0)
    assert verdicts_of(tmp_path / "store", "D-A") == expected


@pytest.mark.slow
def test_flights_in_another_format_are_judged_again(
    logs: Path, options: fleet.ScanOptions, expected: dict[str, list[str]], tmp_path: Path
) -> None:
    fleet.scan([logs], tmp_path / "store", options)
    with closing(sqlite3.connect(tmp_path / "store")) as base, base:
        base.execute("UPDATE flight SET format = format + 1")
    assert fleet.scan([logs], tmp_path / "store", options) == (FLIGHTS, 0, 0)
    assert verdicts_of(tmp_path / "store", "D-A") == expected


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


def test_a_store_that_cannot_be_reached_is_reported(run: Run) -> None:
    for address, shown, why in (
        ("postgresql://nobody@127.0.0.1:9/fleet", "nobody@127.0.0.1:9/fleet", "check the address"),
        ("postgresql://nobody:a@b@127.0.0.1:9/fleet", "nobody:***@127.0.0.1:9/fleet", "check the address"),
        ("postgresql://nobody@nowhere:port/fleet", "nowhere:port/fleet", "is not an address of a database"),
        ("s3://nowhere/store", "s3://nowhere/store", "is not an address of a database"),
    ):
        outcome = run("fleet", "status", "--store", address)
        assert outcome.code == 1
        assert f"{shown}: " in outcome.err
        assert why in outcome.err
        assert "a@b" not in outcome.err


_DRIVER = """
import os, signal, sys
from importlib import import_module
from mavhums import Options, fleet

def die(done, total):
    if done == 5:
        os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    import_module("mavhums.fleet.scan")._COMMIT_LOGS = 2
    options = fleet.ScanOptions(judging=Options(aircraft="folder"))
    fleet.scan([sys.argv[1]], sys.argv[2], options, progress=die)
"""


@pytest.mark.slow
def test_a_killed_scan_keeps_what_it_committed_and_its_workers_end(
    logs: Path, options: fleet.ScanOptions, expected: dict[str, list[str]], tmp_path: Path
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
    assert verdicts_of(store, "D-A") == expected
    _, alive = psutil.wait_procs(children, timeout=60)
    assert not alive
