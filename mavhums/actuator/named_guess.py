"""Guess which named values are a servo's quantities, by the names that scripts give them."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator
from typing import Final, NamedTuple

from mavhums.log import Decoder, decode_blocks
from mavhums.vehicle.parameters import Parameters

__all__ = ["Guess", "guesses_for", "is_guessed", "named_values"]

_NAME: Final = re.compile(r"S(\d{1,2})(Cmd|Pos|V|A|Spd|RPM)")
_MOST_NAMES: Final = 1000


class Guess(NamedTuple):
    """A quantity that a named value seems to be: value · ``scale`` in the quantity's unit."""

    key: str
    name: str
    scale: float
    taken_for: str


_MEANINGS: Final[dict[str, tuple[str, float, str]]] = {
    "Cmd": ("V1", 1.0, "commanded angle, degrees"),
    "Pos": ("V3", 1.0, "angle, degrees"),
    "V": ("V4", 1.0, "voltage, V"),
    "A": ("V5", 1.0, "current, A"),
    "RPM": ("V7", 1.0, "rotor speed, rev/min"),
    "Spd": ("V10", 1.0 / 6.0, "output speed, degrees per second"),
}


def is_guessed(name: str) -> bool:
    """Return whether a named value seems to be a servo's quantity.

    Examples
    --------
    >>> is_guessed("S1Pos"), is_guessed("S1MT")
    (True, False)
    """
    return _NAME.fullmatch(name) is not None


def guesses_for(servo: int, names: Collection[str]) -> Iterator[Guess]:
    """Yield the quantities of a servo output among named values, in the order of V1–V12.

    Examples
    --------
    >>> [(guess.key, guess.name) for guess in guesses_for(1, ["S1Pos", "S1Cmd", "S11Pos", "S1MT"])]
    [('V1', 'S1Cmd'), ('V3', 'S1Pos')]
    """
    parts = {name: match for name in names if (match := _NAME.fullmatch(name))}
    own = {match[2]: name for name, match in parts.items() if int(match[1]) == servo}
    for suffix, (key, scale, taken_for) in _MEANINGS.items():
        if suffix in own:
            yield Guess(key, own[suffix], scale, taken_for)


def named_values(path: str | os.PathLike[str], parameters: Parameters) -> frozenset[str]:
    """Return the names of the NAMED_VALUE_FLOAT messages of the vehicle whose parameters these are.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a telemetry log.
    """
    names: set[str] = set()
    for tables, _, _ in decode_blocks(path, Decoder({"NAMED_VALUE_FLOAT"})):
        table = tables.get("NAMED_VALUE_FLOAT")
        if table is not None and len(names) < _MOST_NAMES:
            names.update(table.select(table.system == parameters.vehicle).texts("name"))
    return frozenset(names)
