"""Adds and removes repairs in a store: the verdicts of their aircraft are made again, without a log."""

from __future__ import annotations

import os
from typing import Final

from mavhums.core.errors import MavhumsError
from mavhums.fleet.second_pass import second_pass
from mavhums.flights.repairs import Repair, Repairs, add_repairs, remove_repairs, repairs_in
from mavhums.flights.stores.delta import Store

__all__ = ["change_repairs"]

_SHOWN: Final = 20


def change_repairs(store: str | os.PathLike[str], *, add: Repairs = (), remove: Repairs = ()) -> list[Repair]:
    """Add and remove repairs, compare the flights of their aircraft again, and return all repairs.

    Parameters
    ----------
    store
        Folder or address of the store.
    add
        Repairs to be stored; one that is there already changes nothing.
    remove
        Repairs that were entered by mistake.

    Raises
    ------
    MavhumsError
        If the store does not exist or cannot be written, another scan writes into it, or it does not have a
        repair that is to be removed, or the aircraft or actuator of one that is to be added.
    """
    kept = Store(store).opened()
    _hold_known(kept, add)
    with kept.locked():
        aircraft = remove_repairs(kept, remove)
        aircraft |= add_repairs(kept, add)
        second_pass(kept, sorted(aircraft))
    return repairs_in(store)


def _hold_known(store: Store, repairs: Repairs) -> None:
    """Refuse repairs of aircraft or actuators that no flight in the store has.

    Raises
    ------
    MavhumsError
        If there is one; then none is stored.
    """
    found = store.query("SELECT DISTINCT aircraft, actuator FROM verdicts WHERE aircraft <> ''").fetchall()
    for repair in repairs:
        aircraft = {name for name, _ in found}
        if repair.aircraft is not None and repair.aircraft not in aircraft:
            raise MavhumsError(f"{store.place}: no aircraft {repair.aircraft}", _there(aircraft))
        actuators = {actuator for name, actuator in found if repair.aircraft in (None, name)}
        if repair.actuator is not None and repair.actuator not in actuators:
            whose = f" of {repair.aircraft}" if repair.aircraft else ""
            raise MavhumsError(f"{store.place}: no actuator {repair.actuator}{whose}", _there(actuators))


def _there(names: set[str]) -> str:
    several = sorted(names)
    return f"the store has: {', '.join(several[:_SHOWN]) or 'none'}{', …' if len(several) > _SHOWN else ''}"
