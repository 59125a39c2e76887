"""Repair dates in a store: the same as one command after each landing that is given each date in time."""

from __future__ import annotations

import json
from datetime import timedelta
from pathlib import Path

import pytest

from mavhums.core.errors import MavhumsError
from mavhums.flights.folder import keep_assessment
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Indicator
from tests.conftest import Run
from tests.flights import START, flown, shown, verdict

pytest.importorskip("deltalake")
pytest.importorskip("duckdb")
pytest.importorskip("distributed")

from mavhums import fleet
from mavhums.flights.aircraft_table import AircraftTable, Installation
from mavhums.flights.checkpoint import Checkpoint
from mavhums.flights.corrections import (
    Repair,
    add_repairs,
    reassigned,
    remove_repairs,
    repairs_in,
    repairs_of,
    since_of,
)
from mavhums.flights.folder import read_history
from mavhums.flights.history import PastFlight
from mavhums.flights.store import Store
from tests.fleet.stores import row_of, write_store

DATES = (
    Repair("D-A", "elevator", START + timedelta(days=15)),
    Repair(None, None, START + timedelta(days=31)),
    Repair("D-A", "elevator", START + timedelta(days=45)),
    Repair("D-B", None, START + timedelta(days=3)),
)


def flights() -> list[Assessment]:
    """Flights whose friction says on which day they were flown."""
    return [
        flown(*(verdict(shown(0.2 + day / 1000), actuator=name) for name in ("elevator", "rudder")), day=day)
        for day in range(70)
    ]


@pytest.mark.slow
def test_each_flight_is_held_against_those_since_the_last_repair(tmp_path: Path) -> None:
    write_store(tmp_path / "store", {"D-A": flights()[:1]})
    add_repairs(Store(tmp_path / "store"), DATES)
    known = Checkpoint(since_of(Store(tmp_path / "store"), "D-A"))
    for day, flight in enumerate(flights()):
        start = START + timedelta(days=day)
        given = {repair.actuator: repair.at for repair in DATES[:3] if repair.at <= start}
        expected = read_history(tmp_path / "kept").baselines("paper", start, given) if day else {}
        assert known.baselines("paper", start) == expected
        known.add(PastFlight.of(flight))
        keep_assessment(flight, tmp_path / "kept")


def test_a_store_keeps_repairs_and_names_the_aircraft_that_they_concern(tmp_path: Path) -> None:
    write_store(tmp_path, {"D-A": flights()[:2], "D-B": flights()[2:4]})
    store = Store(tmp_path)
    assert add_repairs(store, DATES[:1]) == {"D-A"}
    assert add_repairs(store, DATES) == {"D-A", "D-B"}
    assert add_repairs(store, DATES) == set()
    assert set(repairs_of(store, "D-A")) == set(DATES[:3])
    assert set(repairs_of(store, "D-B")) == {DATES[1], DATES[3]}


def test_a_mistake_is_removed(tmp_path: Path) -> None:
    write_store(tmp_path, {"D-A": flights()[:2], "D-B": flights()[2:4]})
    store = Store(tmp_path)
    assert repairs_in(tmp_path) == []
    add_repairs(store, DATES)
    assert remove_repairs(store, [DATES[0], DATES[3]]) == {"D-A", "D-B"}
    assert repairs_in(tmp_path) == [DATES[1], DATES[2]]
    with pytest.raises(MavhumsError, match=r"no repair D-A/elevator=2026-03-16T") as error:
        remove_repairs(store, [DATES[1], DATES[0]])
    assert error.value.remedy == "the store has: 2026-04-01T09:00:00, D-A/elevator=2026-04-15T09:00:00"
    assert remove_repairs(store, DATES[1:2]) == {"D-A", "D-B"}
    assert remove_repairs(store, DATES[2:3]) == {"D-A"}
    assert repairs_in(tmp_path) == []
    assert since_of(store, "D-A")(START + timedelta(days=60)) == {}


@pytest.mark.slow
def test_a_scan_with_a_new_date_opens_no_log(run: Run, tmp_path: Path) -> None:
    from mavhums_sim import Flight, fly, write_tlog
    from tests.fleet_logs import moved

    folder = tmp_path / "D-A"
    folder.mkdir()
    write_tlog(fly(Flight(1, 21.0, rate_hz=25.0, tiers=("instrumented",))), tmp_path / "kind")
    for day in range(12):
        (folder / f"{day:02}.tlog").write_bytes(moved((tmp_path / "kind").read_bytes(), 86_400.0 * day))
    command = ("fleet", "scan", folder, "--to", tmp_path / "store", "--aircraft", "folder", "--json")
    assert json.loads(run(*command).out)["judged"] == 12
    assert any(one.baseline for one in last(tmp_path / "store"))
    again = run(*command, "--baseline-from", "D-A/=2026-01-05")
    assert json.loads(again.out) == {"judged": 0, "failed": 0, "known": 12, "foreign_boards": []}
    assert not any(one.baseline for one in last(tmp_path / "store"))
    assert run(*command, "--baseline-from", "D-A/=yesterday").code == 2


@pytest.mark.slow
def test_a_scan_names_the_aircraft_that_nobody_has(run: Run, short_log: Path, tmp_path: Path) -> None:
    """Whether an aircraft exists is known once its logs are judged: they are kept, the date is not."""
    folder = tmp_path / "D-A"
    folder.mkdir()
    (folder / "00.tlog").write_bytes(short_log.read_bytes())
    command = ("fleet", "scan", folder, "--to", tmp_path / "store", "--aircraft", "folder", "--workers", "0")
    dates = ("--baseline-from", "D-AA/rudder=2026-01-05", "--baseline-from", "D-A/rudder=2026-01-05")
    told = run(*command, *dates)
    assert told.code == 1
    assert "no aircraft D-AA" in told.err
    assert "the store has: D-A" in told.err
    assert [str(one) for one in repairs_in(tmp_path / "store")] == ["D-A/rudder=2026-01-05"]
    assert fleet.status(tmp_path / "store").judged == 1


def last(store: Path) -> list[Indicator]:
    """Return the indicators of the last flight."""
    return [one for _, verdict in fleet.verdicts(store, "D-A")[-4:] for one in verdict.indicators]


def test_a_table_names_the_flights_of_its_boards_and_no_others(tmp_path: Path) -> None:
    """The board moves from D-B to D-Z at noon of the third day; each flight begins at nine."""
    store = Store(tmp_path)
    rows = [row_of(flight, "D-M")._replace(board="0A") for flight in flights()[:4]]
    rows += [row_of(flights()[4], "D-M")._replace(board="0B"), row_of(flights()[5], "D-M")]
    store.add_logs(rows)
    noon = START + timedelta(days=2, hours=3)
    both = [{"aircraft": "D-B", "board": "0A", "to": noon}, {"aircraft": "D-Z", "board": "0A", "from": noon}]
    assert reassigned(store, AircraftTable()) == set()
    table = AircraftTable(map(Installation.model_validate, both))
    assert reassigned(store, table) == {"D-M", "D-B", "D-Z"}
    named = store.query("SELECT aircraft FROM logs ORDER BY start_us").fetchall()
    assert [name for (name,) in named] == ["D-B", "D-B", "D-B", "D-Z", "D-M", "D-M"]
    assert reassigned(store, table) == set()
