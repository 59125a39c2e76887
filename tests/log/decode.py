"""Decode a log in one block or in many."""

from __future__ import annotations

from collections.abc import Iterable

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


def assert_equal(ours: Table, theirs: Table) -> None:
    for part in ("frame", "time_us", "system", "component", "sequence", "flags", "fields"):
        assert getattr(ours, part).tobytes() == getattr(theirs, part).tobytes(), part


def assert_cuts_do_not_matter(data: bytes, places: Iterable[int]) -> None:
    whole, reference_decoder = decode(data)
    parts, decoder = decode(data, places)
    assert parts.keys() == whole.keys()
    for name, table in whole.items():
        assert_equal(parts[name], table)
    assert decoder.losses == reference_decoder.losses
    assert decoder.counts == reference_decoder.counts
    assert decoder.unknown == reference_decoder.unknown
    assert decoder.first_time_us == reference_decoder.first_time_us
    assert decoder.last_time_us == reference_decoder.last_time_us
