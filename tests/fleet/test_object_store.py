"""A store on an object store, here moto's stand-in for S3: the same answers, also with two scans at once."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from mavhums_sim import Flight, fly, write_tlog
from tests.conftest import Run
from tests.fleet_logs import moved

pytest.importorskip("deltalake")
pytest.importorskip("duckdb")
pytest.importorskip("moto")
distributed = pytest.importorskip("distributed")

from mavhums import fleet  # noqa: E402
from mavhums.flights.store import Store  # noqa: E402

FLIGHTS = 4
DAY_S = 86_400.0


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some flights of each of two aircraft."""
    folder = tmp_path_factory.mktemp("logs")
    kind = folder / "kind"
    write_tlog(fly(Flight(1, 21.0, rate_hz=25.0, tiers=("instrumented",))), kind)
    for aircraft in ("D-A", "D-B"):
        (folder / aircraft).mkdir()
        for day in range(FLIGHTS):
            name = folder / aircraft / f"{day}.tlog"
            name.write_bytes(moved(kind.read_bytes(), DAY_S * (day + 100 * (aircraft == "D-B"))))
    return folder


@pytest.fixture(scope="module")
def options() -> Iterator[fleet.ScanOptions]:
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        yield fleet.ScanOptions(aircraft="folder", scheduler=cluster.scheduler_address)


@pytest.fixture(scope="module")
def expected(logs: Path, options: fleet.ScanOptions, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """What a store in a folder says."""
    store = tmp_path_factory.mktemp("expected") / "store"
    fleet.scan([logs / "D-A", logs / "D-B"], store, options)
    return told(store)


def told(store: str | Path) -> list[str]:
    return [
        f"{log} {verdict.model_dump_json()}"
        for aircraft in ("D-A", "D-B")
        for log, verdict in fleet.verdicts(store, aircraft)
    ]


@pytest.mark.slow
def test_it_says_the_same_as_a_folder(
    logs: Path, bucket: str, options: fleet.ScanOptions, expected: list[str], run: Run, tmp_path: Path
) -> None:
    store = f"{bucket}/one"
    assert run("fleet", "status", store).code == 1
    assert fleet.scan([logs / "D-A"], store, options) == (FLIGHTS, 0, 0)
    assert fleet.scan([logs / "D-A", logs / "D-B"], store, options) == (FLIGHTS, 0, FLIGHTS)
    assert fleet.scan([logs / "D-A", logs / "D-B"], store, options) == (0, 0, 2 * FLIGHTS)
    assert told(store) == expected
    assert f"{2 * FLIGHTS} logs of 2 aircraft" in run("fleet", "status", store).out
    assert len(fleet.worst(store)) == 8
    assert fleet.trend(store, "D-A").flights == FLIGHTS
    assert len(fleet.export(store, tmp_path / "all.csv")) == 8 * FLIGHTS
    Store(store).tidy()


@pytest.mark.slow
def test_a_landing_is_judged_by_it_and_kept_in_it(
    logs: Path, bucket: str, options: fleet.ScanOptions, run: Run
) -> None:
    store, (*flown, landed) = f"{bucket}/landings", sorted((logs / "D-A").iterdir())
    absent = run("analyse", landed, "--history", store)
    assert absent.code == 1
    assert f"{store}: no store of a fleet" in absent.err
    fleet.scan(flown, store, options)
    command = ("analyse", landed, "--history", store, "--aircraft", "folder", "--json")
    judged, kept = json.loads(run(*command).out), json.loads(run(*command, "--keep").out)
    assert judged["verdicts"] == kept["verdicts"]
    assert fleet.status(store).judged == FLIGHTS
    stored = [
        json.loads(one.model_dump_json(exclude={"own"}))
        for log, one in fleet.verdicts(store, "D-A")
        if log == str(landed)
    ]
    assert sorted(stored, key=str) == sorted(kept["verdicts"], key=str)


@pytest.mark.slow
def test_an_interrupted_scan_resumes(
    logs: Path, bucket: str, options: fleet.ScanOptions, expected: list[str]
) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    store = f"{bucket}/two"
    with pytest.raises(KeyboardInterrupt):
        fleet.scan([logs / "D-A", logs / "D-B"], store, options, progress=interrupt)
    assert fleet.scan([logs / "D-A", logs / "D-B"], store, options) == (2 * FLIGHTS - 3, 0, 3)
    assert told(store) == expected


@pytest.mark.slow
def test_two_scans_at_once_lose_and_double_nothing(
    logs: Path, bucket: str, options: fleet.ScanOptions, expected: list[str]
) -> None:
    """Flights of both aircraft arrive by two scans, so that each changes what the other has changed."""
    store = f"{bucket}/three"
    shares = [sorted(logs.glob(f"D-*/[{days}].tlog")) for days in ("03", "12")]
    with ThreadPoolExecutor(2) as both:
        done = [*both.map(lambda share: fleet.scan(share, store, options), shares)]
    assert [one.judged for one in done] == [FLIGHTS, FLIGHTS]
    assert told(store) == expected
    with ThreadPoolExecutor(2) as both:  # the same logs by two scans count once
        [*both.map(lambda share: fleet.scan(share, f"{bucket}/four", options), [[logs / "D-A"]] * 2)]
    assert fleet.status(f"{bucket}/four").judged == FLIGHTS
    assert len(fleet.verdicts(f"{bucket}/four", "D-A")) == 4 * FLIGHTS
