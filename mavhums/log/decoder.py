"""Blocks of bytes in, tables of messages out."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from mavhums.assessment import Losses
from mavhums.log.dialect import Definition, definitions
from mavhums.log.frames import Frame, FrameScanner
from mavhums.log.tables import Table

__all__ = ["Decoder"]


class Decoder:
    """Incremental decoder of a telemetry log.

    Parameters
    ----------
    messages
        Names of the message types that are wanted; all if None. Others are checked and counted
        but not unpacked.

    Attributes
    ----------
    counts
        Number of intact messages by (system, component, name), wanted or not.
    first_time_us, last_time_us
        Times of reception of the first and of the latest frame; None before the first.

    Examples
    --------
    >>> Decoder().feed(b"not a log", final=True)
    {}
    """

    def __init__(self, messages: Iterable[str] | None = None) -> None:
        self._definitions = definitions()
        names = {d.name for d in self._definitions.values()} if messages is None else set(messages)
        self._wanted = {number for number, d in self._definitions.items() if d.name in names}
        self._scanner = FrameScanner()
        self.counts: dict[tuple[int, int, str], int] = {}
        self.first_time_us: int | None = None
        self.last_time_us: int | None = None

    @property
    def losses(self) -> Losses:
        """What could not be read so far."""
        return self._scanner.losses

    @property
    def unknown(self) -> dict[int, int]:
        """Number of frames by message id that the dialect does not define."""
        return dict(self._scanner.unknown)

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        groups: defaultdict[int, list[tuple[int, Frame]]] = defaultdict(list)
        ordinal = self._scanner.frames
        for frame in self._scanner.feed(block, final=final):
            if self.first_time_us is None:
                self.first_time_us = frame.time_us
            self.last_time_us = frame.time_us
            key = (frame.system, frame.component, self._definitions[frame.id].name)
            self.counts[key] = self.counts.get(key, 0) + 1
            if frame.id in self._wanted:
                groups[frame.id].append((ordinal, frame))
            ordinal += 1
        return {
            self._definitions[number].name: _table(self._definitions[number], rows)
            for number, rows in groups.items()
        }


def _table(definition: Definition, rows: list[tuple[int, Frame]]) -> Table:
    size = definition.wire.itemsize
    payloads = b"".join(frame.payload[:size].ljust(size, b"\0") for _, frame in rows)
    header = np.array(
        [(n, f.time_us, f.system, f.component, f.sequence) for n, f in rows], dtype=np.int64
    ).reshape(-1, 5)
    return Table(
        definition.name,
        header[:, 0],
        header[:, 1],
        header[:, 2].astype(np.uint8),
        header[:, 3].astype(np.uint8),
        header[:, 4].astype(np.uint8),
        np.frombuffer(payloads, dtype=definition.wire),
    )
