"""Converts the records of a batch to tables."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.log.dataflash._gather import SPARE, count, gather
from mavhums.log.dataflash.definitions import Definition, definition_of
from mavhums.log.dataflash.scanner import Batch
from mavhums.log.tables import Table

__all__ = ["Found", "Lexicon", "Placed"]


class Found(NamedTuple):
    """Tables by name, and the number of rows of each definition, shape (definitions,)."""

    tables: dict[str, Table]
    counts: NDArray[np.int64]


class Placed(NamedTuple):
    """Context of rows: the vehicle, the number of known records before them, and the time offsets.

    ``first_us`` is the time of records before the first time; ``shift_us`` is added to every time.
    """

    vehicle: int = 0
    ordinal: int = 0
    first_us: int = 0
    shift_us: int = 0


_AT_BOOT = Placed()


class Lexicon:
    """The definitions of a log, in the order of their FMT records.

    A definition without names for its fields, or whose name already has another layout, is
    None: its records are unknown.
    """

    def __init__(self) -> None:
        self.definitions: list[Definition | None] = []
        self.numbers: list[int] = []
        self.known = np.empty(0, dtype=np.bool_)
        self._by_name: dict[str, Definition] = {}
        self._sizes: dict[frozenset[str] | None, NDArray[np.int64]] = {}

    def learn(self, bodies: NDArray[np.uint8]) -> None:
        """Add the new definitions in ``bodies``."""
        for body in bodies[len(self.definitions) :]:
            definition = definition_of(body.tobytes())
            if definition is not None:
                first = self._by_name.setdefault(definition.name, definition)
                if first.wire != definition.wire or first.divisors != definition.divisors:
                    definition = None
            self.definitions.append(definition)
            self.numbers.append(int(body[0]))
            self._sizes.clear()
        if len(self.known) < len(self.definitions):
            self.known = np.array([definition is not None for definition in self.definitions])

    def tables(
        self, batch: Batch, rows: NDArray[np.void], messages: frozenset[str] | None, placed: Placed = _AT_BOOT
    ) -> Found:
        """Return the wanted messages among rows of a batch."""
        sizes = self._wanted(messages)
        counts = count(rows, sizes.size)
        taken = np.where(sizes > 0, counts, 0)
        row_of = np.cumsum(taken) - taken
        room = taken * sizes + SPARE
        byte_of = np.cumsum(room) - room
        total = int(taken.sum())
        frame, time_us = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
        flags, payloads = np.empty(total, dtype=np.uint8), np.empty(int(room.sum()), dtype=np.uint8)
        starts = byte_of.copy(), row_of.copy()
        gather(
            batch.data, batch.base, rows, placed.ordinal, placed.first_us, placed.shift_us, sizes, self.known,
            row_of, byte_of, frame, time_us, flags, payloads,
        )  # fmt: skip
        system, (component, sequence) = (
            np.full(total, placed.vehicle, np.uint8),
            np.zeros((2, total), np.uint8),
        )
        tables: dict[str, Table] = {}
        for k in np.flatnonzero(taken).tolist():
            definition = self.definitions[k]
            assert definition is not None
            begin, end = starts[1][k], row_of[k]
            table = Table(
                definition.name, frame[begin:end], time_us[begin:end],
                system[begin:end], component[begin:end], sequence[begin:end], flags[begin:end],
                payloads[starts[0][k] : byte_of[k]].view(definition.wire), definition.divisors,
            )  # fmt: skip
            before = tables.get(definition.name)
            tables[definition.name] = table if before is None else _merged(before, table)
        return Found(tables, counts)

    def _wanted(self, messages: frozenset[str] | None) -> NDArray[np.int64]:
        """Return the bytes of a payload by definition, 0 where it is not wanted."""
        if messages not in self._sizes:
            self._sizes[messages] = np.array(
                [
                    d.wire.itemsize if d is not None and (messages is None or d.name in messages) else 0
                    for d in self.definitions
                ],
                dtype=np.int64,
            )
        return self._sizes[messages]


def _merged(first: Table, second: Table) -> Table:
    """Join the messages of two types of one name and layout."""
    both = Table.concatenate([first, second])
    return both.select(np.argsort(both.frame, kind="stable"))
