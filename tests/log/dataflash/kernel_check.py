"""The kernel held against the reference, record by record."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from mavhums.log.base.scanner import GUARD
from mavhums.log.base.tables import ODD_TIME
from mavhums.log.dataflash.scanner import RecordScanner
from tests.log.dataflash import reference
from tests.log.dataflash.reference import Record


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
            odd = bool(row["flags"] & ODD_TIME)
            found.append(
                Record(int(row["offset"]), name, payload, int(row["time_us"]), int(row["number"]), odd)
            )
    return found, scanner


def agree(data: bytes) -> list[Record]:
    """Assert that kernel and reference agree on a whole stream; return the records."""
    expected = reference.scan(data)
    found, scanner = scan(data)
    assert found == expected.records
    totals = scanner.totals
    assert (totals.old_records, totals.odd_times, totals.jumps, totals.rewinds) == (
        expected.old,
        expected.odd_times,
        expected.jumps,
        expected.rewinds,
    )
    skipped = sum(size for _, size in expected.regions)
    assert totals.skipped + totals.cut_end + totals.filler == skipped + expected.tail
    assert np.array_equal(scanner.regions[: len(expected.regions)], expected.regions[:1000] or [])
    return found
