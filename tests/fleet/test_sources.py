"""Logs in an object store, here moto's stand-in for S3: the rows of a folder, whatever goes wrong."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import pytest

from mavhums import EngineOptions, fleet
from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.fleet import sources
from mavhums.fleet.judging import Judging, judge
from mavhums.fleet.sources import at_hand, logs_in
from mavhums.flights.aircraft import AircraftResolver
from mavhums.flights.store import LogFile
from mavhums.results.assessment import Assessment
from tests.conftest import Run
from tests.fleet.stores import FOLDER, table
from tests.fleet_logs import moved, small

FLIGHTS = 3
DAY_S = 86_400.0

NAMES = [f"D-{letter}/{day}.tlog" for letter in "AB" for day in range(FLIGHTS)]


def put(address: str, content: bytes | None) -> None:
    """Write an object, or remove it."""
    store, path = sources._filesystem("s3"), address.removeprefix("s3://")
    if content is None:
        store.delete_file(path)
        return
    with store.open_output_stream(path) as out:
        out.write(content)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flights of two aircraft, one compressed, a broken log, and a file that is none."""
    folder = tmp_path_factory.mktemp("logs")
    for place, name in enumerate(NAMES):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(moved(small(), DAY_S * place))
    (folder / "D-A" / "broken.tlog").write_bytes(b"no log")
    (folder / "D-A" / "notes.txt").write_bytes(b"no log")
    return folder


@pytest.fixture
def there(bucket: str, folder: Path, request: pytest.FixtureRequest) -> str:
    """The same files under a prefix of the bucket."""
    prefix = f"{bucket}/{request.node.name}"
    for path in folder.rglob("*.*"):
        put(f"{prefix}/{path.relative_to(folder)}", path.read_bytes())
    return prefix


def contents_of(store: Path, root: str | Path) -> list[Any]:
    """What a store says of each log, with the path below its source."""
    verdicts = [
        (log.removeprefix(f"{root}/"), verdict.model_dump_json())
        for aircraft in ("D-A", "D-B")
        for log, verdict in fleet.verdicts(store, aircraft)
    ]
    failures = [one.problem.replace(f"{root}/", "") for one in fleet.status(store).failures]
    return [verdicts, failures]


@pytest.mark.slow
def test_the_rows_are_those_of_a_folder(run: Run, folder: Path, there: str, tmp_path: Path) -> None:
    assert fleet.scan([folder / "D-A", folder / "D-B"], tmp_path / "expected", FOLDER) == (6, 1, 0)
    command = ("fleet", "scan", f"{there}/", "--store", tmp_path / "store", "--aircraft", "folder", "--json")
    outcome = run(*command)
    assert json.loads(outcome.out) == {"judged": 6, "failed": 1, "known": 0, "foreign_boards": []}
    assert json.loads(run(*command).out) == {"judged": 0, "failed": 0, "known": 7, "foreign_boards": []}
    assert contents_of(tmp_path / "store", there) == contents_of(tmp_path / "expected", folder)
    (flight,) = [one for one in fleet_flights(tmp_path / "store") if one.endswith("D-B/2.tlog")]
    assert flight == f"{there}/D-B/2.tlog"
    assert not [*Path(tempfile.gettempdir()).glob("mavhums-log-*")]
    put(f"{there}/D-B/2.tlog", (folder / "D-A" / "broken.tlog").read_bytes())
    assert json.loads(run(*command).out) == {"judged": 0, "failed": 1, "known": 6, "foreign_boards": []}


def fleet_flights(store: Path) -> list[str]:
    from mavhums.flights.queries import flights

    return [str(flight.log.path) for flight in flights(store, "D-B") if isinstance(flight, Assessment)]


@pytest.mark.slow
def test_folders_patterns_and_objects_name_logs(there: str) -> None:
    def names(*several: str) -> list[str]:
        return [file.path.removeprefix(f"{there}/") for file in logs_in(f"{there}{one}" for one in several)]

    assert names("") == sorted([*NAMES, "D-A/broken.tlog"])
    assert names("/D-A") == [*NAMES[:FLIGHTS], "D-A/broken.tlog"]
    assert names("/*/[12].tlog") == [name for name in NAMES if "0.tlog" not in name]
    assert names("/**/*.tlog") == names("")
    assert names("/D-A/1.tlog", "/D-A/*1.tlog") == ["D-A/1.tlog"]
    for nothing in ("/D-C", "/D-?/x*.tlog"):
        with pytest.raises(MavhumsError, match="matches no log"):
            names(nothing)
    with pytest.raises(MavhumsError, match="no address of logs"):
        logs_in(["ftp://host/logs"])


@pytest.mark.slow
def test_a_log_that_vanishes_is_a_row_and_is_tried_again(there: str, folder: Path, tmp_path: Path) -> None:
    def remove(done: int, total: int) -> None:
        if done == 1:
            put(f"{there}/D-B/1.tlog", None)
            put(f"{there}/D-B/2.tlog", b"shorter")

    assert fleet.scan([there], tmp_path / "store", FOLDER, progress=remove) == (4, 3, 0)
    failures = {one.problem: one.remedy for one in fleet.status(tmp_path / "store").failures}
    assert "scan again" in failures[f"{there}/D-B/1.tlog: is no longer there"]
    assert f"{there}/D-B/2.tlog: changed while it was scanned" in failures
    for name in ("D-B/1.tlog", "D-B/2.tlog"):
        put(f"{there}/{name}", (folder / name).read_bytes())
    assert fleet.scan([there], tmp_path / "store", FOLDER)[:2] == (2, 0)
    assert len(fleet.status(tmp_path / "store").failures) == 1
    assert len(fleet.verdicts(tmp_path / "store", "D-B")) == 4 * FLIGHTS


@pytest.mark.slow
def test_several_workers_download_for_themselves(there: str, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    options = fleet.ScanOptions(judging=Options(aircraft="folder"), workers=2)
    assert fleet.scan([there], tmp_path / "store", options) == (6, 1, 0)
    assert all(str(row["path"]).startswith("s3://") for row in table(tmp_path / "store", "flight"))


def test_a_store_that_does_not_answer_is_reported(
    monkeypatch: pytest.MonkeyPatch, run: Run, tmp_path: Path
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "x")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "x")
    monkeypatch.setattr(sources, "_ATTEMPTS", 1)
    sources._filesystem.cache_clear()
    try:
        outcome = run("fleet", "scan", "s3://bucket/logs", "--store", tmp_path / "store", "--workers", "0")
        assert outcome.code == 1
        assert "s3://bucket/logs: cannot be listed" in outcome.err
        assert "the credentials" in outcome.err
        with (
            pytest.raises(sources.UnreachedError, match="cannot be read"),
            at_hand(LogFile("s3://bucket/logs/1.tlog", 10, 0)),
        ):
            pass
    finally:
        sources._filesystem.cache_clear()


def test_a_forbidden_log_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    class Forbidding:
        def open_input_stream(self, path: str) -> None:
            raise OSError(f"When reading '{path}': AWS Error ACCESS_DENIED during HeadObject")

    monkeypatch.setattr(sources, "_filesystem", lambda _: Forbidding())
    judging = Judging(EngineOptions(), "settings", AircraftResolver("folder"))
    row = judge(LogFile("s3://bucket/D-A/1.tlog", 10, 0), judging)
    assert row.problem
    assert "s3://bucket/D-A/1.tlog: cannot be read: " in row.problem
    assert "ACCESS_DENIED" in row.problem
    assert "credentials" in str(row.remedy)
    assert row.settings != "settings"  # so that a later scan tries again
    assert row.aircraft == "D-A"


def test_a_full_disk_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(sources.UnreachedError, match="no room") as error,
        at_hand(LogFile("s3://bucket/logs/1.tlog", 1 << 60, 0)),
    ):
        pass
    assert "TMPDIR" in error.value.remedy
