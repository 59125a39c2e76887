"""What of a log is not judged: vehicles beyond a limit, and samples that clocks and grids left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from mavhums.engine.axes import Axes
from mavhums.log import Table
from mavhums.log.base.losses import Losses
from mavhums.vehicle.clocks import Clocks

__all__ = ["MOST", "VehicleLimit", "with_drops"]

MOST: Final = 32
"""Vehicles that are judged at most."""


class VehicleLimit:
    """Admits the first vehicles of a log, in the order of the log, whatever the block size.

    A sender can fake any number of vehicles, and each costs memory and time.

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


def with_drops(losses: Losses, clocks: Clocks, axes: Axes) -> Losses:
    """Return the losses of a log with the samples that clocks and grids left out."""
    late, same, copies, broken = (Counter[str]() for _ in range(4))
    for (_, message), count in clocks.copies.items():
        copies[message] += count
    for (_, message), count in clocks.broken.items():
        broken[message] += count
    for vehicle in axes.vehicles():
        for message, received in axes.received(vehicle).items():
            late[message] += received.late
            same[message] += received.repeated
    found = {
        "late_samples": late,
        "same_time_samples": same,
        "broken_stamps": broken,
        "copies": copies,
    }
    return losses.model_copy(
        update={name: {key: n for key, n in sorted(counts.items()) if n} for name, counts in found.items()}
    )
