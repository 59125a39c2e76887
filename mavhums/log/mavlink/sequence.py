"""Message counts per sender, and frames lost on the link according to the sequence numbers.

A sender counts its frames modulo 256, with one counter per link, and a ground station may log
several links, or one link twice. Up to four counters are therefore tracked per (system, component).
A frame belongs to the counter that expects it, or that recently missed or received it; otherwise it
opens a new counter. If the previous counter stops while the new one continues, the step between
them was a loss (modulo 256, so a lower bound); if it continues, they are two links. A late frame,
overtaken by up to 127 others, is no longer counted as missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Block, Integers1, Integers2, Records
from mavhums.core.kernels import inlined, kernel, subroutine
from mavhums.log.base.decoder import SequenceLoss
from mavhums.log.base.scanner import Rows
from mavhums.log.mavlink.dialect import Dialect

_LINKS = 4
_AHEAD = 32
_BEHIND = 128
_WORD = 64
_SETTLED = 8
_ONE = np.uint64(1)
_IDS_KEPT = 1000
_SENDERS_KEPT = 1024
_SUMS = ("frames", "missing", "gaps", "reordered", "duplicated")

_LINK = np.dtype(
    [
        ("high", "i8"),
        ("seen", "u8"),
        ("older", "u8"),
        ("used", "i8"),
        ("opened", "i8"),
        ("before", "i8"),
        ("age", "i8"),
        ("crc", "u2", (128,)),
    ]
)
"""One counter. ``seen`` has bit j set if number ``high - j`` came, ``older`` those 64 before; ``used`` and
``opened`` are the sender's frame counts then (0: free); ``before`` is the counter that spoke before it, or
-1."""

_SENDER = np.dtype(
    [*((name, "i8") for name in ("id", *_SUMS, "link", "latest")), ("links", _LINK, (_LINKS,))], align=True
)
"""``id`` is 256 · system + component; ``link`` the counter that spoke last; ``latest`` the number of
its latest frame among all."""


@subroutine
def _step(link: Any, sequence: int) -> int:
    step: int = (sequence - link.high) & 0xFF
    return step - 256 if step >= 128 else step


@inlined
def _came(link: Any, back: int) -> bool:
    """Return whether the number ``high - back`` was received."""
    word = link.seen if back < _WORD else link.older
    return bool((word >> np.uint64(back % _WORD)) & _ONE)


@inlined
def _mark(link: Any, back: int, came: bool) -> None:
    bit = _ONE << np.uint64(back % _WORD)
    if back < _WORD:
        link.seen = link.seen | bit if came else link.seen & ~bit
    else:
        link.older = link.older | bit if came else link.older & ~bit


@inlined
def _advance(link: Any, step: int) -> None:
    """Advance by 1 to 63 numbers, the last of which was received."""
    link.older = (link.older << np.uint64(step)) | (link.seen >> np.uint64(_WORD - step))
    link.seen = (link.seen << np.uint64(step)) | _ONE
    link.high += step
    link.age += step


@subroutine
def _belongs(link: Any, sequence: int, crc: int) -> bool:
    if link.used == 0:
        return False
    step = _step(link, sequence)
    if step > 0:
        return step <= _AHEAD
    if step <= -_BEHIND:
        return False
    return bool(not _came(link, -step) or link.crc[sequence & 127] == crc)


@subroutine
def _choose(sender: Any, sequence: int, crc: int) -> int:
    """Return the frame's counter: the matching one with the smallest step; -1 if none matches."""
    best, least = -1, 1000
    for k in range(_LINKS):
        if _belongs(sender.links[k], sequence, crc):
            step = _step(sender.links[k], sequence)
            distance = 2 * step if step > 0 else 1 - 2 * step
            if distance < least:
                best, least = k, distance
    return best


@subroutine
def _open(sender: Any, sequence: int) -> int:
    oldest = 0
    for k in range(1, _LINKS):
        if sender.links[k].used < sender.links[oldest].used:
            oldest = k
    link = sender.links[oldest]
    link.high = sequence - 1
    link.seen = link.older = ~np.uint64(0)
    link.opened = sender.frames
    link.before = sender.link if sender.frames > 1 and sender.link != oldest else -1
    link.age = 0
    return oldest


@subroutine
def _classify_counter(sender: Any, link: Any) -> None:
    """Decide whether a new counter continues one that stopped, or runs in parallel."""
    before = sender.links[link.before]
    if before.used < link.opened:
        first = link.high - link.age + 1
        gap = (first - before.high - 1) & 0xFF
        sender.missing += gap
        sender.gaps += 1
        for back in range(link.age, min(link.age + gap, _BEHIND)):
            _mark(link, back, False)
        before.used = 0
    link.before = -1


@subroutine
def _follow(sender: Any, sequence: int, crc: int) -> None:
    chosen = _choose(sender, sequence, crc)
    if chosen < 0:
        chosen = _open(sender, sequence)
    link = sender.links[chosen]
    step = _step(link, sequence)
    if step > 0:
        _advance(link, step)
        sender.missing += step - 1
        sender.gaps += step > 1
    elif _came(link, -step):
        sender.duplicated += 1
    else:
        _mark(link, -step, True)
        sender.missing -= 1
        sender.reordered += 1
    link.crc[sequence & 127] = crc
    link.used = sender.frames
    sender.link = chosen
    if link.before >= 0 and link.age >= _SETTLED:
        _classify_counter(sender, link)


@inlined
def _goes_on(sender: Any, link: Any, sequence: int, crc: int) -> bool:
    """Handle the common case: the last active counter increases by one."""
    if link.before >= 0 or link.used == 0 or (sequence - link.high) & 0xFF != 1:
        return False
    _advance(link, 1)
    link.crc[sequence & 127] = crc
    link.used = sender.frames
    return True


@kernel
def _account(
    rows: Rows,
    first: int,
    places: Annotated[NDArray[np.int32], Block(np.int32)],
    known: int,
    senders: Annotated[Records, Block(_SENDER)],
    counts: Integers2,
    totals: Integers1,
) -> tuple[int, int]:
    """Process the frames ``rows[first:]``, until there is no room for a new sender.

    Parameters
    ----------
    places
        Row of each sender in ``senders`` and ``counts``, -1 if it has none; shape (65536,).
    known
        Number of rows in use.
    senders, counts
        Updated; ``counts`` has shape (rows, messages).
    totals
        Updated, shape (4,): number of frames of known messages, times of the first and the latest;
        number of all frames.

    Returns
    -------
    Total number of rows processed, number of senders.
    """
    for k in range(first, rows.size):
        row = rows[k]
        identity = np.int64(row.system) << 8 | np.int64(row.component)
        place = places[identity]
        if place < 0:
            if known == senders.size:
                return k, known
            place = known
            places[identity] = place
            senders[place].id = identity
            known += 1
        sender = senders[place]
        sender.frames += 1
        totals[3] += 1
        sender.latest = totals[3]
        if row.definition >= 0:
            counts[place, row.definition] += 1
            if totals[0] == 0:
                totals[1] = row.time_us
            totals[0] += 1
            totals[2] = row.time_us
        if not _goes_on(sender, sender.links[sender.link], int(row.sequence), row.crc):
            _follow(sender, int(row.sequence), row.crc)
    return rows.size, known


class StreamStats:
    """Message counts, times and sequence losses of a stream, in bounded memory.

    If there are more than about a thousand senders, the least recently active ones are counted
    together, as component 0 (MAVLink's "all") of their system.

    Attributes
    ----------
    unknown
        Number of frames by message id that the dialect does not define; -1 means all ids
        beyond the first thousand.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.unknown: dict[int, int] = {}
        self._totals = np.zeros(4, dtype=np.int64)
        self._names = [definition.name for definition in dialect.definitions.values()]
        self._places = np.full(1 << 16, -1, dtype=np.int32)
        self._known = 0
        self._senders = np.zeros(8, dtype=_SENDER)
        self._counts = np.zeros((8, len(self._names)), dtype=np.int64)

    def add(self, rows: Records) -> None:
        """Add the next frames."""
        if rows.size == 0:
            return
        done, before = 0, self.frames
        while True:
            done, self._known = _account(
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
            numbers = rows["number"][rows["definition"] < 0]
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
            found = {name: int(sender[name]) for name in _SUMS[1:]}
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
