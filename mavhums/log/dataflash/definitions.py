"""The message definitions in the FMT records of a log."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mavhums.core.arrays import Bytes
from mavhums.log.base.records import DefinitionTable
from mavhums.log.dataflash.layout import BODY, FMT, FMT_SIZE

__all__ = ["FMT_BODY", "Definition", "Definitions", "definition_of"]

_TYPES = {
    "a": "(32,)<i2", "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "d": "<f8", "g": "<f2", "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4",
    "E": "<u4", "L": "<i4", "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
_DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}

FMT_BODY = bytes([FMT, FMT_SIZE]) + b"FMT\0" + b"BBnNZ".ljust(16, b"\0")
FMT_BODY += b"Type,Length,Name,Format,Columns".ljust(64, b"\0")
"""The definition that every log has from its beginning: that of definitions."""


@dataclass(frozen=True, slots=True)
class Definition:
    """Definition of the records of one type.

    Attributes
    ----------
    name
        Name of the message.
    wire
        Layout of the payload.
    divisors
        Divisor of a field's raw number, for the type letters that define one.
    """

    name: str
    wire: np.dtype[np.void]
    divisors: dict[str, float]


@lru_cache(maxsize=4096)
def definition_of(raw: bytes) -> Definition | None:
    """Return the definition in the payload of a FMT record; None if its fields lack distinct names.

    Logs of one firmware have the same two hundred definitions, and a stream of logs repeats them.

    Examples
    --------
    >>> definition_of(FMT_BODY).wire["Columns"].str
    '|S64'
    """
    name, letters, columns = (
        part.split(b"\0")[0].decode("ascii") for part in (raw[2:6], raw[6:22], raw[22:BODY])
    )
    fields = columns.split(",")
    if len(fields) != len(letters) or len(set(fields)) != len(fields) or "" in fields:
        return None
    wire = np.dtype([(field, _TYPES[letter]) for field, letter in zip(fields, letters, strict=True)])
    divisors = {
        f: _DIVISORS[letter] for f, letter in zip(fields, letters, strict=True) if letter in _DIVISORS
    }
    return Definition(name, wire, divisors)


class Definitions(DefinitionTable):
    """The definitions of a log, in the order of their FMT records.

    A definition without names for its fields, or whose name already has another layout, cannot be used.

    Attributes
    ----------
    numbers
        Number of the type that each one defines.
    """

    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[int] = []
        self._by_name: dict[str, Definition] = {}

    def learn(self, bodies: Bytes) -> None:
        """Add the new definitions in ``bodies``, the payloads of the FMT records so far."""
        for body in bodies[len(self) :]:
            definition = definition_of(body.tobytes())
            self.numbers.append(int(body[0]))
            if definition is None or self._by_name.setdefault(definition.name, definition) != definition:
                self.add_unusable()
            else:
                self.add(definition.name, definition.wire, definition.divisors)
