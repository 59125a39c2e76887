"""The named tier: floats named ``S<servo>V01`` … ``S<servo>V12``.

NAMED_VALUE_FLOAT (251); NVF, in which ArduPilot's on-board log keeps those that it sent; PX4's topic
debug_key_value.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.actuator.tier import Tier
from mavhums.core.quantities import KEYS
from mavhums.log import Table
from mavhums.vehicle.clocks import Rows, each

__all__ = ["MESSAGES", "TIER", "is_marked", "read"]

_FIELDS = {
    "NAMED_VALUE_FLOAT": ("name", "value"),
    "NVF": ("Name", "Value"),
    "debug_key_value": ("key", "value"),
}
MESSAGES = frozenset(_FIELDS)
TIER = Tier("named", "the quantities that are named")
_NAME = re.compile(rb"S\d{1,2}V(0[1-9]|1[0-2])")


def is_marked(table: Table) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which rows of a table are actuator telemetry, shape (n,)."""
    field, _ = _FIELDS[table.name]
    if not table.holds_text(field):
        return np.zeros(len(table), dtype=bool)
    names, row = np.unique(table[field], return_inverse=True)
    return np.array([_NAME.fullmatch(bytes(name)) is not None for name in names], dtype=bool)[row]


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle, servo and quantity."""
    for message, (name_field, value_field) in _FIELDS.items():
        table = tables.get(message)
        if table is None or not (table.holds_text(name_field) and table.holds({value_field: 1})):
            continue
        places = _places(table, name_field)
        for actuator, (k, key) in product(actuators if places else (), enumerate(KEYS)):
            name = f"S{actuator.servo}V{k + 1:02d}"
            for vehicle, rows in places.get(name.encode(), ()):
                yield Reading(
                    vehicle,
                    actuator,
                    f"{message}[{name}]",
                    "named",
                    {key: value_field},
                    table.frame[rows],
                    table.time_us[rows],
                    blank([k], table[value_field][rows, None].astype(np.float64)),
                )


def _places(table: Table, field: str) -> dict[bytes, list[tuple[int, Rows]]]:
    """Return where the values of each name are, by vehicle."""
    names, which = np.unique(table[field], return_inverse=True)
    return {
        bytes(name): list(each(table.system, which == k))
        for k, name in enumerate(names)
        if _NAME.fullmatch(bytes(name))
    }
