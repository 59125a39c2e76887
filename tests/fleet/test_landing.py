"""One log and a store: judged by its aircraft's flights there and kept there, as a scan of it does."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mavhums
from mavhums import fleet
from mavhums.core.errors import ExitCode, MavhumsError
from tests.conftest import Run
from tests.fleet.stores import FOLDER, table, verdicts_of, write_logs
from tests.fleet_logs import moved, small

FLIGHTS = 11


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a store of healthy flights, and the log of a worn one that is not in it."""
    folder = tmp_path_factory.mktemp("landing")
    write_logs(folder / "D-A", *(small(day % 2) for day in range(FLIGHTS)))
    assert fleet.scan([folder / "D-A"], folder / "store", FOLDER) == (FLIGHTS, 0, 0)
    (folder / "D-A" / "landed.tlog").write_bytes(moved(small(8, 0.3), 86_400.0 * FLIGHTS))
    shutil.copy(folder / "store", folder / "scanned")
    assert fleet.scan([folder / "D-A" / "landed.tlog"], folder / "scanned", FOLDER).judged == 1
    return folder


@pytest.fixture
def store(kept: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(kept / "store", tmp_path / "store"))


def row(store: Path, log: Path) -> dict[str, object]:
    (found,) = (each for each in table(store, "flight") if each["path"] == str(log))
    return {name: value for name, value in found.items() if name != "came_us"}


def verdicts_in(content: str) -> list[str]:
    """The verdicts of an assessment as JSON."""
    assessment = mavhums.Assessment.model_validate_json(content)
    return sorted(one.model_dump_json() for one in assessment.verdicts)


def test_a_log_is_judged_by_the_flights_in_a_store(run: Run, kept: Path, store: Path) -> None:
    log = kept / "D-A" / "landed.tlog"
    outcome = run("analyse", log, "--store", store, "--aircraft", "folder", "--json")
    assert outcome.code == ExitCode.DEGRADED
    assert verdicts_in(outcome.out) == verdicts_of(kept / "scanned", "D-A")[str(log)]
    assert "friction_drift" in outcome.out
    assert json.loads(outcome.out)["log"]["flight"][0]["aircraft"] == "D-A"
    assert fleet.status(store).judged == FLIGHTS  # nothing was written
    alone = run("analyse", log, "--store", store, "--aircraft", "=D-B", "--json")
    assert "friction_drift" not in alone.out
    page = run("report", log, "-o", store.parent / "page.html", "--store", store, "--aircraft", "folder")
    assert page.code == ExitCode.DEGRADED
    text = run("analyse", log, "--store", store, "--aircraft", "folder").out
    assert re.search(r"elevator.*: friction [0-9.]+ N·m \(own baseline [0-9.]+\)", text)
    piped = store.parent / "piped.html"
    command = [sys.executable, "-m", "mavhums", "report", "-", "-o", str(piped), "--store", str(store)]
    with log.open("rb") as stream:
        subprocess.run([*command, "--aircraft", "=D-A"], stdin=stream, check=False)
    for drawn in (store.parent / "page.html", piped):
        assert "from its own baseline" in drawn.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_log_is_kept_as_a_scan_keeps_it(run: Run, kept: Path, store: Path) -> None:
    log = kept / "D-A" / "landed.tlog"
    command = ("analyse", log, "--store", store, "--keep", "--aircraft", "folder", "--json")
    first, again = run(*command), run(*command)
    assert first == again
    kept_both = [verdicts_of(one, "D-A")[str(log)] for one in (store, kept / "scanned")]
    assert kept_both == [verdicts_in(first.out)] * 2
    assert first.code == ExitCode.DEGRADED
    assert row(store, log) == row(kept / "scanned", log)
    assert fleet.scan([log], store, fleet.ScanOptions(workers=0)) == (0, 0, 1)


def test_what_is_no_store_is_refused(run: Run, kept: Path, tmp_path: Path) -> None:
    log = kept / "D-A" / "00.tlog"
    for wrong in (tmp_path, tmp_path / "absent"):
        with pytest.raises(MavhumsError, match="store"):
            mavhums.analyse(log, store=wrong)
    assert [*tmp_path.iterdir()] == []
    assert "a store names logs" in run("analyse", "-", "--keep", "--store", tmp_path / "new").err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a store", "100 % ü?", "store [1]", "a%20store", "postgresql:"])
def test_a_store_may_be_called_anything(kept: Path, tmp_path: Path, name: str) -> None:
    store = shutil.copy(kept / "store", tmp_path / name)
    assert fleet.status(store) == fleet.status(kept / "store")
    assert fleet.worst(store) == fleet.worst(kept / "store")


@pytest.mark.slow
def test_a_repair_that_was_a_mistake_leaves_nothing(
    run: Run, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = shutil.copy(kept / "scanned", tmp_path / "store")
    monkeypatch.setattr(sys.modules["mavhums.fleet.judging"], "analyse_alone", None)  # no log is opened
    before, repairs = fleet.verdicts(store, "D-A"), ("fleet", "repairs", "--store", store)
    assert run(*repairs).out == "no repairs\n"
    added = run(*repairs, "--add", "D-A/elevator=2026-01-05")
    assert added.out == "D-A/elevator=2026-01-05\n"
    assert "friction_drift" not in str(fleet.verdicts(store, "D-A"))
    assert json.loads(run(*repairs, "--json").out) == [
        {"aircraft": "D-A", "actuator": "elevator", "at": "2026-01-05T00:00:00+00:00"}
    ]
    assert "Repaired: elevator 2026-01-05" in run("trend", "D-A", "--store", store).out
    wrong = run(*repairs, "--remove", "D-A/rudder=2026-01-05")
    assert wrong.code == ExitCode.ERROR
    assert "the store has: D-A/elevator=2026-01-05" in wrong.err
    assert run(*repairs, "--remove", "D-A/elevator=2026-01-05").out == "no repairs\n"
    assert fleet.verdicts(store, "D-A") == before
    assert "friction_drift" in str(before)


@pytest.mark.slow
def test_the_page_judges_by_the_flights_in_its_store(kept: Path, tmp_path: Path) -> None:
    """On the page the board names the aircraft."""
    from mavhums.serve.worker import answer

    healthy, log = sorted((kept / "D-A").glob("[01]*")), kept / "D-A" / "landed.tlog"
    store = tmp_path / "store"
    fleet.scan(healthy, store, fleet.ScanOptions(workers=0))
    report = str(tmp_path / "report.html")
    job = {"do": "judge", "log": str(log), "report": report, "options": {"store": str(store)}}
    assert answer([0], (0, job))["brief"]["condition"] == "degraded"
    assert fleet.status(store).judged == FLIGHTS
