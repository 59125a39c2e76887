"""Hold the kernel against the reference on one stream."""

from __future__ import annotations

from collections.abc import Iterable

from mavhums.log.base.scanner import GUARD, RecordBatch
from mavhums.log.base.tables import MAVLINK1, ODD_TIME, PADDED, SIGNED
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.scanner import FrameScanner
from tests.log.mavlink import reference
from tests.log.mavlink.reference import Frame
from tests.strategies import blocks


def frames_of(batch: RecordBatch) -> list[Frame]:
    out = []
    for row in batch.rows:
        flags = int(row["flags"])
        head = 6 if flags & MAVLINK1 else 10
        begin = int(row["offset"]) - batch.base + GUARD + batch.stamp + head
        payload = batch.data[begin : begin + int(row["length"])].tobytes()
        offset, time_us, number, system, component, sequence = (
            int(row[name]) for name in ("offset", "time_us", "number", "system", "component", "sequence")
        )
        signed, padded, odd = (bool(flags & flag) for flag in (SIGNED, PADDED, ODD_TIME))
        version = 1 if flags & MAVLINK1 else 2
        out.append(
            Frame(offset, time_us, number, system, component, sequence, payload, version, signed, padded, odd)
        )
    return out


def scan(data: bytes, places: Iterable[int] = (), *, stamp: int = 8) -> tuple[list[Frame], FrameScanner]:
    scanner = FrameScanner(load_dialect(), stamp=stamp)
    found = []
    for block in blocks(data, list(places)):
        found += frames_of(scanner.feed(block))
    return found + frames_of(scanner.feed(b"", final=True)), scanner


def agree(data: bytes, *, stamp: int = 8) -> reference.Scan:
    """Check the kernel against the reference, and return what they found."""
    found, scanner = scan(data, stamp=stamp)
    expected = reference.scan(data, load_dialect(), stamp=stamp)
    assert found == expected.frames
    totals = scanner.totals
    assert scanner.regions == expected.regions[:1000]
    assert (totals.skipped, totals.regions) == (sum(n for _, n in expected.regions), len(expected.regions))
    assert (totals.cut_end, totals.filler) == (expected.cut_end, expected.zeros)
    assert (totals.odd_times, totals.jumps, totals.rewinds) == (
        expected.odd_times,
        expected.jumps,
        expected.rewinds,
    )
    assert totals.trials == expected.trials
    assert totals.padded == sum(frame.padded for frame in found)
    ids = list(load_dialect().definitions)
    assert {ids[k]: n for k, n in enumerate(scanner.bad_crc.tolist()) if n} == dict(expected.bad_crc)
    return expected
