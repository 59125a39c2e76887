"""Scan a stream, and check what holds of any stream."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

from mavhums.log.base.decoder import ODD_TIME
from mavhums.log.base.scanner import GUARD
from mavhums.log.dataflash.scanner import RecordScanner


class Record(NamedTuple):
    """An intact record: its offset, its type's definition as sent, and its time since boot."""

    offset: int
    definition: bytes
    payload: bytes
    time_us: int
    boot: int
    odd_time: bool


def scan(data: bytes, places: Iterable[int] = ()) -> tuple[list[Record], RecordScanner]:
    """What the kernel finds in a stream that is cut into blocks at ``places``."""
    scanner = RecordScanner()
    found: list[Record] = []
    edges = [0, *sorted(places), len(data)]
    for k, (begin, end) in enumerate(pairwise(edges)):
        batch = scanner.feed(data[begin:end], final=k == len(edges) - 2)
        for row in batch.rows:
            body = scanner.bodies[int(row["definition"])].tobytes()
            start = int(row["offset"]) - batch.base + GUARD
            payload = batch.data[start + 3 : start + body[1]].tobytes()
            name = b"FMT" if row["definition"] == 0 else body
            offset, time_us, boot = (int(row[key]) for key in ("offset", "time_us", "number"))
            found.append(Record(offset, name, payload, time_us, boot, bool(row["flags"] & ODD_TIME)))
    return found, scanner


def checked(data: bytes) -> tuple[list[Record], RecordScanner]:
    """Scan a stream, and check what holds of any: types are defined, and all bytes accounted for."""
    found, scanner = scan(data)
    end, regions, defined = 0, list[tuple[int, int]](), {b"FMT"}
    for record in found:
        assert record.definition in defined
        if record.definition == b"FMT":
            defined.add(record.payload)
        else:
            assert record.definition[:2] == bytes([data[record.offset + 2], 3 + len(record.payload)])
        assert data[record.offset :].startswith(b"\xa3\x95")
        assert data[record.offset + 3 :].startswith(record.payload)
        assert record.offset >= end
        if record.offset > end:
            regions.append((end, record.offset - end))
        end = record.offset + 3 + len(record.payload)
    totals = scanner.totals
    assert scanner.regions[: len(regions)] == regions[:1000]
    assert totals.skipped + totals.cut_end + totals.filler == sum(n for _, n in regions) + len(data) - end
    return found, scanner
