"""Decode a log in one block or in many."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mavhums.log import Decoder, Table
from tests.strategies import blocks


def decode(data: bytes, places: Iterable[int] = ()) -> tuple[dict[str, Table], Decoder]:
    """Feed a log, cut at these places, and join its tables."""
    decoder = Decoder()
    parts: dict[str, list[Table]] = {}
    for block in [*blocks(data, list(places)), None]:
        fed = decoder.feed(b"", final=True) if block is None else decoder.feed(block)
        for name, table in fed.items():
            parts.setdefault(name, []).append(table)
    return {name: Table.concatenate(tables) for name, tables in parts.items()}, decoder


def assert_cuts_do_not_matter(data: bytes, places: Iterable[int]) -> Decoder:
    """Return the decoder of the whole log."""
    whole, expected = decode(data)
    parts, decoder = decode(data, places)
    assert parts.keys() == whole.keys()
    for name, table in whole.items():
        for part in ("frame", "time_us", "system", "component", "sequence", "flags", "fields"):
            assert getattr(parts[name], part).tobytes() == getattr(table, part).tobytes(), part
    for part in ("losses", "counts", "unknown", "first_time_us", "last_time_us"):
        assert getattr(decoder, part) == getattr(expected, part), part
    return expected


def differing_fields(table: Table, messages: list[Any]) -> list[str]:
    """Name the fields of a table whose values are not those of pymavlink's messages, row by row."""
    wrong = []
    for field in messages[0].fieldnames:
        ours, raw = table[field], f"_{field}_raw"
        if hasattr(messages[0], raw) or ours.dtype.kind == "S":
            name = raw if hasattr(messages[0], raw) else field
            same = ours.tolist() == [bytes(getattr(m, name)).rstrip(b"\0") for m in messages]
        else:
            theirs = np.array([getattr(m, field) for m in messages]).astype(ours.dtype)
            same = np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f")
        wrong += [] if same else [field]
    return wrong


def frames_in(data: bytes) -> list[bytes]:
    """The frames of a telemetry log's records, by their own lengths."""
    out, position = [], 0
    while position < len(data):
        start = position + 8
        long = 8 if data[start] == 0xFE else 25 if data[start + 2] & 1 else 12
        position = start + long + data[start + 1]
        out.append(data[start:position])
    return out
