"""Find the MAVLink frames in the bytes of a ``.tlog``, and tell what could not be read.

A record is the u64 big-endian time of reception in microseconds of UTC, then a MAVLink 1 or 2
frame. A frame of a known message counts only with a good CRC. A frame of an unknown message
carries a CRC that cannot be checked; it counts only in step with its neighbours. After damage the
scan goes on byte by byte. Where a block of bytes ends never matters: an unfinished record waits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from fastcrc import crc16

from mavhums.assessment import Losses
from mavhums.log.dialect import definitions

__all__ = ["Frame", "FrameScanner"]

_STAMP = 8
_MAGIC_V1, _MAGIC_V2 = 0xFE, 0xFD
_SIGNED = 0x01
_SIGNATURE = 13
_PLAUSIBLE_STEP_US = 3 * 86_400 * 1_000_000
_YEAR_2000_US, _YEAR_2100_US = 946_684_800_000_000, 4_102_444_800_000_000


class Frame(NamedTuple):
    """An intact frame; ``payload`` is as sent, that is without the zeros that MAVLink 2 trims."""

    time_us: int
    id: int
    system: int
    component: int
    sequence: int
    payload: bytes


class _Layout(NamedTuple):
    """Where the parts of a frame lie, from the record's start."""

    id: int
    system: int
    component: int
    sequence: int
    payload: int
    crc: int
    end: int


class FrameScanner:
    """Incremental scanner; feed it blocks of any size.

    Attributes
    ----------
    losses
        What was skipped so far.
    unknown
        Number of frames by unknown message id.
    """

    def __init__(self) -> None:
        self.losses = Losses()
        self.unknown: dict[int, int] = {}
        self.frames = 0
        self._crc_extra = {number: bytes([d.crc_extra]) for number, d in definitions().items()}
        self._rest = b""
        self._time_us: int | None = None
        self._odd_time_us: int | None = None
        self._in_step = True
        self._skipped = self._regions = self._bad_crc = self._odd_times = 0
        self._skipped_since_frame = 0

    def feed(self, block: bytes, *, final: bool = False) -> Iterator[Frame]:
        """Yield the frames that ``block`` completes; ``final`` says that nothing follows."""
        data = self._rest + block
        position = 0
        while (layout := self._frame_at(data, position, final)) is not None:
            if layout.end == 0:
                self._skip()
                position += 1
                continue
            if self._skipped_since_frame:
                self._skipped_since_frame = 0
            self._in_step = True
            if layout.id in self._crc_extra:
                self.frames += 1
                yield Frame(
                    self._plausible(int.from_bytes(data[position : position + _STAMP], "big")),
                    layout.id,
                    layout.system,
                    layout.component,
                    layout.sequence,
                    data[position + layout.payload : position + layout.crc],
                )
            else:
                self.unknown[layout.id] = self.unknown.get(layout.id, 0) + 1
            position += layout.end
        self._rest = data[position:]
        self._count(final)

    def _frame_at(self, data: bytes, position: int, final: bool) -> _Layout | None:
        """Return the frame's layout, one with ``end == 0`` if there is none, None to wait for more."""
        left = len(data) - position
        if left == 0:
            return None
        layout = _layout(data, position, left)
        if layout is None or layout.end > left:
            return _NO_FRAME if final else None
        if layout is _NO_FRAME:
            return layout
        if layout.id in self._crc_extra:
            start, end = position + _STAMP + 1, position + layout.crc
            crc = crc16.mcrf4xx(data[start:end] + self._crc_extra[layout.id])
            if crc == int.from_bytes(data[end : end + 2], "little"):
                return layout
            self._bad_crc += self._in_step
            return _NO_FRAME
        if not self._in_step:
            return _NO_FRAME
        after = left - layout.end
        if after <= _STAMP:
            return (layout if after == 0 else _NO_FRAME) if final else None
        follows = data[position + layout.end + _STAMP] in (_MAGIC_V1, _MAGIC_V2)
        return layout if follows else _NO_FRAME

    def _skip(self) -> None:
        self._skipped += 1
        self._skipped_since_frame += 1
        if self._in_step:
            self._regions += 1
            self._in_step = False

    def _plausible(self, time_us: int) -> int:
        """Return the time of reception, or the last good one where the stamp is damaged.

        Two odd stamps in a row that agree with each other are a clock that was set, not damage.
        """
        if not _YEAR_2000_US <= time_us < _YEAR_2100_US:
            self._odd_times += 1
            return self._time_us or _YEAR_2000_US
        reference = self._time_us
        if reference is not None and abs(time_us - reference) > _PLAUSIBLE_STEP_US:
            odd, self._odd_time_us = self._odd_time_us, time_us
            if odd is None or abs(time_us - odd) > _PLAUSIBLE_STEP_US:
                self._odd_times += 1
                return reference
        self._odd_time_us = None
        self._time_us = time_us
        return time_us

    def _count(self, final: bool) -> None:
        cut = self._skipped_since_frame if final else 0
        self.losses = Losses(
            bytes_skipped=self._skipped - cut,
            damaged_regions=self._regions - bool(cut),
            bad_crc_frames=self._bad_crc,
            unknown_frames=sum(self.unknown.values()),
            implausible_times=self._odd_times,
            cut_end_bytes=cut,
        )


_NO_FRAME = _Layout(0, 0, 0, 0, 0, 0, 0)


def _layout(data: bytes, position: int, left: int) -> _Layout | None:
    """Read a frame's header; None where it is not complete, ``_NO_FRAME`` where there is none."""
    if left <= _STAMP:
        return None
    start = position + _STAMP
    magic = data[start]
    if magic == _MAGIC_V2:
        if left < _STAMP + 10:
            return None
        length, flags = data[start + 1], data[start + 2]
        if flags & ~_SIGNED:
            return _NO_FRAME
        number = int.from_bytes(data[start + 7 : start + 10], "little")
        crc = _STAMP + 10 + length
        end = crc + 2 + (_SIGNATURE if flags & _SIGNED else 0)
        return _Layout(number, data[start + 5], data[start + 6], data[start + 4], _STAMP + 10, crc, end)
    if magic == _MAGIC_V1:
        if left < _STAMP + 6:
            return None
        crc = _STAMP + 6 + data[start + 1]
        return _Layout(
            data[start + 5], data[start + 3], data[start + 4], data[start + 2], _STAMP + 6, crc, crc + 2
        )
    return _NO_FRAME
