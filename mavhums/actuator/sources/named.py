"""The named tier: NAMED_VALUE_FLOAT (251) ``S<servo>V01`` … ``S<servo>V12``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.core.quantities import KEYS
from mavhums.log import Table
from mavhums.vehicle.clocks import Clocks, Rows, each

__all__ = ["MESSAGES", "is_named", "read"]

MESSAGES = frozenset({"NAMED_VALUE_FLOAT"})
_NAME = re.compile(rb"S\d{1,2}V(0[1-9]|1[0-2])")


def is_named(table: Table) -> NDArray[np.bool_]:
    """Return which rows of a NAMED_VALUE_FLOAT table are actuator telemetry, shape (n,)."""
    names, row = np.unique(table["name"], return_inverse=True)
    return np.array([_NAME.fullmatch(bytes(name)) is not None for name in names], dtype=bool)[row]


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator], clocks: Clocks) -> Iterator[Reading]:
    """Yield a reading for each vehicle, servo and quantity."""
    table = tables.get("NAMED_VALUE_FLOAT")
    if table is None:
        return
    utc_us = clocks.utc_us(table, 1000, "time_boot_ms")
    places = _places(table)
    for actuator, (k, key) in product(actuators if places else (), enumerate(KEYS)):
        name = f"S{actuator.servo}V{k + 1:02d}"
        for vehicle, rows in places.get(name.encode(), ()):
            yield Reading(
                vehicle,
                actuator,
                f"NAMED_VALUE_FLOAT[{name}]",
                "named",
                {key: "value"},
                table.frame[rows],
                utc_us[rows],
                blank([k], table["value"][rows, None].astype(np.float64)),
            )


def _places(table: Table) -> dict[bytes, list[tuple[int, Rows]]]:
    """Return where the values of each name are, by vehicle."""
    names, which = np.unique(table["name"], return_inverse=True)
    return {
        bytes(name): list(each(table.system, which == k))
        for k, name in enumerate(names)
        if _NAME.fullmatch(bytes(name))
    }
