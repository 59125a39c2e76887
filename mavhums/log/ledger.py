"""The account of a stream: who sent how much of what, and what its sequence numbers lack."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mavhums.assessment import SequenceLoss
from mavhums.log import _sequence
from mavhums.log.dialect import Dialect

__all__ = ["Ledger"]


class Ledger:
    """Counts the frames of a stream.

    Attributes
    ----------
    unknown
        Number of frames by message id that the dialect does not define.
    frames
        Number of intact frames of known messages.
    first_time_us, last_time_us
        Times of the first and of the latest of them; None before the first.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.unknown: dict[int, int] = {}
        self.frames = 0
        self.first_time_us: int | None = None
        self.last_time_us: int | None = None
        self._names = [definition.name for definition in dialect.definitions.values()]
        self._places = np.full(1 << 16, -1, dtype=np.int32)
        self._known = 0
        self._senders = np.zeros(8, dtype=_sequence.SENDER)
        self._counts = np.zeros((8, len(self._names)), dtype=np.int64)

    def add(self, rows: NDArray[np.void]) -> None:
        """Take the next frames into account."""
        if rows.size == 0:
            return
        done = 0
        while True:
            done, self._known = _sequence.account(
                rows, done, self._places, self._known, self._senders, self._counts
            )
            if done == rows.size:
                break
            self._senders = np.concatenate([self._senders, np.zeros_like(self._senders)])
            self._counts = np.concatenate([self._counts, np.zeros_like(self._counts)])
        strangers = rows["message"] < 0
        known = np.flatnonzero(~strangers)
        for number, count in zip(*np.unique(rows["id"][strangers], return_counts=True), strict=True):
            self.unknown[int(number)] = self.unknown.get(int(number), 0) + int(count)
        self.frames += known.size
        if known.size:
            self.last_time_us = int(rows["time_us"][known[-1]])
            if self.first_time_us is None:
                self.first_time_us = int(rows["time_us"][known[0]])

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
        """Yield an account of each sender whose sequence numbers are not in one unbroken order."""
        for sender in self._senders[: self._known]:
            found = {name: int(sender[name]) for name in ("missing", "gaps", "reordered", "duplicated")}
            if any(found.values()):
                system, component = divmod(int(sender["id"]), 256)
                yield SequenceLoss(system=system, component=component, frames=int(sender["frames"]), **found)
