"""Decoder of MAVLink streams: converts blocks of bytes to tables of messages."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mavhums.log.losses import Losses, Region
from mavhums.log.mavlink._gather import SPARE, count, gather
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.intake import Intake
from mavhums.log.mavlink.scanner import Batch, FrameScanner
from mavhums.log.mavlink.sender_clock import SenderClocks
from mavhums.log.mavlink.signing import Guard
from mavhums.log.mavlink.stream_stats import StreamStats
from mavhums.log.mavlink.vehicles import vehicles_of
from mavhums.log.tables import Table

__all__ = ["MavlinkDecoder"]

_REGIONS_LISTED = 100


class MavlinkDecoder:
    """Incremental decoder of a MAVLink telemetry log, in memory that does not grow with it.

    Parameters
    ----------
    messages
        Names of the message types that are wanted; all if None. Others are checked and counted
        but not unpacked.
    dialect
        A MAVLink XML file whose definitions take precedence over the shipped ones.
    key
        32 bytes; only frames signed with it count. If None, signatures are not looked at.

    Raises
    ------
    DialectError
        If the XML cannot be used.

    Examples
    --------
    >>> MavlinkDecoder().feed(b"not a log", final=True)
    {}
    """

    def __init__(
        self,
        messages: Iterable[str] | None = None,
        *,
        dialect: str | os.PathLike[str] | None = None,
        key: bytes | None = None,
    ) -> None:
        self._dialect = load_dialect(None if dialect is None else Path(dialect))
        definitions = self._dialect.definitions.values()
        wanted = None if messages is None else set(messages)
        self._wanted = np.array([wanted is None or d.name in wanted for d in definitions])
        self._sizes = np.array([d.wire.itemsize for d in definitions], dtype=np.int32)
        self._by_row = list(definitions)
        self._intake = Intake(self._dialect)
        self._stats = StreamStats(self._dialect)
        self._clocks = SenderClocks(self._dialect)
        self._guard = None if key is None else Guard(key)
        self._scanner: FrameScanner | None = None

    @property
    def format(self) -> str:
        """Name of the format."""
        return "tlog"

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (system, component, name), including unwanted ones."""
        return self._stats.counts

    @property
    def vehicles(self) -> tuple[int, ...]:
        """System ids of the vehicles."""
        return vehicles_of(self._stats.counts)

    @property
    def first_time_us(self) -> int | None:
        """Time of the first frame, microseconds of UTC; None before it."""
        return self._stats.first_time_us

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest frame, microseconds of UTC; None before the first."""
        return self._stats.last_time_us

    @property
    def unknown(self) -> dict[int, int]:
        """Number of frames by message id that the dialect does not define."""
        return dict(self._stats.unknown)

    @property
    def undated(self) -> bool:
        """Whether the log has no time stamps, so that times count from the sender's boot."""
        return self._intake.stamp == 0

    @property
    def losses(self) -> Losses:
        """Losses so far."""
        if self._scanner is None:
            return Losses()
        totals = self._scanner.totals
        guard = self._guard
        bad = self._scanner.bad_crc
        return Losses(
            bytes_skipped=totals.skipped,
            damaged_regions=totals.regions,
            bad_crc_frames=int(bad.sum()),
            unknown_frames=sum(self._stats.unknown.values()),
            implausible_times=totals.odd_times,
            cut_end_bytes=totals.cut_end,
            regions=tuple(Region(offset=o, size=n) for o, n in self._scanner.regions[:_REGIONS_LISTED]),
            bad_crc_by_message={self._by_row[k].name: int(bad[k]) for k in np.flatnonzero(bad)},
            padded_frames=totals.padded,
            padded_false_bound=totals.trials / 65536,
            trailing_zeros=totals.zeros,
            line_ends_restored=self._intake.line_ends,
            time_jumps=totals.jumps,
            time_rewinds=totals.rewinds,
            sequence=tuple(self._stats.sequence_losses()),
            unsigned_frames=guard.unsigned if guard else 0,
            bad_signatures=guard.bad if guard else 0,
            replayed_frames=guard.replayed if guard else 0,
        )

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        data = self._intake.feed(block, final=final)
        if self._scanner is None:
            if self._intake.stamp is None:
                return {}
            self._scanner = FrameScanner(self._dialect, stamp=self._intake.stamp)
        batch = self._scanner.feed(data, final=final)
        if self._guard:
            batch = replace(batch, rows=batch.rows[self._guard.admit(batch)])
        if batch.stamp == 0:
            self._clocks.set_times(batch)
        ordinal = self._stats.frames
        self._stats.add(batch.rows)
        return self._tables(batch, ordinal)

    def _tables(self, batch: Batch, ordinal: int) -> dict[str, Table]:
        counts = count(batch.rows, self._wanted)
        row_of = np.cumsum(counts) - counts
        bytes_by_message = counts * self._sizes + SPARE
        byte_of = np.cumsum(bytes_by_message) - bytes_by_message
        total = int(counts.sum())
        frame, time_us = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
        header = np.empty((4, total), dtype=np.uint8)
        payloads = np.empty(int(bytes_by_message.sum()), dtype=np.uint8)
        places = byte_of.copy(), row_of.copy()
        gather(
            batch.data, batch.base, batch.stamp, batch.rows, ordinal, self._wanted, self._sizes,
            row_of, byte_of, frame, time_us, header, payloads,
        )  # fmt: skip
        out = {}
        for k in np.flatnonzero(counts).tolist():
            definition = self._by_row[k]
            begin, end = places[1][k], row_of[k]
            fields = payloads[places[0][k] : byte_of[k]].view(definition.wire)
            out[definition.name] = Table(
                definition.name,
                frame[begin:end],
                time_us[begin:end],
                header[0, begin:end],
                header[1, begin:end],
                header[2, begin:end],
                header[3, begin:end],
                fields,
            )
        return out
