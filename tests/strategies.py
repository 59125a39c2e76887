"""Hypothesis strategies for MAVLink messages, frames and telemetry logs."""

from __future__ import annotations

import itertools
import struct
from typing import Any, NamedTuple

from hypothesis import strategies as st
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as v2

START_US = 1_700_000_000_000_000

_INTEGERS = {
    "int8_t": (-(2**7), 2**7 - 1),
    "uint8_t": (0, 2**8 - 1),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint16_t": (0, 2**16 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
    "uint64_t": (0, 2**64 - 1),
}


class Record(NamedTuple):
    """One record of a log: the message it was made from, and its bytes."""

    message: Any
    time_us: int
    system: int
    data: bytes


def _scalar(kind: str) -> st.SearchStrategy[Any]:
    if kind in _INTEGERS:
        return st.integers(*_INTEGERS[kind])
    return st.floats(width=32 if kind == "float" else 64, allow_nan=False)


@st.composite
def messages(draw: st.DrawFn, *, version: int = 2) -> Any:
    """A message of any type of the dialect, with any field values."""
    dialect = v2 if version == 2 else v1
    numbers = sorted(number for number in dialect.mavlink_map if number < 256 or version == 2)
    return draw(contents(dialect.mavlink_map[draw(st.sampled_from(numbers))]))


@st.composite
def contents(draw: st.DrawFn, kind: Any) -> Any:
    """A message of one of pymavlink's classes, with any field values."""
    values: list[Any] = []
    for name, field, length in zip(kind.fieldnames, kind.fieldtypes, _lengths(kind), strict=True):
        if field == "char":
            size = kind.array_lengths[kind.ordered_fieldnames.index(name)]
            values.append(draw(st.binary(max_size=max(size, 1))))
        elif length > 1:
            values.append(draw(st.lists(_scalar(field), min_size=length, max_size=length)))
        else:
            values.append(draw(_scalar(field)))
    return kind(*values)


def _lengths(kind: Any) -> list[int]:
    by_name = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return [by_name[name] for name in kind.fieldnames]


@st.composite
def records(draw: st.DrawFn, *, min_size: int = 1, max_size: int = 12) -> list[Record]:
    """The records of a log: MAVLink 1 and 2, signed or not, of several senders, in order of time."""
    out = []
    time_us = START_US
    for _ in range(draw(st.integers(min_size, max_size))):
        version = draw(st.sampled_from([1, 2, 2]))
        system = draw(st.integers(1, 255))
        link = (v2 if version == 2 else v1).MAVLink(None, srcSystem=system, srcComponent=1)
        link.seq = draw(st.integers(0, 255))
        if version == 2 and draw(st.booleans()):
            link.signing.secret_key = bytes(range(32))
            link.signing.sign_outgoing = True
            link.signing.timestamp = 1000
        message = draw(messages(version=version))
        time_us += draw(st.integers(0, 5_000_000))
        out.append(Record(message, time_us, system, struct.pack(">Q", time_us) + bytes(message.pack(link))))
    return out


def cuts(size: int) -> st.SearchStrategy[list[int]]:
    """Places at which to cut ``size`` bytes into blocks."""
    return st.lists(st.integers(0, size), max_size=20).map(sorted)


def blocks(data: bytes, places: list[int]) -> list[bytes]:
    """Cut ``data`` at ``places``."""
    bounds = [0, *places, len(data)]
    return [data[a:b] for a, b in itertools.pairwise(bounds)]
