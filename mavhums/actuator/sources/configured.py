"""Source for the fields that a profile maps to quantities: any message, any field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.field_check import MULTI_ID, wire_mistake
from mavhums.actuator.profile import Actuator, FieldMapping, ProfileError
from mavhums.actuator.readings import Reading, blank
from mavhums.core.quantities import column
from mavhums.log import Table
from mavhums.vehicle.clocks import each

__all__ = ["MESSAGES", "read"]

MESSAGES: frozenset[str] = frozenset()


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle, actuator and mapped message."""
    for actuator in actuators:
        for mappings in _by_message(actuator):
            message = next(iter(mappings.values())).message
            table = tables.get(message)
            if table is None:
                continue
            _hold_fields(table, actuator, mappings)
            yield from _mapped(table, actuator, mappings)


def _hold_fields(table: Table, actuator: Actuator, mappings: Mapping[str, FieldMapping]) -> None:
    """Refuse a mapping to what the log's own definition of the message does not have."""
    for key, mapping in mappings.items():
        mistake = wire_mistake(mapping.message, mapping.field, mapping.where, table.fields.dtype)
        if mistake is not None:
            problem = f"actuator {actuator.name}: fields.{key}.{mistake.key}: {mistake.problem} in this log"
            raise ProfileError(problem, mistake.remedy)


def _by_message(actuator: Actuator) -> list[dict[str, FieldMapping]]:
    """Return the mappings by quantity, grouped by message."""
    kinds: dict[tuple[str, str], dict[str, FieldMapping]] = {}
    for key, mapping in actuator.fields.items():
        kinds.setdefault((mapping.message, repr(mapping.where)), {})[key] = mapping
    return list(kinds.values())


def _column(table: Table, field: str) -> NDArray[Any]:
    """Return a field, or one element of an array field: ``rpm[2]``."""
    if field in (table.fields.dtype.names or ()):
        return table[field]
    if field == MULTI_ID:
        return table.component
    name, _, element = field.rpartition("[")
    values: NDArray[Any] = table[name]
    return values[:, int(element.rstrip("]"))]


def _mapped(table: Table, actuator: Actuator, mappings: Mapping[str, FieldMapping]) -> Iterator[Reading]:
    where = next(iter(mappings.values())).where
    chosen = np.ones(len(table), dtype=bool)
    for field, wanted in where.items():
        values = _column(table, field)
        chosen &= values == (wanted.encode() if isinstance(wanted, str) else wanted)
    which = ",".join(str(value) for value in where.values())
    columns = [column(key) for key in mappings]
    parts = [_column(table, m.field).astype(np.float64) * m.scale + m.offset for m in mappings.values()]
    for vehicle, rows in each(table.system, chosen):
        yield Reading(
            vehicle,
            actuator,
            f"{table.name}[{which}]" if which else table.name,
            "named",
            {key: mapping.field for key, mapping in mappings.items()},
            table.frame[rows],
            table.time_us[rows],
            blank(columns, np.stack([part[rows] for part in parts], axis=1)),
        )
