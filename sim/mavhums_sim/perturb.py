"""Changes to a ``.tlog`` that leave the flight as it was: parameters at another time, a cut, damage.

Each function takes the bytes of an intact log and returns those of the changed one. A frame moved in time
keeps its bytes; only the stamp of its reception changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Integers

_STAMP = 8
_PARAM_VALUE = 22
_LONGEST_PIECE = 4096
_GAPS_S = (1.0, 60.0)
_FLIPPED = (1e-5, 1e-3)  # share of the bytes with a flipped bit
_PAUSE_US = 100_000  # at most, between the parameters of a list
_PLACES = (1, 20)  # of damage in one log
_LATENCY_SHAPE, _LATENCY_S = 1.5, 0.03  # gamma: a telemetry radio, 0.045 s in the mean
_LOST = (0.005, 0.013)  # share of the frames
_STREAMS = (26, 27, 30, 33, 36, 62, 74, 83, 105, 116)  # IMUs, attitude, position, outputs, demand, airspeed

Random = np.random.Generator


class _Frames(NamedTuple):
    """The frames of a log: bytes with their stamp, reception in µs, and message ids."""

    data: list[bytes]
    time_us: Integers
    message: Integers


def _frames(tlog: bytes) -> _Frames:
    """Divide an intact log into its frames."""
    data, message, at = [], [], 0
    while at + _STAMP + 8 <= len(tlog):
        head = tlog[at + _STAMP : at + _STAMP + 10]
        if head[0] == 0xFE:
            size, number = head[1] + 8, head[5]
        else:
            size = head[1] + 12 + (13 if head[2] & 1 else 0)
            number = int.from_bytes(head[7:10], "little")
        data.append(tlog[at : at + _STAMP + size])
        message.append(number)
        at += _STAMP + size
    stamps = [int.from_bytes(frame[:_STAMP], "big") for frame in data]
    return _Frames(data, np.array(stamps, dtype=np.int64), np.array(message, dtype=np.int64))


def _at(frames: _Frames, share: float) -> int:
    """Return the time at a share of the log's duration, µs."""
    first, last = int(frames.time_us.min()), int(frames.time_us.max())
    return first + round(share * (last - first))


def _later(frames: _Frames, moved: NDArray[np.bool_], time_us: int, kept: NDArray[np.bool_]) -> bytes:
    """Return the kept frames, and the moved ones as one list that begins at this time."""
    rows = np.flatnonzero(moved)
    pauses = np.clip(np.diff(frames.time_us[rows], prepend=frames.time_us[rows[:1]]), 0, _PAUSE_US)
    stamps = time_us + np.cumsum(pauses)
    copies = [
        int(stamp).to_bytes(_STAMP, "big") + frames.data[row][_STAMP:]
        for stamp, row in zip(stamps.tolist(), rows.tolist(), strict=True)
    ]
    left = np.flatnonzero(kept)
    times = np.concatenate([np.maximum.accumulate(frames.time_us[left]), stamps])
    every = [*(frames.data[row] for row in left.tolist()), *copies]
    return b"".join(every[k] for k in np.argsort(times, kind="stable").tolist())


def _list_before(frames: _Frames, share: float) -> tuple[NDArray[np.bool_], int]:
    """Return the parameters that come before a share of the log's duration, and that time."""
    time_us = _at(frames, share)
    return (frames.message == _PARAM_VALUE) & (frames.time_us < time_us), time_us


def move_parameters(tlog: bytes, share: float) -> bytes:
    """Let the list of parameters come at a share of the log's duration, as a late ground station does."""
    frames = _frames(tlog)
    parameters, time_us = _list_before(frames, share)
    return _later(frames, parameters, time_us, ~parameters)


def repeat_parameters(tlog: bytes, share: float) -> bytes:
    """Let the list of parameters come a second time, unchanged."""
    frames = _frames(tlog)
    parameters, time_us = _list_before(frames, share)
    return _later(frames, parameters, time_us, np.ones(len(frames.data), dtype=bool))


def without_parameters(tlog: bytes) -> bytes:
    """Leave the parameters out."""
    frames = _frames(tlog)
    return _kept(frames, frames.message != _PARAM_VALUE)


def patch_parameters(tlog: bytes, share: float, rng: Random) -> bytes:
    """Lose half of the list at first, and let the whole list come again later."""
    frames = _frames(tlog)
    parameters, time_us = _list_before(frames, share)
    lost = parameters & (rng.random(len(frames.data)) < 0.5)
    return _later(frames, parameters, time_us, ~lost)


def begin_later(tlog: bytes, share: float) -> bytes:
    """Cut whole frames off the beginning."""
    frames = _frames(tlog)
    return _kept(frames, frames.time_us >= _at(frames, share))


def _begun_with_parameters(tlog: bytes, share: float) -> bytes:
    """Cut off the beginning, and let the parameters come then: a ground station that connects in flight."""
    return begin_later(move_parameters(tlog, share), share)


def _kept(frames: _Frames, keep: NDArray[np.bool_]) -> bytes:
    return b"".join(frame for frame, kept in zip(frames.data, keep, strict=True) if kept)


def _one_stream(tlog: bytes, rng: Random) -> tuple[_Frames, NDArray[np.bool_], int]:
    """Draw one of the streams of a log and a time; return the frames, the stream's and the time."""
    frames = _frames(tlog)
    there = np.intersect1d(_STREAMS, frames.message)
    stream = frames.message == (rng.choice(there) if there.size else -1)
    return frames, stream, _at(frames, rng.uniform(0.1, 0.8))


def _stream_ends(tlog: bytes, rng: Random) -> bytes:
    frames, stream, time_us = _one_stream(tlog, rng)
    return _kept(frames, ~stream | (frames.time_us < time_us))


def _stream_begins(tlog: bytes, rng: Random) -> bytes:
    frames, stream, time_us = _one_stream(tlog, rng)
    return _kept(frames, ~stream | (frames.time_us >= time_us))


def _lengths(tlog: bytes, rng: Random) -> list[tuple[int, int]]:
    """Draw places and lengths of damage, from the last to the first."""
    count = int(rng.integers(*_PLACES))
    places = np.sort(rng.integers(0, max(len(tlog) - _LONGEST_PIECE, 1), count))[::-1]
    return [(int(at), int(rng.integers(1, _LONGEST_PIECE))) for at in places]


def _flipped(tlog: bytes, rng: Random) -> bytes:
    data = np.frombuffer(tlog, dtype=np.uint8).copy()
    share = float(np.exp(rng.uniform(*np.log(_FLIPPED))))
    places = rng.choice(len(data), size=max(int(share * len(data)), 1), replace=False)
    data[places] ^= (1 << rng.integers(0, 8, places.size)).astype(np.uint8)
    return data.tobytes()


def _zeroed(tlog: bytes, rng: Random) -> bytes:
    data = bytearray(tlog)
    for at, size in _lengths(tlog, rng):
        data[at : at + size] = bytes(len(data[at : at + size]))
    return bytes(data)


def _inserted(tlog: bytes, rng: Random) -> bytes:
    data = bytearray(tlog)
    for at, size in _lengths(tlog, rng):
        data[at:at] = rng.bytes(size)
    return bytes(data)


def _repeated(tlog: bytes, rng: Random) -> bytes:
    data = bytearray(tlog)
    for at, size in _lengths(tlog, rng):
        data[at:at] = data[at : at + size]
    return bytes(data)


def _gaps(tlog: bytes, rng: Random) -> bytes:
    frames = _frames(tlog)
    keep = np.ones(len(frames.data), dtype=bool)
    for _ in range(int(rng.integers(1, 6))):
        begin, length = _at(frames, rng.random()), rng.uniform(*_GAPS_S) * 1e6
        keep &= (frames.time_us < begin) | (frames.time_us >= begin + length)
    return _kept(frames, keep)


def through_radio(tlog: bytes, rng: Random) -> bytes:
    """Let each frame arrive late by a random time, none before an earlier one, and lose one in a hundred."""
    frames = _frames(tlog)
    late_us = rng.gamma(_LATENCY_SHAPE, _LATENCY_S * 1e6, len(frames.data)).astype(np.int64)
    stamps = np.maximum.accumulate(frames.time_us + late_us).tolist()
    lost = rng.random(len(frames.data)) < rng.uniform(*_LOST)
    return b"".join(
        stamp.to_bytes(_STAMP, "big") + frame[_STAMP:]
        for stamp, frame, gone in zip(stamps, frames.data, lost.tolist(), strict=True)
        if not gone
    )


def _swapped(tlog: bytes, rng: Random) -> bytes:
    half = round(len(tlog) * rng.uniform(0.3, 0.7))
    return tlog[half:] + tlog[:half]


KINDS: Mapping[str, Callable[[bytes, Random], bytes]] = {
    "parameters late": lambda tlog, rng: move_parameters(tlog, rng.uniform(0.1, 0.8)),
    "parameters twice": lambda tlog, rng: repeat_parameters(tlog, rng.uniform(0.1, 0.8)),
    "parameters patched": lambda tlog, rng: patch_parameters(tlog, rng.uniform(0.1, 0.8), rng),
    "parameters absent": lambda tlog, _: without_parameters(tlog),
    "beginning cut": lambda tlog, rng: begin_later(tlog, rng.uniform(0.03, 0.7)),
    "beginning cut but for the parameters": lambda tlog, rng: _begun_with_parameters(
        tlog, rng.uniform(0.03, 0.7)
    ),
    "stream ends": _stream_ends,
    "stream begins": _stream_begins,
    "bits flipped": _flipped,
    "pieces zeroed": _zeroed,
    "bytes inserted": _inserted,
    "pieces repeated": _repeated,
    "gaps": _gaps,
    "halves swapped": _swapped,
    "radio": through_radio,
}
"""Changes by name."""


def perturb(tlog: bytes, kind: str, seed: int) -> bytes:
    """Return a log changed in one way; what is drawn depends on the seed alone.

    Parameters
    ----------
    tlog
        An intact log.
    kind
        One of :data:`KINDS`.
    seed
        Of the share, the places and the sizes.

    Examples
    --------
    >>> perturb(b"", "bytes inserted", 1)[:0]
    b''
    """
    return KINDS[kind](tlog, np.random.default_rng([seed, *kind.encode()]))
