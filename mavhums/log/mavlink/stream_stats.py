"""Statistics of a stream: message counts and sequence losses per sender."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mavhums.log.losses import SequenceLoss
from mavhums.log.mavlink import _sequence
from mavhums.log.mavlink.dialect import Dialect

__all__ = ["StreamStats"]

_IDS_KEPT = 1000
_SENDERS_KEPT = 1024
_SUMS = ("frames", "missing", "gaps", "reordered", "duplicated")


class StreamStats:
    """Message counts, times and sequence losses of a stream, in bounded memory.

    If there are more than about a thousand senders, the least recently active ones are counted
    together, as component 0 (MAVLink's "all") of their system.

    Attributes
    ----------
    unknown
        Number of frames by message id that the dialect does not define; -1 stands for all ids
        beyond the first thousand.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.unknown: dict[int, int] = {}
        self._totals = np.zeros(4, dtype=np.int64)
        self._names = [definition.name for definition in dialect.definitions.values()]
        self._places = np.full(1 << 16, -1, dtype=np.int32)
        self._known = 0
        self._senders = np.zeros(8, dtype=_sequence.SENDER)
        self._counts = np.zeros((8, len(self._names)), dtype=np.int64)

    def add(self, rows: NDArray[np.void]) -> None:
        """Add the next frames."""
        if rows.size == 0:
            return
        done, before = 0, self.frames
        while True:
            done, self._known = _sequence.account(
                rows, done, self._places, self._known, self._senders, self._counts, self._totals
            )
            if done == rows.size:
                break
            if self._known == _SENDERS_KEPT:
                self._fold()
            else:
                self._senders = np.concatenate([self._senders, np.zeros_like(self._senders)])
                self._counts = np.concatenate([self._counts, np.zeros_like(self._counts)])
        if self.frames - before < rows.size:
            numbers = rows["id"][rows["message"] < 0]
            for number, count in zip(*np.unique(numbers, return_counts=True), strict=True):
                key = int(number) if number in self.unknown or len(self.unknown) < _IDS_KEPT else -1
                self.unknown[key] = self.unknown.get(key, 0) + int(count)

    @property
    def frames(self) -> int:
        """Number of intact frames of known messages."""
        return int(self._totals[0])

    @property
    def first_time_us(self) -> int | None:
        """Time of the first frame, microseconds of UTC; None before it."""
        return int(self._totals[1]) if self.frames else None

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest frame, microseconds of UTC; None before the first."""
        return int(self._totals[2]) if self.frames else None

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (system, component, name)."""
        counts = self._counts[: self._known]
        out = {}
        for place, message in zip(*(axis.tolist() for axis in np.nonzero(counts)), strict=True):
            system, component = divmod(int(self._senders["id"][place]), 256)
            out[system, component, self._names[message]] = int(counts[place, message])
        return out

    def sequence_losses(self) -> Iterator[SequenceLoss]:
        """Yield the losses of each sender whose sequence numbers have gaps, reordering or duplicates."""
        for sender in self._senders[: self._known]:
            found = {name: int(sender[name]) for name in ("missing", "gaps", "reordered", "duplicated")}
            if any(found.values()):
                system, component = divmod(int(sender["id"]), 256)
                yield SequenceLoss(system=system, component=component, frames=int(sender["frames"]), **found)

    def _fold(self) -> None:
        """Merge the least recently active half of the senders into component 0 of their systems."""
        identity = self._senders["id"]
        single = np.flatnonzero(identity & 0xFF)
        folded = single[np.argsort(self._senders["latest"][single], kind="stable")[: _SENDERS_KEPT // 2]]
        kept = np.setdiff1d(np.arange(_SENDERS_KEPT), folded)
        systems = np.setdiff1d(identity[folded] & ~0xFF, identity[kept])
        self._known = kept.size + systems.size
        senders, counts = np.zeros_like(self._senders), np.zeros_like(self._counts)
        senders[: kept.size], counts[: kept.size] = self._senders[kept], self._counts[kept]
        senders["id"][kept.size : self._known] = systems
        self._places[:] = -1
        self._places[senders["id"][: self._known]] = np.arange(self._known)
        target = self._places[identity[folded] & ~0xFF]
        for name in _SUMS:
            np.add.at(senders[name], target, self._senders[name][folded])
        np.add.at(counts, target, self._counts[folded])
        self._senders, self._counts = senders, counts
