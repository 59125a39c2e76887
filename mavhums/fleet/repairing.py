"""Adds and removes repairs in a store: the verdicts of their aircraft are made again, without a log."""

from __future__ import annotations

import os

from mavhums.fleet.repairs import Repair, Repairs, add_repairs, remove_repairs, repairs_in
from mavhums.fleet.settling import settle
from mavhums.fleet.store import Store

__all__ = ["change_repairs"]


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
        repair that is to be removed.
    """
    kept = Store(store).opened()
    with kept.locked():
        aircraft = remove_repairs(kept, remove)
        aircraft |= add_repairs(kept, add)
        settle(kept, sorted(aircraft))
    return repairs_in(store)
