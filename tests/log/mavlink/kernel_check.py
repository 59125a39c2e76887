"""Scan a stream, and check what holds of any stream: every byte is accounted for, and every CRC is right."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from fastcrc import crc16

from mavhums.log.base.decoder import MAVLINK1, ODD_TIME, PADDED, SIGNED
from mavhums.log.base.scanner import GUARD, RecordBatch
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.scanner import FrameScanner
from tests.strategies import blocks


class Frame(NamedTuple):
    """An intact frame: its record's offset in the stream, its payload as sent."""

    offset: int
    time_us: int
    id: int
    system: int
    component: int
    sequence: int
    payload: bytes
    version: int
    signed: bool
    padded: bool
    odd_time: bool

    @property
    def size(self) -> int:
        """Bytes of the frame without its record's time stamp."""
        return (12 if self.version == 2 else 8) + len(self.payload) + 13 * self.signed


def frames_of(batch: RecordBatch) -> list[Frame]:
    out = []
    for row in batch.rows:
        number, system, component = (int(row[name]) for name in ("number", "system", "component"))
        offset, time_us, sequence, flags = (int(row[x]) for x in ("offset", "time_us", "sequence", "flags"))
        begin = offset - batch.base + GUARD + batch.stamp + (6 if flags & MAVLINK1 else 10)
        payload = batch.data[begin : begin + int(row["length"])].tobytes()
        signed, padded, odd = (bool(flags & flag) for flag in (SIGNED, PADDED, ODD_TIME))
        sender, version = (system, component, sequence), 1 if flags & MAVLINK1 else 2
        out.append(Frame(offset, time_us, number, *sender, payload, version, signed, padded, odd))
    return out


def scan(data: bytes, places: Iterable[int] = (), *, stamp: int = 8) -> tuple[list[Frame], FrameScanner]:
    scanner = FrameScanner(load_dialect(), stamp=stamp)
    found = []
    for block in blocks(data, list(places)):
        found += frames_of(scanner.feed(block))
    return found + frames_of(scanner.feed(b"", final=True)), scanner


def checked(data: bytes, *, stamp: int = 8) -> tuple[list[Frame], FrameScanner]:
    frames, scanner = scan(data, stamp=stamp)
    known, totals = load_dialect().definitions, scanner.totals
    end, reserve, regions = 0, 0, []
    for frame in frames:
        start = frame.offset + stamp
        covered = data[start + 1 : start + frame.size - 2 - 13 * frame.signed]
        if frame.id in known and not frame.padded:
            crc = data[start + 1 + len(covered) : start + 3 + len(covered)]
            extra = bytes([known[frame.id].crc_extra])
            assert crc16.mcrf4xx(covered + extra) == int.from_bytes(crc, "little")
        # The time stamp may be missing, and the signature before it.
        begin = frame.offset if frame.offset >= end - reserve else start
        assert begin >= end - reserve
        if begin > end:
            regions.append((end, begin - end))
        end, reserve = start + frame.size, 13 * frame.signed
    tail = len(data) - end - totals.cut_end - totals.filler
    assert scanner.regions == [*regions, *([(end, tail)] if tail else [])][:1000]
    assert totals.padded == sum(frame.padded for frame in frames)
    return frames, scanner
