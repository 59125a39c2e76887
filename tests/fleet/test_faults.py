"""What goes wrong in a scan: nothing is lost, nothing counts twice, and the same command resumes."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path

import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mavhums.core.errors import MavhumsError
from mavhums_sim import Flight, fly, write_tlog
from tests.conftest import Run
from tests.fleet_logs import moved
from tests.flights import flown, shown, verdict

pytest.importorskip("deltalake")
pytest.importorskip("duckdb")
distributed = pytest.importorskip("distributed")

from deltalake import DeltaTable, write_deltalake  # noqa: E402

from mavhums import fleet  # noqa: E402
from mavhums.flights.store import FORMAT, Store  # noqa: E402
from mavhums.flights.store_tables import LOGS, VERDICTS, schemas  # noqa: E402
from tests.fleet.stores import row_of, write_store  # noqa: E402

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
def options() -> Iterator[fleet.ScanOptions]:
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield fleet.ScanOptions(aircraft="folder", scheduler=cluster.scheduler_address)


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
@pytest.mark.parametrize("size", [100, 4_000])
def test_a_full_disk_is_told_and_the_scan_resumes(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path, size: int
) -> None:
    few = sorted(logs.iterdir())[:2]
    fleet.scan(few, tmp_path / "store", options)
    with files_up_to(size), pytest.raises(MavhumsError, match="cannot be written") as full:
        fleet.scan([logs], tmp_path / "store", options)
    assert "\n" not in full.value.problem
    assert "resumes" in full.value.remedy
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
    monkeypatch.setattr(import_module("mavhums.fleet.judging"), "_MOST", 1)
    monkeypatch.setattr(import_module("mavhums.fleet.judging"), "_IN_FLIGHT", 2)
    assert fleet.scan([logs], tmp_path, options) == (FLIGHTS, 0, 0)
    assert told(tmp_path) == expected


@pytest.mark.slow
def test_one_landing_after_the_other_needs_no_workers(
    logs: Path, expected: list[str], run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    store = tmp_path / "store"
    for log in sorted(logs.iterdir()):
        landed = run("fleet", "scan", log, "--to", store, "--aircraft", "folder", "--workers", "0")
        assert landed.code == 0
    assert told(store) == expected
    kept = run("analyse", log, "--history", store, "--keep", "--aircraft", "folder")
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
    assert "07.tlog" in fleet.status(tmp_path / "store").failures[0][0]
    assert len(fleet.verdicts(tmp_path / "store", "D-A")) == 4 * 19


@pytest.mark.slow
def test_many_small_commits_are_compacted_and_say_the_same(tmp_path: Path) -> None:
    flights = [flown(verdict(shown(0.2 + day / 1000)), day=day) for day in range(70)]
    store = Store(tmp_path)
    for flight in flights:
        store.add_logs([row_of(flight, "D-A")])
    write_store(tmp_path, {"D-B": flights[:1]})
    before = store.query("SELECT * FROM logs ORDER BY ALL").fetchall()
    assert len(DeltaTable(tmp_path / LOGS).file_uris()) > 64
    store.tidy()
    assert len(DeltaTable(tmp_path / LOGS).file_uris()) == 1
    assert store.query("SELECT * FROM logs ORDER BY ALL").fetchall() == before


def test_verdicts_of_an_aircraft_that_several_write_first_at_once_are_there_once(tmp_path: Path) -> None:
    def write(place: Path) -> None:
        store = Store(place)
        row: dict[str, object] = {"aircraft": "D-A", "sha256": "0"}
        store.retried(partial(store.replace, VERDICTS, "D-A", [row]))

    for again in range(5):
        place = tmp_path / str(again)
        with ThreadPoolExecutor(3) as several:
            assert [*several.map(write, [place] * 3)] == [None] * 3
        assert Store(place).query("SELECT COUNT(*) FROM verdicts").fetchone() == (1,)


def older(store: Path, missing: dict[str, list[str]]) -> None:
    """Write a store's tables again as a version that did not have some columns would have written them."""
    for table, columns in missing.items():
        content = pa.concat_tables(
            pq.read_table(file.removeprefix("file://")) for file in DeltaTable(store / table).file_uris()
        )
        shutil.rmtree(store / table)
        write_deltalake(store / table, content.drop_columns(columns))


@pytest.mark.slow
def test_an_older_versions_store_is_opened_and_extended(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    fleet.scan(sorted(logs.iterdir())[:3], tmp_path, options)
    older(tmp_path, {LOGS: ["format", "losses"], VERDICTS: ["airframe"]})
    assert fleet.status(tmp_path).judged == 3
    assert len(fleet.worst(tmp_path)) == 4
    assert fleet.export(tmp_path)["airframe"].isna().all()
    assert fleet.scan([logs], tmp_path, options) == (FLIGHTS - 3, 0, 3)
    assert told(tmp_path) == expected
    for table in (LOGS, VERDICTS):
        names = {field.name for field in DeltaTable(tmp_path / table).schema().fields}
        assert names == set(schemas()[table].names)


@pytest.mark.slow
def test_a_newer_versions_columns_are_kept(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    few = sorted(logs.iterdir())[:3]
    fleet.scan(few, tmp_path, options)
    content = pq.read_table(DeltaTable(tmp_path / LOGS).file_uris()[0].removeprefix("file://"))
    shutil.rmtree(tmp_path / LOGS)
    write_deltalake(tmp_path / LOGS, content.append_column("newest", pa.array(["x"] * 3)))
    fleet.scan([logs], tmp_path, options)
    assert told(tmp_path) == expected
    newest = DeltaTable(tmp_path / LOGS).to_pyarrow_dataset().to_table(["newest"])["newest"].to_pylist()
    assert sorted(newest, key=str) == [None] * (FLIGHTS - 3) + ["x"] * 3


@pytest.mark.slow
def test_flights_in_another_format_are_judged_again(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    fleet.scan([logs], tmp_path, options)
    content = pq.read_table(DeltaTable(tmp_path / LOGS).file_uris()[0].removeprefix("file://"))
    place = content.schema.get_field_index("format")
    other = content.set_column(place, "format", pa.array([FORMAT + 1] * FLIGHTS))
    shutil.rmtree(tmp_path / LOGS)
    write_deltalake(tmp_path / LOGS, other)
    assert fleet.scan([logs], tmp_path, options) == (FLIGHTS, 0, 0)
    assert told(tmp_path) == expected


@pytest.mark.slow
def test_a_restored_backup_goes_on(
    logs: Path, options: fleet.ScanOptions, expected: list[str], tmp_path: Path
) -> None:
    fleet.scan(sorted(logs.iterdir())[:3], tmp_path / "store", options)
    shutil.copytree(tmp_path / "store", tmp_path / "backup")
    shutil.rmtree(tmp_path / "store")
    (tmp_path / "backup").rename(tmp_path / "restored")
    assert fleet.scan([logs], tmp_path / "restored", options) == (FLIGHTS - 3, 0, 3)
    assert told(tmp_path / "restored") == expected


def test_a_store_that_cannot_be_reached_is_told(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "x")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    outcome = run("fleet", "status", "s3://nowhere/store")
    assert outcome.code == 1
    assert "s3://nowhere/store: the store cannot be read" in outcome.err
    assert "credentials" in outcome.err


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
    assert fleet.status(store).judged == 4
    assert fleet.scan([logs], store, options) == (FLIGHTS - 4, 0, 4)
    assert told(store) == expected
    _, alive = psutil.wait_procs(children, timeout=60)
    assert not alive
