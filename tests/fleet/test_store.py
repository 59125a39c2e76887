"""What a store does with its tables, each rule on both sides of its limit."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from mavhums.core.errors import MavhumsError

pytest.importorskip("deltalake")
pytest.importorskip("duckdb")

from deltalake.exceptions import CommitFailedError, DeltaError

from mavhums.flights import store as stores
from mavhums.flights.aircraft import BOARD, GIVEN, AircraftResolver
from mavhums.flights.aircraft_table import AircraftTable, Installation
from mavhums.flights.naming import BOARD_NAME, proposed, remember, resolver_of_store, rule_of
from mavhums.flights.queries import WorstActuator
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store_tables import DATES, LOGS, SETTLED, STANDINGS, VERDICTS, Tables
from tests.fleet.stores import row_of
from tests.flights import flown, verdict


@pytest.mark.parametrize("lost", [0, 1, stores._ATTEMPTS - 1, stores._ATTEMPTS])
def test_an_overtaken_change_is_made_again_ever_later(lost: int, monkeypatch: pytest.MonkeyPatch) -> None:
    pauses_s: list[float] = []
    monkeypatch.setattr(time, "sleep", pauses_s.append)
    monkeypatch.setattr(random, "random", lambda: 0.5)
    attempts = iter(range(lost + 1))

    def change() -> None:
        if next(attempts) < lost:
            raise CommitFailedError

    store = Store("store")
    if lost < stores._ATTEMPTS:
        store.retried(change)
    else:
        with pytest.raises(MavhumsError, match="store: other scans change the same aircraft all the time"):
            store.retried(change)
    assert pauses_s == pytest.approx([k * stores._PAUSE_S / 2 for k in range(1, lost + 1)])


def test_what_else_fails_is_told_at_once() -> None:
    def change() -> None:
        raise DeltaError("\x1b[31mtop\x1b[0m\n ↳  below\n\n")

    store = Store("store")
    with pytest.raises(MavhumsError) as told:
        store.retried(lambda: store._changed(change))
    assert told.value.problem == "store: cannot be written: top: below"


def stored(aircraft: str, standings: str, stored_ns: int) -> dict[str, object]:
    return {"aircraft": aircraft, "standings": standings, "stored": stored_ns}


def test_of_standings_the_last_of_each_day_is_kept_where_files_are_joined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    day, store = stores._DAY_NS, Store(tmp_path)
    rows = [
        stored("D-A", "first", 3 * day),
        stored("D-A", "last of the day", 4 * day - 1),
        stored("D-A", "next", 4 * day),
        stored("D-B", "other", 3 * day + 1),
    ]
    for row in rows:
        store.append(STANDINGS, [row])
    for most, left in ((4, rows), (3, rows[1:])):
        monkeypatch.setattr(stores, "_COMPACT_FILES", most)
        store.tidy()
        told = store.query("SELECT aircraft, standings, stored FROM standings ORDER BY stored").fetchall()
        assert sorted(told) == sorted(tuple(row.values()) for row in left)
        assert Tables(str(tmp_path)).files(STANDINGS) == (4 if left is rows else 1)


def test_of_what_is_settled_the_latest_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stores, "_COMPACT_FILES", 1)
    store = Store(tmp_path)
    for aircraft, stored_ns in (("D-A", 2), ("D-A", 1), ("D-B", 1)):
        store.append(SETTLED, [{"aircraft": aircraft, "digest": f"{stored_ns}", "stored": stored_ns}])
    store.tidy()
    told = store.query("SELECT aircraft, digest, stored FROM settled ORDER BY aircraft").fetchall()
    assert told == [("D-A", "2", 2), ("D-B", "1", 1)]


def test_an_empty_change_makes_no_table(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.replace(VERDICTS, "D-A", [])
    store.rename({})
    store.delete(DATES, "aircraft = 'D-A'")
    store.add_verdicts("D-A", [], [])
    assert not list(tmp_path.iterdir())
    with pytest.raises(MavhumsError, match="no store of a fleet"):
        store.opened()


def test_rows_are_replaced_of_one_aircraft_alone(tmp_path: Path) -> None:
    store = Store(tmp_path)
    for aircraft in ("D'A", "D-B"):
        store.replace(VERDICTS, aircraft, [{"aircraft": aircraft, "path": path} for path in "ab"])
    store.replace(VERDICTS, "D'A", [{"aircraft": "D'A", "path": "c"}])
    told = store.query("SELECT aircraft, path FROM verdicts ORDER BY path").fetchall()
    assert told == [("D-B", "a"), ("D-B", "b"), ("D'A", "c")]
    store.replace(VERDICTS, "D-B", [])
    assert store.query("SELECT aircraft, path FROM verdicts").fetchall() == [("D'A", "c")]


def log_row(path: str, *, settings: str = "", time_ns: int = 1) -> Row:
    row = row_of(flown(verdict(), name=path.removesuffix(".tlog")), "D-A")
    return row._replace(path=path, settings=settings, time_ns=time_ns)


@pytest.mark.parametrize("few", [0, 1, 2])
def test_logs_are_known_by_path_size_and_time_with_their_latest_settings(
    few: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stores, "_FEW", few)
    store = Store(tmp_path)
    store.add_logs([log_row("a.tlog"), log_row("a.tlog", settings="new"), log_row("b'.tlog", time_ns=2)])
    asked = [LogFile("a.tlog", 1, 1), LogFile("b'.tlog", 1, 2)]
    assert store.known(asked) == {asked[0]: "new", asked[1]: ""}
    known = store.known(asked[:1])
    assert known.pop(asked[0]) == "new"
    assert bool(known) == (few == 0), "only where few are asked for, only their paths are read"
    assert len(store.known([])) == 2


def test_flights_of_an_aircraft_come_in_order_of_time_each_in_its_latest_judgement(tmp_path: Path) -> None:
    store = Store(tmp_path)
    rows = [log_row(f"{k}.tlog")._replace(start_us=start_us) for k, start_us in enumerate((5, 3, 9))]
    store.add_logs([row._replace(flight=f"old {k}".encode()) for k, row in enumerate(rows)])
    store.add_logs([rows[1]._replace(flight=b"new 1")])
    store.add_logs([log_row("x.tlog")._replace(aircraft="D-B"), log_row("y.tlog")._replace(sha256=None)])
    assert list(store.flights("D-A")) == [b"new 1", b"old 0", b"old 2"]
    asked = [row.sha256 for row in rows[:2] if row.sha256]
    assert list(store.flights("D-A", asked)) == [b"new 1", b"old 0"]
    assert list(store.flights("D-C")) == list(store.flights("D-A", asked[:0] or ["none"])) == []
    store.rename(dict.fromkeys(asked, "D-C"))
    assert list(store.flights("D-C")) == [b"new 1", b"old 0"]
    assert store.query(f"SELECT count(*), count(DISTINCT scanned) FROM {LOGS}").fetchone() == (6, 6)


@pytest.mark.slow
def test_a_store_remembers_the_rule_and_the_boards_of_its_scans(tmp_path: Path) -> None:
    store = Store(tmp_path)
    board = Installation(aircraft="D-A", board="0A")
    actuator = Installation(aircraft="D-A", actuator="rudder", serial="1")
    assert rule_of(store) is None
    for given, boards, rule, kept, rows in (
        ("=D-A", [], "=", [], 1),
        ("folder", [board, actuator], "folder", [board], 2),
        (None, [], "folder", [board], 2),  # nothing new
        ("=D-A", [actuator], "folder", [board], 2),
        ("board", [], "board", [board], 3),
    ):
        remember(store, AircraftResolver(given, AircraftTable(boards)))
        assert rule_of(store) == rule
        known = resolver_of_store(store, AircraftResolver())
        assert (known.rule, list(known.table.installed)) == (rule, kept)
        assert store.query("SELECT count(*) FROM naming").fetchone() == (rows,)
    own = resolver_of_store(store, AircraftResolver("folder", AircraftTable([actuator])))
    assert (own.rule, list(own.table.installed)) == ("folder", [actuator])


@pytest.mark.parametrize(
    ("aircraft", "rule"), [("", BOARD), (f"{BOARD_NAME}0A", BOARD), ("D-A", GIVEN), (None, None)]
)
def test_the_rule_of_an_older_store_is_told_by_its_names(
    aircraft: str | None, rule: str | None, tmp_path: Path
) -> None:
    store = Store(tmp_path)
    broken = log_row("b.tlog")._replace(flight=None)
    store.add_logs([broken] if aircraft is None else [broken, log_row("a.tlog")._replace(aircraft=aircraft)])
    assert rule_of(store) == rule


def test_a_board_proposes_the_named_aircraft_in_which_it_flew_the_latest_first(tmp_path: Path) -> None:
    store = Store(tmp_path)
    flew = [("D-A", 1, "0A"), ("D-B", 3, "0A"), ("D-A", 2, "0A"), ("D-C", None, "0A"), ("D-D", 9, "0B")]
    rows = [
        log_row(f"{k}.tlog")._replace(aircraft=name, start_us=start_us, board=board)
        for k, (name, start_us, board) in enumerate([*flew, ("", 9, "0A")])
    ]
    store.add_logs([*rows, log_row("x.tlog")._replace(aircraft="D-E", board="0A", flight=None)])
    assert proposed(store, "0A") == ["D-B", "D-A", "D-C"]
    assert proposed(store, None) == []


@pytest.mark.parametrize(
    ("start_us", "told"),
    [
        (None, None),
        (0, "1970-01-01T00:00:00+00:00"),
        (1_772_355_600_250_000, "2026-03-01T09:00:00.250000+00:00"),
    ],
)
def test_a_published_flight_has_its_own_time_and_names_no_unknown_aircraft(
    start_us: int | None, told: str | None
) -> None:
    for aircraft in ("", "alpha"):
        published = WorstActuator(aircraft, "f.tlog", start_us, verdict()).published()
        assert (published.start_utc, published.aircraft) == (told, aircraft or None)
