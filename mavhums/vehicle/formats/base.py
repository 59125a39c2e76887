"""The rows of the tables that say where a log format keeps each fact."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS
from mavhums.log import Table
from mavhums.log.base.decoder import text_of
from mavhums.vehicle.facts import ALL_OUTPUTS, RANGES, ServoIds

TEXT: Final = 0
"""The width of a field of text, in ``Source.fields``."""

ANY: Final = -1
"""Any autopilot, in ``REMEDIES``."""
RATES: Final = "SRx_"
"""How ArduPilot's parameters of stream rates begin; from 4.7 on with ``MAVx_``."""

_EMA: Final = b"EMA"
_EMA_FIELDS: Final = {key: f"data[{k}]" for k, key in enumerate(KEYS)}
_EMA_ELEMENTS: Final = 58
_NAME: Final = re.compile(rb"S\d{1,2}V(0[1-9]|1[0-2])")

_PULSES_US: Final = (800.0, 2200.0)
"""Pulses that servos take. Outputs that are off carry 0 or 65 535, which are no travel."""

Rows = NDArray[Any] | slice
"""What picks rows: a mask, or places; all of them are a slice, for which nothing is copied."""


class Source(NamedTuple):
    """Where a format keeps one fact.

    Attributes
    ----------
    fact
        Its name in :mod:`mavhums.vehicle.facts`.
    message
        The message, record or topic.
    fields
        The fields that must be there, with their numbers of elements; :data:`TEXT` for text.
    values
        Returns the fact's values, in SI units, row for row.
    rows
        Returns which rows carry the fact, shape (n,); None if all do.
    all_components
        Whether every component of a vehicle that sends it counts, not only the first one.
    first
        Of a fact with a column for each ESC, servo or motor: the number of the first column, from 0, or what
        returns it row for row.
    """

    fact: str
    message: str
    fields: Mapping[str, int]
    values: Callable[[Table], NDArray[Any]]
    rows: Callable[[Table], Flags] | None = None
    all_components: bool = False
    first: int | Callable[[Table], Integers] = 0


class ServoPart(NamedTuple):
    """The rows of a message that are of one servo, with their values; as in ``ServoReading``."""

    source: str
    fields: Mapping[str, str]
    rows: Flags | None
    values: Array


class ServoSource(NamedTuple):
    """Where a format keeps telemetry of servos.

    Attributes
    ----------
    tier
        The telemetry tier.
    message
        The message, record or topic.
    split
        Returns the parts of the rows that are of a servo, given its ids and those of all servos.
    marked
        Returns which rows are telemetry of servos, shape (n,); None if all rows are.
    signed
        Whether the values are signed; otherwise they are magnitudes.
    """

    tier: str
    message: str
    split: Callable[[Table, Sequence[ServoIds]], Iterator[tuple[ServoIds, ServoPart]]]
    marked: Callable[[Table], Flags] | None = None
    signed: bool = True


Split = Iterator[tuple[ServoIds, ServoPart]]


class FormatModule(Protocol):
    """The interface of a format's module.

    Attributes
    ----------
    NAME
        Name of the format, as its decoder gives it.
    AUTOPILOT
        The MAV_AUTOPILOT that writes such logs; None if any may.
    SOURCES, SERVO_SOURCES
        Where it keeps facts, and telemetry of servos. The source of a continuous signal with the shortest
        spacing counts, or the first in the table of equal ones.
    REMEDIES
        How a fact that is missing is recorded, by autopilot: the messages, and the parameter that sets them.
        ``motion`` means outputs, rates and attitude together, which every axis needs.
    """

    NAME: str
    AUTOPILOT: int | None
    SOURCES: tuple[Source, ...]
    SERVO_SOURCES: tuple[ServoSource, ...]
    REMEDIES: Mapping[str, Mapping[int, str]]

    def is_stamped(self, table: Table) -> bool:
        """Return whether messages of this type carry the time of their sender's clock."""
        ...

    def mode_name(self, autopilot: int, kind: int, base_mode: int, number: int) -> str | None:
        """Return the name of a flight mode, as the ground station names it; None if ``kind`` must be known.

        The arguments are those of the fact ``mode``.
        """
        ...


class FactReport(NamedTuple):
    """The rows of one table that carry a fact."""

    source: Source
    format: FormatModule
    table: Table

    @property
    def values(self) -> NDArray[Any]:
        """The fact's values, row for row: NaN for a number outside its range."""
        # A damaged number may overflow what is computed from it; what comes of that is out of range.
        with np.errstate(all="ignore"):
            values = self.source.values(self.table)
        return bounded(self.source.fact, values) if values.dtype.kind == "f" else values

    def within_range(self) -> FactReport:
        """Return the rows whose whole numbers, which cannot be NaN, are in the fact's range."""
        values = self.values
        if values.dtype.kind not in "iu" or self.source.fact not in RANGES:
            return self
        least, greatest = RANGES[self.source.fact]
        good: Any = (values >= least) & (values <= greatest)
        within: Flags = np.all(np.atleast_2d(good.T), axis=0)
        return self.select(within)

    @property
    def first(self) -> Integers:
        """The number of the first column, row for row."""
        first = self.source.first
        with np.errstate(all="ignore"):
            return np.full(len(self.table), first) if isinstance(first, int) else first(self.table)

    @property
    def rank(self) -> int:
        """Place of the source among those of the same fact in its format, the preferred one first."""
        return [one for one in self.format.SOURCES if one.fact == self.source.fact].index(self.source)

    @property
    def texts(self) -> list[str]:
        """The values as texts."""
        return [text_of(value) for value in self.values.tolist()]

    def select(self, rows: NDArray[Any]) -> FactReport:
        """Return the rows that a mask or an index array selects."""
        return self._replace(table=self.table.select(rows))


def bounded(fact: str, values: Array) -> Array:
    """Return values of a fact with NaN for those outside its range."""
    least, greatest = RANGES.get(fact, (-np.inf, np.inf))
    good = (values >= least) & (values <= greatest)
    return values if good.all() else np.where(good, values, np.nan)


def holds(table: Table, fields: Mapping[str, int]) -> bool:
    """Return whether a table has these fields; a self-describing log may define any."""
    texts = [name for name, width in fields.items() if width == TEXT]
    numbers = {name: width for name, width in fields.items() if width != TEXT}
    return table.holds(numbers) and all(map(table.holds_text, texts))


def columns(table: Table, *fields: str, scale: float = 1.0) -> Array:
    """Return scalar fields as columns, shape (n, fields)."""
    return np.stack([table[field].astype(np.float64) for field in fields], axis=1) * scale


def plain(
    fact: str,
    message: str,
    *fields: str,
    scale: float = 1.0,
    rows: Callable[[Table], Flags] | None = None,
) -> Source:
    """Return the source of a fact whose columns are scalar fields times ``scale``."""
    widths = dict.fromkeys(fields, 1)
    return Source(fact, message, widths, lambda table: columns(table, *fields, scale=scale), rows)


def bits_of(*flags: NDArray[Any]) -> Integers:
    """Return flags, each (n,), as bits of one column, the first one the lowest; shape (n, 1).

    Examples
    --------
    >>> bits_of(np.array([False, True]), np.array([True, True])).tolist()
    [[2], [3]]
    """
    return np.asarray(sum((flag != 0).astype(np.int64) << k for k, flag in enumerate(flags)))[:, None]


def whole(field: str, *, column: bool = False) -> Callable[[Table], Integers]:
    """Return what reads a field as whole numbers: (n,), or one ``column``, (n, 1).

    A self-describing log may define it as any numbers.
    """
    return lambda table: table[field].astype(np.int64)[:, None] if column else table[field].astype(np.int64)


def supply_faults(flags: Integers) -> Integers:
    """Return the bits of the fact ``supply faults`` of MAV_POWER_STATUS flags, (n,); shape (n, 1)."""
    return bits_of(flags & 1 == 0, flags & 2 == 0, flags & 8, flags & 16)


def pulses(values: Array) -> Array:
    """Return the pulses of outputs, µs, NaN where an output is off."""
    return np.where((values < _PULSES_US[0]) | (values > _PULSES_US[1]), np.nan, values)


def wide(values: Array, first: int) -> Array:
    """Return pulses as columns from ``first`` of an array of all outputs, which is NaN elsewhere.

    Examples
    --------
    >>> wide(np.array([[1500.0]]), 16)[0, 15:18]
    array([  nan, 1500.,   nan])
    """
    out = np.full((len(values), ALL_OUTPUTS), np.nan)
    out[:, first : first + values.shape[1]] = values
    return out


def angles_of(q: NDArray[Any]) -> Array:
    """Return roll, pitch and yaw, rad, (n, 3), of quaternions w, x, y, z, body to north-east-down, (n, 4)."""
    w, x, y, z = q.astype(np.float64).T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.stack([roll, pitch, yaw], axis=1)


def modes(number: NDArray[Any], autopilot: int) -> Integers:
    """Return the values of the fact ``mode`` from numbers of modes, (n,), without the kind of vehicle."""
    number = number.astype(np.int64)
    rest = np.full_like(number, autopilot), np.full_like(number, -1), np.zeros_like(number)
    return np.stack([*rest, number], axis=1)


def records_of_parameters(names: NDArray[Any], bits: NDArray[Any], types: NDArray[Any] | int) -> NDArray[Any]:
    """Return the values of the fact ``parameter``."""
    out = np.empty(len(names), dtype=[("name", names.dtype), ("bits", "<u4"), ("type", "u1")])
    out["name"], out["bits"], out["type"] = names, bits, types
    return out


def each(keys: NDArray[Any], among: Flags | None = None) -> Iterator[tuple[int, Rows]]:
    """Yield each integer that occurs in ``keys`` (n,), with its rows, in increasing order.

    ``among`` (n,) selects the rows that count; None selects all.

    Examples
    --------
    >>> [(key, rows.tolist()) for key, rows in each(np.array([7, 3, 7]))]
    [(3, [1]), (7, [0, 2])]
    """
    if among is not None and not among.all():
        places: Integers = np.flatnonzero(among)
        yield from ((key, places[rows]) for key, rows in each(keys[places]))
    elif len(keys) and (keys == keys[0]).all():
        yield int(keys[0]), slice(None)
    else:
        for key in np.unique(keys):
            yield int(key), np.flatnonzero(keys == key)


def instrumented(message: str, servo_field: str) -> ServoSource:
    """Return the source of V1–V12 in debug arrays named EMA."""
    parts = partial(_ema_parts, servo_field=servo_field)
    return ServoSource("instrumented", message, parts, partial(_is_ema, servo_field=servo_field))


def named(message: str, name_field: str, value_field: str) -> ServoSource:
    """Return the source of the quantities in named floats."""
    parts = partial(_named_parts, name_field=name_field, value_field=value_field)
    return ServoSource("named", message, parts, partial(_is_named, field=name_field))


def _is_ema(table: Table, servo_field: str) -> Flags:
    """Return which rows of a debug array are actuator telemetry, shape (n,)."""
    if not holds(table, {servo_field: 1, "data": _EMA_ELEMENTS, "name": TEXT}):
        return np.zeros(len(table), dtype=bool)
    return np.array(table["name"] == _EMA)


def _ema_parts(table: Table, servos: Sequence[ServoIds], servo_field: str) -> Split:
    """Yield V1–V12 from debug arrays named EMA: ``servo_field`` is the servo, NaN is not measured."""
    marked = _is_ema(table, servo_field)
    if not marked.any():
        return
    values = table["data"][:, : len(KEYS)].astype(np.float64)
    for ids in servos:
        rows = marked & (table[servo_field] == ids.servo)
        yield ids, ServoPart(f"{table.name}[EMA,{ids.servo}]", _EMA_FIELDS, rows, values)


def _is_named(table: Table, field: str) -> Flags:
    """Return which rows of named values are actuator telemetry, shape (n,)."""
    if not table.holds_text(field):
        return np.zeros(len(table), dtype=bool)
    names, row = np.unique(table[field], return_inverse=True)
    return np.array([_NAME.fullmatch(bytes(name)) is not None for name in names], dtype=bool)[row]


def _named_parts(table: Table, servos: Sequence[ServoIds], name_field: str, value_field: str) -> Split:
    """Yield the quantities in floats named ``S<servo>V01`` … ``S<servo>V12``."""
    if not holds(table, {name_field: TEXT, value_field: 1}):
        return
    found, which = np.unique(table[name_field], return_inverse=True)
    places = {bytes(name): k for k, name in enumerate(found)}
    values = table[value_field][:, None].astype(np.float64)
    for ids in servos:
        for k, key in enumerate(KEYS):
            name = f"S{ids.servo}V{k + 1:02d}"
            place = places.get(name.encode())
            if place is not None:
                yield ids, ServoPart(f"{table.name}[{name}]", {key: value_field}, which == place, values)
