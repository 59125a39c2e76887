"""Which outputs the instances of PX4's ``actuator_outputs`` are, and in what units they count.

An instance gets its number from the order in which drivers start, so it may be that of any driver. What is
assigned to each driver (``PWM_MAIN_FUNCn``, ``UAVCAN_EC_FUNCn``, …) and the first outputs that are not 0
show which one it is. Outputs in other units are converted to the pulses that servos of these would take.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Bytes
from mavhums.log import Table
from mavhums.log.base.decoder import text_of

_TOPIC: Final = "actuator_outputs"
_OUTPUTS: Final = 16
NOWHERE: Final = 250
"""The number of an instance whose place belongs to another one."""
_MAIN, _AUX, _CAN = 0, 1, 2
_LEAST_US, _MOST_US = 800.0, 2200.0
_DSHOT: Final = 1999.0  # of full thrust; 0 is off
_MOTORS: Final = range(101, 113)  # functions
_ESCS_ON_CAN: Final = 3  # UAVCAN_ENABLE of before the functions, from which on it drives motors


class Bus(NamedTuple):
    """A driver of outputs: its parameters' prefix, its places, and what its full output counts; 0 for µs."""

    prefix: str
    place: int
    full: float


BUSES: Final = (
    Bus("PWM_MAIN", _MAIN, 0.0),
    Bus("PWM_AUX", _AUX, 0.0),
    Bus("HIL_ACT", _MAIN, 0.0),
    Bus("UAVCAN_EC", _MAIN, 8191.0),
    Bus("SIM_GZ_EC", _MAIN, 1000.0),
    Bus("SIM_GZ_SV", _AUX, 1000.0),
    Bus("UAVCAN_SV", _CAN, 0.0),  # stays a count from 0 to 1000
)
"""PX4's drivers. ESCs on CAN have the places of MAIN, or of AUX where MAIN has functions."""


def buses_of(values: Mapping[str, float]) -> dict[Bus, dict[int, int]]:
    """Return the drivers that have functions, each with its functions by output, from 1.

    Examples
    --------
    >>> [(bus.prefix, bus.place) for bus in buses_of({"PWM_MAIN_FUNC1": 201.0, "UAVCAN_EC_FUNC1": 101.0})]
    [('PWM_MAIN', 0), ('UAVCAN_EC', 1)]
    """
    found: dict[Bus, dict[int, int]] = {}
    for bus in BUSES:
        names = ((n, f"{bus.prefix}_FUNC{n}") for n in range(1, _OUTPUTS + 1))
        functions = {n: int(values[name]) for n, name in names if values.get(name, 0.0) > 0.0}
        if functions:
            taken = {other.place for other in found}
            found[bus._replace(place=_AUX) if bus.full and bus.place in taken else bus] = functions
    return found


def uses_dshot(values: Mapping[str, float], prefix: str) -> bool:
    """Return whether the motors of a driver of pulses get DShot instead."""
    timers = (values.get(f"{prefix}_TIM{k}", 0.0) for k in range(_OUTPUTS))
    return values.get("DSHOT_CONFIG", 0.0) > 0.0 or min(timers) < 0.0


class _Instance(NamedTuple):
    """What an instance is: its place, from which row, and what full output of each channel counts."""

    place: int
    since: int
    full: Array


class PX4Buses:
    """Puts the instances of outputs into the places of their drivers, block by block."""

    def __init__(self) -> None:
        self._values: dict[int, dict[str, float]] = {}
        self._known: dict[int, dict[int, _Instance]] = {}

    @np.errstate(invalid="ignore")  # a damaged number may be a NaN that signals
    def feed(self, tables: Mapping[str, Table]) -> dict[str, Table]:
        """Return the tables, of the outputs with the places as components and pulses as values."""
        named = tables.get("parameter")
        if named is not None and named.holds_text("name") and named.holds({"value": 1}):
            rows = zip(named.system.tolist(), named["name"].tolist(), named["value"].tolist(), strict=True)
            for system, name, value in rows:
                self._values.setdefault(system, {}).setdefault(text_of(name), float(value))
        table = tables.get(_TOPIC)
        if table is None or not table.holds({"output": _OUTPUTS}) or not len(table):
            return dict(tables)
        if table["output"].dtype.kind != "f":  # as a damaged definition says: it cannot hold what is unknown
            return dict(tables)
        place, output = table.component.copy(), table["output"].astype(np.float64)
        for system in np.unique(table.system).tolist():
            self._place(table, system, place, output)
        fields = table.fields.copy()
        fields["output"] = output
        return {**tables, _TOPIC: replace(table, component=place, fields=fields)}

    def _place(self, table: Table, system: int, place: Bytes, output: Array) -> None:
        """Write the places and the pulses of one system's rows."""
        known = self._known.setdefault(system, {})
        own = table.system == system
        sent = own & (np.nan_to_num(output) != 0.0).any(axis=1)
        instances = np.unique(table.component[own]).tolist()
        begun = [
            int(np.flatnonzero(sent & (table.component == one))[0])
            for one in instances
            if one not in known and (sent & (table.component == one)).any()
        ]
        for row in sorted(begun, key=lambda row: int(table.frame[row])):
            frame, one = int(table.frame[row]), int(table.component[row])
            known[one] = self._instance(system, one, output[row], frame)
        for one in instances:
            rows = own & (table.component == one)
            mine = known.get(one)
            since = 1 << 62 if mine is None else mine.since
            others = [other.since for k, other in known.items() if k != one and other.place == one]
            idle = rows & (table.frame < since)
            place[idle & (table.frame >= min(others, default=1 << 62))] = NOWHERE
            if mine is not None:
                place[rows & (table.frame >= since)] = mine.place
                share = 1000.0 + 1000.0 * output[rows] / np.where(mine.full > 0.0, mine.full, 1.0)
                share = np.where(output[rows] != 0.0, share, 0.0)
                output[rows] = np.where(mine.full > 0.0, share, output[rows])

    def _instance(self, system: int, one: int, first: Array, frame: int) -> _Instance:
        """Return what an instance is, by its first outputs that are not 0."""
        values = self._values.get(system, {})
        shown = {k + 1 for k in np.flatnonzero(np.nan_to_num(first) != 0.0).tolist()}
        taken = {other.place for other in self._known[system].values()}
        pulses = all(_LEAST_US <= first[n - 1] <= _MOST_US for n in shown)
        functions = buses_of(values)
        free = [bus for bus in functions if bus.place not in taken and shown <= functions[bus].keys()]
        if free:
            # Most of its outputs are not 0 from the first on; pulses are no counts, unless they are DShot's.
            bus = min(
                free,
                key=lambda bus: (
                    bool(bus.full or bus.place == _CAN) == pulses and not uses_dshot(values, bus.prefix),
                    len(functions[bus].keys() - shown),
                ),
            )
            full = np.full(_OUTPUTS, bus.full)
            if not bus.full and uses_dshot(values, bus.prefix):
                full[[n - 1 for n, function in functions[bus].items() if function in _MOTORS]] = _DSHOT
            return _Instance(bus.place, frame, full)
        if functions:
            return _Instance(NOWHERE if one in taken else one, frame, np.zeros(_OUTPUTS))
        # Before the functions the mixer's motors are on CAN, if it drives ESCs, else on MAIN.
        on_can = values.get("UAVCAN_ENABLE", 0.0) >= _ESCS_ON_CAN
        if on_can and not pulses:
            return _Instance(_MAIN, frame, np.full(_OUTPUTS, 8191.0))
        full = np.full(_OUTPUTS, _DSHOT if uses_dshot(values, "PWM_MAIN") and not pulses else 0.0)
        places = [one, *((_AUX,) if on_can else (_MAIN, _AUX))]
        free_places = [place for place in places if place not in taken and not (on_can and place == _MAIN)]
        return _Instance(min(free_places, default=NOWHERE) if on_can else one, frame, full)
