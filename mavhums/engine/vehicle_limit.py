"""Limits the number of judged vehicles: a sender can fake any number, and each costs memory and time."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from mavhums.log import Table

__all__ = ["MOST", "VehicleLimit"]

MOST: Final = 32
"""Vehicles that are judged at most."""


class VehicleLimit:
    """Admits the first vehicles of a log, in the order of the log, whatever the block size.

    Parameters
    ----------
    messages
        Names of the messages that describe actuators; a vehicle that sends none takes no place.
    """

    def __init__(self, messages: Collection[str]) -> None:
        self._messages = frozenset(messages)
        self._admitted: set[int] = set()

    def observe(self, tables: Mapping[str, Table]) -> None:
        """Admit the senders of the next messages, as long as there is room."""
        if len(self._admitted) == MOST:
            return
        first: dict[int, int] = {}
        for name in self._messages & tables.keys():
            systems, places = np.unique(tables[name].system, return_index=True)
            for system, frame in zip(systems.tolist(), tables[name].frame[places].tolist(), strict=True):
                first[system] = min(frame, first.get(system, frame))
        for system in sorted(first, key=first.__getitem__):
            if len(self._admitted) < MOST:
                self._admitted.add(system)

    def admits(self, vehicle: int | None) -> bool:
        """Return whether a vehicle is judged."""
        return len(self._admitted) < MOST or vehicle in self._admitted
