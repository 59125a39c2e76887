"""A corrected store holds what one holds that was scanned so from the start, and scans leave it so."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import Connection, select, update

from tests.conftest import Run
from tests.fleet.stores import add, row_of, table, write_logs, write_store
from tests.fleet_logs import moved, small
from tests.flights import START, flown, shown, verdict

pytest.importorskip("distributed")

from mavhums import fleet
from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import BOARD, AircraftResolver, AircraftTable, Installation
from mavhums.flights.naming import foreign_board_among, foreign_boards, remember
from mavhums.flights.queries import standings
from mavhums.flights.store import Row, Store
from mavhums.flights.store.logs import aircraft_id, installed
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT


def judged(name: str, days: range, level: float, slope: float = 0.0) -> list[Row]:
    rng = np.random.default_rng(days.start)
    rows = []
    for day in days:
        value = level + slope * day + 0.004 * float(rng.standard_normal())
        condition = "degraded" if value > 0.4 else "normal"
        path = f"logs/{name}/{day:02}"
        flight = flown(verdict(shown(value), condition=condition), day=day + 0.1 * level, name=path)  # type: ignore[arg-type]
        rows.append(row_of(flight, name))
    return rows


def written(folder: Path, rows: list[Row]) -> Path:
    add(folder, *rows)
    return folder


def held(store: str | Path) -> tuple[object, ...]:
    """All that a store says: verdicts, recordings that do not count, and each aircraft's state."""
    flights = {row["id"]: row["path"] for row in table(store, "flight")}
    names = {row["id"]: row["name"] for row in table(store, "aircraft")}
    verdicts = {(row["flight_id"], row["place"]): row["verdict"] for row in table(store, "record")}
    rows = [
        (flights[row["flight_id"]], names[row["aircraft_id"]], row["counts"], row["last"], verdicts[at])
        for row in table(store, "verdict")
        for at in [(row["flight_id"], row["place"])]
    ]
    status = fleet.status(store).model_dump(exclude={"foreign_boards", "growing", "removed"})
    with Store(store).reading() as connection:
        return sorted(map(str, rows)), standings(connection), status


GROWS = judged("D-A", range(14), 0.22, 0.012)
STILL = judged("D-B", range(4), 0.30)
FOREIGN = [row._replace(aircraft="D-A") for row in judged("D-C", range(3, 5), 0.45)]


def without_foreign(folder: Path) -> list[Row]:
    fleet.remove(folder, ["logs/D-C"], who="me", note="bench")
    return [*GROWS, *STILL]


def moved_to(folder: Path) -> list[Row]:
    fleet.move(folder, [f"D-C/{day:02}.tlog" for day in (3, 4)], "D-B")
    assert "moved 2 logs, logs/D-C/03.tlog and others, from D-A to D-B" in str(fleet.journal(folder)[-1])
    return [*GROWS, *STILL, *(row._replace(aircraft="D-B") for row in FOREIGN)]


def undone(folder: Path) -> list[Row]:
    for correct in (without_foreign, moved_to, renamed, joined):
        if correct is moved_to:
            fleet.undo(folder, 1)
        correct(folder)
    for number in (4, 3, 2):
        fleet.undo(folder, number)
    return [*GROWS, *STILL, *FOREIGN]


def renamed(folder: Path) -> list[Row]:
    fleet.rename(folder, "D-B", "D-Z")
    return [*GROWS, *(row._replace(aircraft="D-Z") for row in STILL), *FOREIGN]


def joined(folder: Path) -> list[Row]:
    last = max(one.aircraft or "" for one in fleet.worst(folder))
    with pytest.raises(MavhumsError, match="is there already"):
        fleet.rename(folder, last, "D-A")
    fleet.rename(folder, last, "D-A", join=True)
    return [*GROWS, *(row._replace(aircraft="D-A") for row in STILL), *FOREIGN]


@pytest.mark.slow
@pytest.mark.parametrize("correct", [without_foreign, moved_to, renamed, joined, undone])
def test_the_verdicts_are_those_of_a_store_scanned_so_from_the_start(
    tmp_path: Path, correct: Callable[[Path], list[Row]]
) -> None:
    wrong = written(tmp_path / "wrong", [*GROWS, *STILL, *FOREIGN])
    before = held(wrong)
    right = written(tmp_path / "right", correct(wrong))
    assert held(wrong) == held(right)
    assert (held(wrong) == before) == (correct is undone)
    count = len(fleet.journal(wrong))
    if correct in (without_foreign, moved_to):
        correct(wrong)
        assert len(fleet.journal(wrong)) == count, "a correction that is made twice changes nothing"
    if correct is undone:
        with pytest.raises(MavhumsError, match="2 is undone already"):
            fleet.undo(wrong, 2)
        assert [one.undone for one in fleet.journal(wrong)] == [True] * 4


@pytest.mark.slow
def test_an_interrupted_correction_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = written(tmp_path / "wrong", [*GROWS, *STILL, *FOREIGN])
    before = held(wrong)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mavhums.flights.corrections.make_verdicts", stop)
    for change in (moved_to, without_foreign):
        with pytest.raises(KeyboardInterrupt):
            change(wrong)
    assert held(wrong) == before
    assert not fleet.journal(wrong)


@pytest.mark.slow
def test_names_follow_the_last_correction(tmp_path: Path) -> None:
    folder = written(tmp_path / "store", [*STILL, *FOREIGN])
    fleet.move(folder, ["D-C/03.tlog"], "D-B")
    fleet.rename(folder, "D-B", "D-C")
    fleet.rename(folder, "D-C", "D-D")
    fleet.rename(folder, "D-D", "D-B")
    assert fleet.trend(folder, "D-B").flights == len(STILL) + 1
    for wrong, match in ((["03.tlog"], "names 2 logs"), (["nowhere"], "no log nowhere")):
        with pytest.raises(MavhumsError, match=match):
            fleet.remove(folder, wrong)
    with pytest.raises(MavhumsError, match="no aircraft D-Q"):
        fleet.rename(folder, "D-Q", "D-R")
    with pytest.raises(MavhumsError, match="no name"):
        fleet.move(folder, ["D-C/03.tlog"], " ")


def _counts(store: Path) -> tuple[int, int, int]:
    status = fleet.status(store)
    return status.judged, status.aircraft, status.unknown


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("corrections") / "logs"
    write_logs(folder / "D-A", *[small(seconds=12.0)] * 3)
    write_logs(folder / "D-B", moved(small(seconds=12.0), 43_200.0))
    return folder


@pytest.mark.slow
def test_a_scan_brings_nothing_back_and_says_so(run: Run, logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    scan = ("fleet", "scan", logs, "--store", store, "--aircraft", "folder", "--workers", "0")
    assert run(*scan).code == 0
    gone = logs / "D-A" / "01.tlog"
    outcome = run("fleet", "remove", "--store", store, gone, "--by", "Ada", "--note", "on the bench")
    assert (outcome.code, outcome.err) == (0, "")
    assert "nothing to do" in run("fleet", "remove", "--store", store, gone).out
    run("fleet", "move", "--store", store, logs / "D-B" / "00.tlog", "D-A", "--by", "Ada")
    run("fleet", "rename", "--store", store, "D-A", "D-X", "--by", "Ada")
    copy = tmp_path / "D-B"
    copy.mkdir()
    shutil.copyfile(gone, copy / "again.tlog")
    for sources in ((logs,), (logs, copy)):
        again = run("fleet", "scan", *sources, "--store", store, "--aircraft", "folder", "--workers", "0")
        assert again.out.splitlines()[0].startswith("0 logs judged, 0 could not be, ")
        assert " out: mavhums fleet journal" in again.out
    assert {row.aircraft for row in fleet.worst(store)} == {"D-X"}
    assert _counts(store) == (3, 1, 0)
    kept = run("analyse", gone, "--store", store, "--keep", "--aircraft", "=D-X")
    assert kept.code == 1
    assert f"was removed from {store}" in kept.err
    listed = json.loads(run("fleet", "journal", "--store", store, "--json").out)
    changes = [("remove", None, None), ("move", None, "D-A"), ("rename", "D-A", "D-X")]
    assert [(one["kind"], one["before"], one["after"]) for one in listed] == changes
    assert {one["who"] for one in listed} == {"Ada"}
    [log] = listed[0]["logs"]
    assert (log["path"], log["aircraft"], log["pinned"]) == (str(gone), "D-A", False)
    assert "Ada: removed" in run("fleet", "journal", "--store", store).out
    assert "(undone)" in run("fleet", "journal", "--store", store, "--undo", "1").out
    assert _counts(store) == (4, 1, 0)
    assert {row.aircraft for row in fleet.worst(store)} == {"D-X"}


@pytest.mark.slow
def test_a_board_that_is_not_the_aircrafts_is_reported(run: Run, logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    scan = ("fleet", "scan", logs, "--store", store, "--aircraft", "folder", "--workers", "0")
    assert "board" not in run(*scan).out

    def foreign(end: str) -> None:
        with Store(store).writing() as connection:
            named = FLIGHT.c.path.endswith(end)
            connection.execute(update(FLIGHT).where(named).values(board="0B"))

    foreign("D-A/01.tlog")
    for said in (run(*scan).out, run("fleet", "status", "--store", store).out):
        assert "D-A: " in said
        assert "D-A/01.tlog has the board 0B, and 2 other flights have" in said
        assert f"mavhums fleet move --store {store} {logs}/D-A/01.tlog AIRCRAFT" in said
    assert json.loads(run(*scan, "--json").out)["foreign_boards"][0]["board"] == "0B"
    foreign("tlog")
    log = logs / "D-A" / "02.tlog"
    outcome = run("analyse", log, "--store", store, "--aircraft", "folder")
    assert "another aircraft's log" in outcome.out + outcome.err
    run("fleet", "move", "--store", store, log, "D-A")
    assert "another aircraft's log" not in run("analyse", log, "--store", store).out


def test_a_board_that_the_table_or_a_correction_puts_there_is_not_foreign(tmp_path: Path) -> None:
    """D-A flew with 0A; as often with the 0B of the table, then with the 0C of a correction, 0D and 0E."""
    boards = ("0A", "0A", "0A", "0B", "0B", "0C", "0C", "0D", "0D", "0E")
    flights = [flown(verdict(), day=day, name=f"{day:02}-{board}") for day, board in enumerate(boards)]
    rows = [row_of(one, "D-A")._replace(board=board) for one, board in zip(flights, boards, strict=True)]
    others = [row_of(flown(verdict(), day=20 + k, name=f"b-{k}"), "D-B") for k in range(3)]
    undated = row_of(flown(verdict(), day=30, name="undated"), "D-A")._replace(board="0B", start_us=None)
    store = tmp_path / "store"
    add(store, *rows, *(row._replace(board="0D") for row in others), undated)
    fleet.move(store, ["05-0C.tlog"], "D-A")
    entry = {"aircraft": "D-A", "board": "0B", "from": START + timedelta(days=4)}
    with Store(store).writing() as connection:
        entries = AircraftTable([Installation.model_validate(entry)])
        remember(connection, AircraftResolver(BOARD, entries), [])
        asserted(connection)


def asserted(connection: Connection) -> None:
    found = [
        (one.board, one.logs, one.elsewhere)
        for one in foreign_boards(connection)
        if (one.aircraft, one.usual, one.flights) == ("D-A", "0A", 3)
    ]
    assert len(found) == len(foreign_boards(connection))
    assert found == [
        ("0B", ("03-0B.tlog", "undated.tlog"), None),
        ("0C", ("06-0C.tlog",), None),
        ("0D", ("07-0D.tlog", "08-0D.tlog"), "D-B"),
        ("0E", ("09-0E.tlog",), None),
    ]
    same, other = (("0A", 0), (None, 0), ("0B", 4)), (("09", 0), ("0E", 9), ("0B", 3))
    for board, day in same + other:
        start_utc = (START + timedelta(days=day)).isoformat()
        notice = foreign_board_among(connection, "D-A", board, start_utc)
        assert (notice is not None) == ((board, day) in other)
        expected = f"compared with 3 flights of D-A with the board 0A, but this log has the board {board}: "
        assert not notice or notice.startswith(expected)
    assert foreign_board_among(connection, "D-A", "0B", None)
    assert foreign_board_among(connection, "D-Z", "0B", None) is None
    notice = foreign_board_among(connection, "D-B", "0A", None)
    assert str(notice).startswith("compared with 3 flights of D-B")


def test_a_table_names_the_logs_of_its_boards_and_no_corrected_one(tmp_path: Path) -> None:
    """Board 0B is in D-B from day 4; a rudder is swapped in D-C; the log of day 6 is D-A's by correction."""
    flights = [flown(verdict(), day=day, name=f"{day:02}") for day in range(8)]
    boards = ("0B", "0A", "0B", "0B", "0B", "0B", "0B", None)
    rows = [row_of(one, "D-A")._replace(board=board) for one, board in zip(flights, boards, strict=True)]
    rows[5] = rows[5]._replace(aircraft="D-B")
    store = tmp_path / "store"
    add(store, *rows)
    fleet.move(store, ["06.tlog"], "D-A")
    board = {"aircraft": "D-B", "board": "0b", "from": START + timedelta(days=4)}
    rudder = {"aircraft": "D-C", "actuator": "rudder", "serial": "R2", "from": START}
    entries = AircraftTable(map(Installation.model_validate, (board, rudder)))
    for _ in range(2):
        with Store(store).writing() as connection:
            remember(connection, AircraftResolver(None, entries), [])
            names = {row.id: row.name for row in connection.execute(select(AIRCRAFT))}
            flown_by = select(FLIGHT.c.aircraft_id).order_by(FLIGHT.c.path)
            named = [names[one] for one in connection.scalars(flown_by)]
            ids = [aircraft_id(connection, name) for name in ("D-C", "D-B")]
            [part], [whole] = (installed(connection, one).installed for one in ids)
        assert named == [*["D-A"] * 4, "D-B", "D-B", "D-A", "D-A"]
        assert (part.actuator, part.board, whole.actuator, whole.board) == ("rudder", None, None, "0b")


@pytest.mark.slow
def test_a_whole_path_comes_before_a_folder_and_a_folder_before_the_end_of_a_path(tmp_path: Path) -> None:
    names = ("/a/x", "/b/a/x", "/b/a/x.tlog/y", "/c/z")
    store = tmp_path / "store"
    write_store(store, {"D-A": [flown(verdict(), day=k, name=name) for k, name in enumerate(names)]})

    def named(given: str) -> list[str]:
        done = fleet.remove(store, [given])
        assert done is not None
        fleet.undo(store, done.number)
        return [one.path for one in done.logs]

    assert named("/a/x.tlog") == ["/a/x.tlog"]
    assert named("/b/a/x.tlog/y.tlog") == ["/b/a/x.tlog/y.tlog"]
    assert named("/b") == ["/b/a/x.tlog", "/b/a/x.tlog/y.tlog"]
    assert named("b/a/x.tlog") == ["/b/a/x.tlog"]
    assert named("z.tlog") == ["/c/z.tlog"]
    sha256 = flown(verdict(), name="/c/z").log.sha256 or ""
    assert named(sha256[:8]) == named(sha256[:8].upper()) == named(sha256) == ["/c/z.tlog"]
    for nothing in (sha256[:7], "tlog"):
        with pytest.raises(MavhumsError, match="no log"):
            named(nothing)
    with pytest.raises(MavhumsError, match=r"x\.tlog: names 2 logs") as error:
        named("x.tlog")
    assert error.value.remedy == "name one: /a/x.tlog, /b/a/x.tlog"
