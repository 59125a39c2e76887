"""Repair dates in a store: the same as one command after each landing that is given each date in time."""

from __future__ import annotations

import json
import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from mavhums.core.errors import MavhumsError
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Indicator
from tests.conftest import Run
from tests.flights import START, flown, shown, verdict

pytest.importorskip("distributed")

from mavhums import fleet
from mavhums.flights.corrections import change_repairs, repairs_in
from mavhums.flights.store import Store
from mavhums.flights.store.dates import Repair, repairs_of, since_of
from mavhums.flights.store.logs import aircraft_id
from tests.fleet.stores import write_store

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


def test_a_store_keeps_repairs_until_a_mistake_is_removed(tmp_path: Path) -> None:
    store = tmp_path / "store"
    write_store(store, {"D-A": flights()[:2], "D-B": flights()[2:4]})
    assert repairs_in(store) == []
    for _ in range(2):
        assert change_repairs(store, add=DATES) == [DATES[1], DATES[0], DATES[2], DATES[3]]
    with Store(store).reading() as connection:
        own = repairs_of(connection, aircraft_id(connection, "D-A", creates=False))
    assert own == [DATES[1], DATES[0], DATES[2]]
    assert change_repairs(store, remove=[DATES[0], DATES[3]]) == [DATES[1], DATES[2]]
    with pytest.raises(MavhumsError, match=r"no repair D-A/elevator=2026-03-16T") as error:
        change_repairs(store, remove=[DATES[1], DATES[0]])
    assert error.value.remedy == "the store has: 2026-04-01T09:00:00, D-A/elevator=2026-04-15T09:00:00"
    assert change_repairs(store, remove=DATES[1:3]) == []
    with Store(store).reading() as connection:
        since = since_of(connection, aircraft_id(connection, "D-A", creates=False) or 0)
    assert since(START + timedelta(days=60)) == {}


@pytest.mark.slow
def test_a_new_date_opens_no_log(run: Run, tmp_path: Path) -> None:
    from mavhums_sim import Flight, fly, write_tlog
    from tests.fleet_logs import moved

    folder = tmp_path / "D-A"
    folder.mkdir()
    write_tlog(fly(Flight(1, 21.0, rate_hz=25.0, tiers=("instrumented",))), tmp_path / "kind")
    for day in range(12):
        (folder / f"{day:02}.tlog").write_bytes(moved((tmp_path / "kind").read_bytes(), 86_400.0 * day))
    command = ("fleet", "scan", folder, "--store", tmp_path / "store", "--aircraft", "folder", "--json")
    assert json.loads(run(*command).out)["judged"] == 12
    assert any(one.baseline for one in last(tmp_path / "store"))
    shutil.rmtree(folder)
    repaired = run("fleet", "repairs", "--store", tmp_path / "store", "--add", "D-A/=2026-01-05")
    assert repaired.out == "D-A/=2026-01-05\n"
    assert not any(one.baseline for one in last(tmp_path / "store"))


def last(store: Path) -> list[Indicator]:
    """Return the indicators of the last flight."""
    return [one for _, verdict in fleet.verdicts(store, "D-A")[-4:] for one in verdict.indicators]
