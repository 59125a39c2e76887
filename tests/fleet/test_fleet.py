"""A fleet's store: the verdicts of one by one, whatever the order, the workers and what goes wrong."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from mavhums.app.analysis import analyse
from mavhums.app.settings import Options
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.results.verdict import Verdict
from tests.conftest import Run
from tests.fleet_logs import joined, nameless, small

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")
cloudpickle = pytest.importorskip("cloudpickle")

from mavhums import fleet  # noqa: E402
from mavhums.fleet.sources import logs_in  # noqa: E402
from tests.fleet.stores import table, verdicts_of, write_logs  # noqa: E402
from tests.live.programs import mavhums  # noqa: E402

FLIGHTS = 12


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve flights of each of two aircraft, the last worn; two vehicles speak in the logs of one."""
    folder = tmp_path_factory.mktemp("fleet") / "logs"
    healthy = [small(number % 3) for number in range(FLIGHTS)]
    one, other = [*healthy[:-1], small(8, 0.3)], [*healthy[1:], small(9, 1.1)]
    write_logs(folder / "D-A", *one)
    write_logs(folder / "D-B", *map(joined, one, other))
    return folder


@pytest.fixture(scope="module")
def one_by_one(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Each verdict as `analyse --keep` gives it after each landing."""
    judged: dict[str, list[str]] = {}
    for aircraft in ("D-A", "D-B"):
        store = tmp_path_factory.mktemp("landed") / "store"
        for log in sorted((logs / aircraft).iterdir()):
            assessment = analyse(log, store=store, aircraft=f"={aircraft}", keep=True)
            judged[str(log)] = sorted(verdict.model_dump_json() for verdict in assessment.verdicts)
    return judged


@pytest.fixture(scope="module")
def options(scheduler: str) -> fleet.ScanOptions:
    return fleet.ScanOptions(judging=Options(aircraft="folder"), scheduler=scheduler)


@pytest.fixture(scope="module")
def scanned(logs: Path, options: fleet.ScanOptions, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of all logs, which arrive in three parts and in any order."""
    store = tmp_path_factory.mktemp("scanned") / "store"
    arriving = sorted(logs.rglob("*.tlog"))
    random.Random(5).shuffle(arriving)
    for part in (arriving[:5], arriving[5:6], arriving[6:]):
        assert fleet.scan(part, store, options) == (len(part), 0, 0)
    return store


@pytest.mark.slow
def test_a_fleet_says_what_one_command_after_each_landing_says(
    scanned: Path, one_by_one: dict[str, list[str]]
) -> None:
    assert verdicts_of(scanned, "D-A", "D-B") == one_by_one
    verdicts = [Verdict.model_validate_json(one) for several in one_by_one.values() for one in several]
    assert "friction_drift" in {evidence.kind for one in verdicts for evidence in one.evidence}


@pytest.mark.slow
def test_a_second_scan_judges_nothing_and_another_rate_judges_all(
    logs: Path, options: fleet.ScanOptions, tmp_path: Path
) -> None:
    few = sorted((logs / "D-A").iterdir())[:3]
    for _ in range(2):
        done = fleet.scan(few, tmp_path / "store", options)
    assert done == (0, 0, 3)
    assert len(table(tmp_path / "store", "flight")) == 3
    stricter = replace(options, judging=Options(false_alarms=0.1, aircraft="folder"))
    assert fleet.scan(few, tmp_path / "store", stricter) == (3, 0, 0)
    assert fleet.status(tmp_path / "store").judged == 3
    assert len(fleet.verdicts(tmp_path / "store", "D-A")) == 12


def test_broken_logs_are_rows_and_stop_nothing(
    logs: Path, options: fleet.ScanOptions, run: Run, tmp_path: Path
) -> None:
    folder = tmp_path / "D-X"
    folder.mkdir()
    (folder / "good.tlog").write_bytes((logs / "D-A" / "00.tlog").read_bytes())
    (folder / "empty.tlog").touch()
    (folder / "noise.tlog").write_bytes(random.Random(1).randbytes(4000))
    (folder / "dangling.tlog").symlink_to(tmp_path / "nothing")
    assert fleet.scan([folder], tmp_path / "store", options) == (1, 3, 0)
    assert fleet.scan([folder], tmp_path / "store", options) == (0, 0, 4)
    outcome = run("fleet", "status", "--store", tmp_path / "store")
    for name in ("empty", "noise", "dangling"):
        assert f"{name}.tlog" in outcome.out
    assert run("fleet", "worst", "--store", tmp_path / "store").code == ExitCode.ERROR


@pytest.mark.slow
def test_a_log_of_an_unknown_aircraft_is_held_against_no_other(
    logs: Path, options: fleet.ScanOptions, tmp_path: Path
) -> None:
    unruled = fleet.ScanOptions(scheduler=options.scheduler)
    for log in (logs / "D-A").iterdir():
        (tmp_path / log.name).write_bytes(nameless(log.read_bytes()))
    store = tmp_path / "store"
    fleet.scan([tmp_path], store, unruled)
    judged = fleet.verdicts(store, "")
    assert len(judged) == 4 * FLIGHTS
    assert not any(indicator.baseline for _, verdict in judged for indicator in verdict.indicators)
    assert fleet.status(store).unknown == FLIGHTS
    assert len(fleet.worst(store)) == 4 * FLIGHTS


@pytest.mark.slow
def test_an_interrupted_scan_keeps_what_it_has_and_resumes(
    logs: Path, options: fleet.ScanOptions, one_by_one: dict[str, list[str]], tmp_path: Path
) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet.scan([logs / "D-A"], tmp_path / "store", options, progress=interrupt)
    assert fleet.status(tmp_path / "store").judged == 5
    assert fleet.scan([logs / "D-A"], tmp_path / "store", options) == (FLIGHTS - 5, 0, 5)
    expected = {log: several for log, several in one_by_one.items() if "D-A" in log}
    assert verdicts_of(tmp_path / "store", "D-A", "D-B") == expected


@pytest.mark.slow
def test_two_scans_at_once_say_the_same(logs: Path, one_by_one: dict[str, list[str]], tmp_path: Path) -> None:
    scan = ("fleet", "scan", logs, "--store", tmp_path / "store", "--aircraft", "folder", "--workers", "0")
    both = [subprocess.Popen(mavhums(*scan)) for _ in range(2)]
    assert [each.wait(timeout=300) for each in both] == [0, 0]
    assert verdicts_of(tmp_path / "store", "D-A", "D-B") == one_by_one


def test_a_store_that_cannot_be_written_says_so(
    logs: Path, options: fleet.ScanOptions, tmp_path: Path
) -> None:
    (tmp_path / "file").write_bytes(b"no store")
    with pytest.raises(MavhumsError, match="file"):
        fleet.scan([logs], tmp_path / "file", options)
    with pytest.raises(MavhumsError, match="is a folder"):
        fleet.scan([logs], tmp_path, options)
    assert (tmp_path / "file").read_bytes() == b"no store"


def test_what_names_no_log_or_no_rule_is_refused(
    logs: Path, scanned: Path, options: fleet.ScanOptions, run: Run, tmp_path: Path
) -> None:
    for source, why in (("none.tlog", "no such file"), ("none-*.tlog", "matches no log")):
        with pytest.raises(MavhumsError, match=why):
            fleet.scan([tmp_path / source], tmp_path / "store", options)
    for rule in ("(", "no group"):
        assert run("fleet", "scan", tmp_path, "--store", tmp_path / "s", "--aircraft", rule).code == 1
    assert run("fleet", "status", "--store", tmp_path / "none").code == 1
    assert "D-A, D-B" in run("trend", "D-C", "--store", scanned).err
    with pytest.raises(MavhumsError, match="no scheduler"):
        fleet.scan([logs], tmp_path / "s2", fleet.ScanOptions(scheduler="nonsense://1"))


def test_folders_files_and_patterns_name_each_log_once(logs: Path) -> None:
    names = [str(logs), str(logs / "D-A" / "*.tlog"), str(logs / "D-A" / "00.tlog")]
    assert [log.path for log in logs_in(names)] == sorted(map(str, logs.rglob("*.tlog")))


def test_the_worst_of_all_aircraft_comes_first(scanned: Path, run: Run) -> None:
    outcome = run("fleet", "worst", "--store", scanned, "-n", "3")
    assert outcome.code == ExitCode.EMERGENCY
    assert outcome.out.splitlines()[0].startswith("D-B elevator: EMERGENCY since flight ")
    rows = json.loads(run("fleet", "worst", "--store", scanned, "--json", "-n", "1").out)
    assert rows[0]["aircraft"] == "D-B"
    assert rows[0]["verdict"]["worst"] == "emergency"
    assert "24 logs of 2 aircraft" in run("fleet", "status", "--store", scanned).out
    assert fleet.trend(scanned, "D-A").flights == FLIGHTS
    assert fleet.export(scanned)["aircraft"].value_counts().to_dict() == {
        "D-A": 4 * FLIGHTS,
        "D-B": 8 * FLIGHTS,
    }


class Dies(distributed.WorkerPlugin):  # type: ignore[misc, name-defined]
    """A worker that dies over the log of this name, so often."""

    def __init__(self, name: str, times: int, count: Path) -> None:
        self.log, self.times, self.count = name, times, count

    def setup(self, worker: object) -> None:
        judging = import_module("mavhums.fleet.judging")
        judge = judging.analyse_alone

        def deadly(path: str, *given: object) -> object:
            died = len(list(self.count.iterdir()))
            if path.endswith(self.log) and died < self.times:
                (self.count / str(time.time_ns())).touch()
                os.kill(os.getpid(), 9)
            return judge(path, *given)

        judging.analyse_alone = deadly  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize(("times", "failed"), [(1, 0), (1000, 1)])
def test_a_killed_worker_loses_and_doubles_nothing(
    logs: Path, one_by_one: dict[str, list[str]], tmp_path: Path, times: int, failed: int
) -> None:
    count = tmp_path / "count"
    count.mkdir()
    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import the tests
    given = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "security": True}
    files = {"ca-file": "ca_file", "client.cert": "client_cert", "client.key": "client_key"}
    with (
        distributed.LocalCluster(**given) as cluster,
        distributed.Client(cluster) as client,
        dask.config.set(
            {f"distributed.comm.tls.{k}": getattr(cluster.security, f"tls_{v}") for k, v in files.items()}
        ),
    ):
        client.register_plugin(Dies("D-A/03.tlog", times, count))
        separate = fleet.ScanOptions(judging=Options(aircraft="folder"), scheduler=cluster.scheduler_address)
        done = fleet.scan([logs], tmp_path / "store", separate)
    assert done == (2 * FLIGHTS - failed, failed, 0)
    if failed:
        assert "crashed the worker" in fleet.status(tmp_path / "store").failures[0].problem
    else:
        assert verdicts_of(tmp_path / "store", "D-A", "D-B") == one_by_one


@pytest.mark.slow
def test_the_example_names_the_broken_aircraft_first(tmp_path: Path) -> None:
    from examples import fleet as example

    found = example.main(str(tmp_path), 2)
    assert [(one.aircraft, one.verdict.actuator, one.verdict.gravest) for one in found[:2]] == [
        ("D-000", "elevator", "emergency"),
        ("D-001", "elevator", "degraded"),
    ]
