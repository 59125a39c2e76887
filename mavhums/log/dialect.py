"""MAVLink message definitions as numpy record types, from pymavlink's generated dialect."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

__all__ = ["Definition", "definitions"]

_STRUCT_TO_NUMPY = {
    "b": "i1",
    "B": "u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "q": "<i8",
    "Q": "<u8",
    "f": "<f4",
    "d": "<f8",
}


@dataclass(frozen=True, slots=True)
class Definition:
    """One message of the dialect.

    Attributes
    ----------
    wire
        Record type of the full payload, fields in wire order; its size is the largest payload.
    crc_extra
        Seed by which sender and receiver agree on the definition.
    """

    id: int
    name: str
    crc_extra: int
    wire: np.dtype[np.void]


@cache
def definitions() -> dict[int, Definition]:
    """Return the definitions of the ardupilotmega dialect and all that it includes, by message id."""
    from pymavlink.dialects.v20 import ardupilotmega

    return {number: _definition(number, message) for number, message in ardupilotmega.mavlink_map.items()}


def _definition(number: int, message: Any) -> Definition:
    codes = re.findall(r"(\d*)([a-zA-Z])", message.unpacker.format)
    fields: list[tuple[Any, ...]] = []
    for name, (count, code) in zip(message.ordered_fieldnames, codes, strict=True):
        if code == "s":
            fields.append((name, f"S{count or 1}"))
        elif count:
            fields.append((name, _STRUCT_TO_NUMPY[code], (int(count),)))
        else:
            fields.append((name, _STRUCT_TO_NUMPY[code]))
    return Definition(number, message.msgname, message.crc_extra, np.dtype(fields))
