"""Repair dates in a store: the same as one command after each landing that is given each date in time."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import pytest

from mavhums.core.errors import MavhumsError
from tests.flights import START, flown, shown, verdict

pytest.importorskip("distributed")

from mavhums.flights.corrections import change_repairs, repairs_in
from mavhums.flights.store import Store
from mavhums.flights.store.logs import Repair, aircraft_id, repairs_of, since_of
from tests.fleet.stores import write_store

DATES = (
    Repair("D-A", "elevator", START + timedelta(days=15)),
    Repair(None, None, START + timedelta(days=31)),
    Repair("D-A", "elevator", START + timedelta(days=45)),
    Repair("D-B", None, START + timedelta(days=3)),
)


def test_a_store_keeps_repairs_until_a_mistake_is_removed(tmp_path: Path) -> None:
    store = tmp_path / "store"
    both = [verdict(shown(0.2), actuator=name) for name in ("elevator", "rudder")]
    flights = [flown(*both, day=day) for day in range(4)]
    write_store(store, {"D-A": flights[:2], "D-B": flights[2:]})
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
