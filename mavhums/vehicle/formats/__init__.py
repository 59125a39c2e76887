"""Where each log format keeps the facts of :mod:`mavhums.vehicle.facts`: one module a format.

A module has ``SOURCES``, ``SERVO_SOURCES`` and ``REMEDIES``, the interface :class:`~.base.FormatModule`.
Nothing else outside :mod:`mavhums.log` names a message.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from typing import Final, cast

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.log import Table
from mavhums.vehicle.facts import ServoIds, ServoReading
from mavhums.vehicle.formats import dataflash, mavlink, ulog
from mavhums.vehicle.formats.base import (
    ANY,
    RATES,
    FactReport,
    FormatModule,
    ServoSource,
    Source,
    bounded,
    each,
    holds,
)

FORMATS: Final = tuple(cast(FormatModule, module) for module in (mavlink, dataflash, ulog))
"""The formats; a log whose messages are of none is treated as the first one."""

SERVO_SOURCES: Final[tuple[ServoSource, ...]] = tuple(
    source for form in FORMATS for source in form.SERVO_SOURCES
)

_ESCS: Final = tuple(ServoIds(esc + 1, esc) for esc in range(16))

_COMMON: Final[Mapping[str, str]] = {
    "servo telemetry": (
        "record each servo's ESC telemetry (voltage, current, speed) beside its command, its CSRV "
        "(ArduPilot 4.7, DroneCAN), or V1–V12 as DEBUG_FLOAT_ARRAY named EMA"
    ),
    "motor quantities": "send V1–V12 as DEBUG_FLOAT_ARRAY named EMA",
    "signed currents": "send signed values (ESC_STATUS)",
}
"""How facts of servos are recorded: a text that names a format names all that have them."""


@cache
def _sources(facts: tuple[str, ...]) -> tuple[tuple[FormatModule, Source], ...]:
    """Return the sources of facts, in the order of the formats' tables."""
    return tuple((form, source) for form in FORMATS for source in form.SOURCES if source.fact in facts)


def messages_of(*facts: str) -> frozenset[str]:
    """Return the messages that carry any of these facts.

    Examples
    --------
    >>> sorted(messages_of("text"))
    ['MSG', 'STATUSTEXT', 'logged_string']
    """
    return frozenset(source.message for _, source in _sources(facts))


def message_of(fact: str, form: str) -> str:
    """Return the first message of a format, by its name, that carries a fact.

    Examples
    --------
    >>> message_of("outputs", "dataflash")
    'RCOU'
    """
    return next(source.message for known, source in _sources((fact,)) if form == known.NAME)


def reports(tables: Mapping[str, Table], *facts: str) -> Iterator[FactReport]:
    """Yield the rows of these tables that carry any of these facts."""
    for form, source in _sources(facts):
        table = tables.get(source.message)
        if table is None or not holds(table, source.fields):
            continue
        if source.rows is not None:
            with np.errstate(all="ignore"):
                table = table.select(source.rows(table))
        report = FactReport(source, form, table).within_range()
        if len(report.table):
            yield report


def by_vehicle(tables: Mapping[str, Table], *facts: str) -> Iterator[tuple[int, FactReport]]:
    """Yield each vehicle's rows of these tables that carry any of these facts."""
    for report in reports(tables, *facts):
        for vehicle, rows in each(report.table.system):
            yield vehicle, report if isinstance(rows, slice) else report.select(rows)


def servo_readings(
    source: ServoSource, tables: Mapping[str, Table], servos: Sequence[ServoIds]
) -> Iterator[ServoReading]:
    """Yield the readings of servos in the tables' messages of one source, vehicle by vehicle."""
    table = tables.get(source.message)
    if table is None:
        return
    with np.errstate(all="ignore"):  # of damaged numbers, which a gate bounds
        parts = [*source.split(table, servos)]
    for ids, part in parts:
        for vehicle, rows in each(table.system, part.rows):
            times = table.frame[rows], table.time_us[rows]
            name, fields = part.source, part.fields
            yield ServoReading(vehicle, ids.servo, name, fields, *times, part.values[rows], source.signed)


def esc_speeds(tables: Mapping[str, Table]) -> Iterator[tuple[int, int, Integers, Array]]:
    """Yield what ESCs report of their motors' speed: vehicle, ESC from 0, µs of UTC (n,), rev/min (n,)."""
    for source in SERVO_SOURCES:
        if source.tier.startswith("esc"):
            for reading in servo_readings(source, tables, _ESCS):
                speeds = reading.values[:, [*reading.fields].index("V7")]
                yield reading.vehicle, reading.servo - 1, reading.time_us, bounded("ESC speed", speeds)


def remedy(
    fact: str,
    messages: Collection[str] = (),
    autopilots: Collection[int] = (),
    parameters: Collection[str] = (),
) -> str:
    """Return how a log records a missing fact.

    Parameters
    ----------
    fact
        A key of ``REMEDIES``.
    messages
        Messages of the log, which show its format.
    autopilots
        MAV_AUTOPILOTs of the vehicle; where they are known, the remedy is theirs.
    parameters
        Names of the vehicle's parameters: ArduPilot calls its rates SRn_RAW_SENS, from 4.7 on MAVn_RAW_SENS.

    Examples
    --------
    >>> remedy("force", {"IMU"})
    'record IMU at 10 Hz or more (LOG_BITMASK bit 7)'
    >>> remedy("force", parameters={"MAV1_RAW_SENS"}).partition("more ")[2]
    '(MAVx_RAW_SENS)'
    """
    if fact in _COMMON:
        return _COMMON[fact]
    known = (form for form in FORMATS if any(source.message in messages for source in form.SOURCES))
    texts = next(known, FORMATS[0]).REMEDIES[fact]
    text = next((texts[autopilot] for autopilot in autopilots if autopilot in texts), texts[ANY])
    renamed = any(name.startswith("MAV") and name.endswith("_RAW_SENS") for name in parameters)
    return text.replace(RATES, "MAVx_") if renamed else text
