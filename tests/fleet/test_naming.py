"""A store remembers how it names aircraft: no log makes a phantom, and no flight is kept twice."""

from __future__ import annotations

import bz2
import json
import lzma
import re
import shutil
import zipfile
from collections import Counter
from pathlib import Path

import pytest

import mavhums
from mavhums import MavhumsError, Options, fleet
from mavhums.core.packed import ARCHIVES, COMPRESSED
from mavhums.flights.aircraft import UnnamedAircraftError
from mavhums.serve.uploads import keep
from tests.conftest import Run
from tests.fleet.stores import FOLDER, table, write_logs
from tests.fleet_logs import moved, nameless, small

DAY_S = 86_400.0
OLD = 3
NO_RULE = fleet.ScanOptions(workers=0)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of D-A and a store that was scanned by their folder, and a new log elsewhere."""
    folder = tmp_path_factory.mktemp("naming")
    write_logs(folder / "D-A", *[small(seconds=12.0)] * OLD)
    (folder / "Downloads").mkdir()
    new = moved(small(seconds=12.0), DAY_S * OLD)
    (folder / "Downloads" / "new.tlog").write_bytes(new)
    (folder / "Downloads" / "nameless.tlog").write_bytes(nameless(new))
    assert fleet.scan([folder / "D-A"], folder / "store", FOLDER).judged == OLD
    return folder


@pytest.fixture
def store(flown: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(flown / "store", tmp_path / "store"))


def names(store: Path) -> dict[str, int]:
    """Each aircraft and the number of its logs, as the store holds them."""
    names = {row["id"]: str(row["name"]) for row in table(store, "aircraft")}
    return dict(Counter(names[row["aircraft_id"]] for row in table(store, "flight")))


@pytest.mark.slow
def test_a_scan_goes_on_by_the_rule_of_the_store(flown: Path, store: Path, tmp_path: Path) -> None:
    fleet.scan([write_logs(tmp_path / "D-B", small(seconds=12.0), first=90)], store, NO_RULE)
    assert names(store) == {"D-A": OLD, "D-B": 1}


@pytest.mark.slow
def test_a_kept_log_that_the_rule_cannot_name_is_asked_for(run: Run, flown: Path, store: Path) -> None:
    log = flown / "Downloads" / "new.tlog"
    keep = ("analyse", log, "--store", store, "--keep", "--json")
    asked = run(*keep)
    assert asked.code == 1
    assert "which aircraft is it of?" in asked.err
    assert "--aircraft '=D-A'" in asked.err, "its board flew in that one"
    assert names(store) == {"D-A": OLD}
    assert run(*keep, "--aircraft", "=D-A").code in (0, 12)
    assert names(store) == {"D-A": OLD + 1}
    assert fleet.status(store).failures == ()


@pytest.mark.slow
def test_a_log_is_kept_once_wherever_a_copy_lies(run: Run, flown: Path, store: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.tlog"
    shutil.copyfile(flown / "D-A" / "01.tlog", copy)
    kept = run("analyse", copy, "--store", store, "--keep", "--json")
    assert kept.code in (0, 12), kept.err
    assert json.loads(kept.out)["log"]["flight"][0]["aircraft"] == "D-A"
    assert names(store) == {"D-A": OLD}
    assert fleet.status(store).judged == OLD
    wrong = run("analyse", copy, "--store", store, "--keep", "--aircraft", "=D-X")
    assert "has this log as one of D-A" in wrong.err
    assert names(store) == {"D-A": OLD}
    (tmp_path / "D-Z").mkdir()
    shutil.copyfile(copy, tmp_path / "D-Z" / "other.tlog")
    fleet.scan([tmp_path / "D-Z"], store, NO_RULE)
    assert names(store) == {"D-A": OLD}


def test_a_log_is_compared_with_the_flights_of_its_board(run: Run, flown: Path, store: Path) -> None:
    outcome = run("analyse", flown / "Downloads" / "new.tlog", "--store", store, "--json")
    assert json.loads(outcome.out)["log"]["flight"][0]["aircraft"] == "D-A"
    nameless = mavhums.analyse(flown / "Downloads" / "nameless.tlog", store=store)
    assert "--aircraft =NAME" in nameless.log.notices[-1]
    assert nameless.earlier_flights is None


@pytest.mark.slow
def test_a_rule_that_is_given_names_known_logs_again(flown: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    logs = flown / "D-A"
    fleet.scan([logs], store, NO_RULE)
    assert [name[:6] for name in names(store)] == ["board "]
    assert fleet.scan([logs], store, FOLDER) == (0, 0, OLD)
    assert names(store) == {"D-A": OLD}
    assert {path for path, _ in fleet.verdicts(store, "D-A")} == {str(path) for path in logs.iterdir()}


@pytest.mark.slow
def test_a_rule_without_a_name_for_a_log_makes_no_phantom(flown: Path, tmp_path: Path) -> None:
    judging = Options(aircraft=f"{re.escape(str(flown))}/(?P<aircraft>D-[A-Z])/")
    rule = fleet.ScanOptions(judging=judging, workers=0)
    fleet.scan([flown / "D-A", flown / "Downloads" / "new.tlog"], tmp_path / "store", rule)
    assert names(tmp_path / "store") == {"D-A": OLD, "": 1}


@pytest.mark.slow
def test_the_page_asks_whose_log_it_is_and_leaves_nothing_behind(flown: Path, store: Path) -> None:
    options, new = Options(store=store), flown / "Downloads" / "new.tlog"
    with pytest.raises(UnnamedAircraftError) as asked:
        keep(options, new)
    assert asked.value.proposed == ("D-A",)
    assert [*store.with_name("store.logs").iterdir()] == []
    assert names(store) == {"D-A": OLD}
    assert "kept in the store" in keep(options, new, "D-A")
    assert names(store) == {"D-A": OLD + 1}
    assert "has this log already" in keep(options, flown / "D-A" / "00.tlog")
    assert len([*store.with_name("store.logs").iterdir()]) == 1
    assert names(store) == {"D-A": OLD + 1}


@pytest.mark.slow
def test_the_page_receives_problem_and_remedy_as_they_are(store: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.tlog"
    bad.write_bytes(b"no log")
    with pytest.raises(MavhumsError) as refused:
        keep(Options(store=store), bad, "D-A")
    assert refused.value.problem.startswith("bad.tlog: ")
    assert refused.value.remedy


@pytest.mark.slow
def test_packed_logs_are_scanned_and_those_that_cannot_be_are_reported(flown: Path, tmp_path: Path) -> None:
    data = [path.read_bytes() for path in sorted((flown / "D-A").iterdir())]
    logs = tmp_path / "logs" / "D-P"
    logs.mkdir(parents=True)
    (logs / "0.tlog.xz").write_bytes(lzma.compress(data[0]))
    (logs / "1.tlog.bz2").write_bytes(bz2.compress(data[1]))
    notes = {"notes.txt": b"windy"}
    several = {"2.tlog": data[2], "D-Q/3.tlog": moved(data[2], DAY_S)}
    for name, files in (("several", several | notes), ("notes", notes)):
        with zipfile.ZipFile(logs / f"{name}.zip", "w") as archive:
            for path, content in files.items():
                archive.writestr(path, content)
    (logs / "damaged.zip").write_bytes(b"PK\x03\x04" + bytes(50))
    assert fleet.scan([tmp_path / "logs"], tmp_path / "store", FOLDER) == (4, 2, 0)
    assert names(tmp_path / "store") == {"D-P": 3, "D-Q": 1}
    failures = str(fleet.status(tmp_path / "store").failures)
    assert all(name in failures for name in ("notes.zip", "damaged.zip"))


def test_the_page_offers_what_is_read() -> None:
    pytest.importorskip("plotly", reason="the page needs the extra 'serve'")
    from mavhums.serve.pages import render

    values = {"packed": (*COMPRESSED, *ARCHIVES), "limit_bytes": 1, "limit_mb": "1", "where": ""}
    text = render("home.html", title="", here="", pages=[], **values)
    for suffix in (".tlog", ".BIN", ".ulg", ".gz", ".xz", ".bz2", ".zst", ".zip"):
        assert f"{suffix}," in text


def test_the_page_names_no_path_of_its_computer(flown: Path, tmp_path: Path) -> None:
    from mavhums.serve.worker import answer

    with zipfile.ZipFile(tmp_path / "several.zip", "w") as archive:
        for log in sorted((flown / "D-A").iterdir())[:2]:
            archive.write(log, log.name)
    job = {"do": "judge", "log": str(tmp_path / "several.zip"), "report": str(tmp_path / "r"), "options": {}}
    reply = answer([0], (0, job))
    assert str(tmp_path) not in json.dumps(reply)
    assert "contains 2 files" in reply["problem"]
    assert "drop the logs in it" in reply["remedy"]


@pytest.mark.parametrize("wrong", ["D-X/rudder", "D-A/ruder", "ruder", "D-X/"])
def test_a_repair_of_what_the_store_does_not_have_is_refused(run: Run, store: Path, wrong: str) -> None:
    refused = run("fleet", "repairs", "--store", store, "--add", f"{wrong}=2026-01-02")
    assert refused.code == 1
    assert "the store has: " in refused.err
    assert run("fleet", "repairs", "--store", store).out == "no repairs\n"
    assert run("fleet", "repairs", "--store", store, "--add", "D-A/rudder=2026-01-02").code == 0
