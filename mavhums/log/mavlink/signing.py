"""MAVLink 2 signatures: admits frames signed with the user's key, and rejects replays.

A signed frame ends with its link id, a 48-bit time stamp in units of 10 µs since 2015, and the
first six bytes of SHA-256 over key, frame, link id and time stamp (MAVLink's "Message Signing").
"""

from __future__ import annotations

import hashlib
import hmac
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mavhums.core.arrays import Flags, Integers, Records
from mavhums.core.errors import MavhumsError
from mavhums.log.base.decoder import MAVLINK1, SIGNED
from mavhums.log.base.scanner import RecordBatch
from mavhums.log.mavlink.frames import HEAD_V1, HEAD_V2, SIGNATURE

TICKS_PER_MINUTE = 60 * 100_000
"""Ticks of a signature's time stamp in a minute; a tick is 10 µs."""

_KEY_BYTES = 32
_DIGEST_BYTES = 6
_EPOCH_2015_US = 1_420_070_400_000_000

Stream = tuple[int, int, int]
"""A stream of signed frames: link, system, component."""


class KeyFileError(MavhumsError):
    """The file does not contain a signing key."""


def load_key(path: str | os.PathLike[str]) -> bytes:
    """Read the 32 bytes of a signing key from a file, raw or as 64 hexadecimal digits.

    Raises
    ------
    KeyFileError
        If the file cannot be read, or holds neither.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}", "name the file with the signing key") from error
    if len(content) == _KEY_BYTES:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii"))
    except ValueError:
        key = b""
    if len(key) != _KEY_BYTES:
        raise KeyFileError(
            f"{path}: not a signing key",
            "it must contain 32 bytes, or 64 hexadecimal digits; from a passphrase, as in ground stations, "
            "its SHA-256: printf %s PASSPHRASE | sha256sum | cut -c1-64",
        )
    return key


def signing_ticks(time_us: int) -> int:
    """Return a signature's time stamp for a time in microseconds of UTC.

    Examples
    --------
    >>> signing_ticks(1_420_070_401_000_000)
    100000
    """
    return max(time_us - _EPOCH_2015_US, 0) // 10


def frame_sizes(rows: Records) -> Integers:
    """Return the size of each frame in bytes, from magic byte to CRC or signature, shape (n,)."""
    head = np.where(rows["flags"] & MAVLINK1, HEAD_V1, HEAD_V2)
    signature = np.where(rows["flags"] & SIGNED, SIGNATURE, 0)
    return head + rows["length"].astype(np.int64) + 2 + signature


class SignatureGuard:
    """Admits frames that are signed with a key, each once.

    A frame has no effect before its signature is verified. Per link, system and component the time
    stamps must increase; the first one of a new stream may be up to a minute older than the newest
    of all streams. A frame must pass this rule twice: with the frames of former sessions and without
    them. A later session without this history therefore admits every frame that this one admits,
    and judges the recording as the session was judged.

    Parameters
    ----------
    key
        32 bytes.
    before
        Time stamp of the newest frame that former sessions admitted, by link, system and component.

    Attributes
    ----------
    newest
        The greatest time stamp that was ever admitted; 0 if there is none.
    unsigned, bad, replayed
        Number of frames refused: without a signature, with a wrong one, and with one whose time
        stamp is not newer than what was admitted before.
    """

    def __init__(self, key: bytes, *, before: Mapping[Stream, int] | None = None) -> None:
        self._before, self._now = _Streams(before or {}), _Streams({})
        self.newest = self._before.newest
        self.unsigned = self.bad = self.replayed = 0
        self._keyed = hashlib.sha256(key)

    @property
    def latest(self) -> dict[Stream, int]:
        """Time stamp of the newest frame that was ever admitted, by link, system and component."""
        return self._before.latest | self._now.latest

    def admit(self, batch: RecordBatch) -> Flags:
        """Return which of a batch's rows are admitted, shape (n,)."""
        rows = batch.rows
        signed = (rows["flags"] & SIGNED) != 0
        self.unsigned += int(np.count_nonzero(~signed))
        starts = batch.places + batch.stamp
        ends = starts + frame_sizes(rows)
        view = batch.data.data
        admitted: Flags = signed
        for k in np.flatnonzero(signed).tolist():
            row = rows[k]
            admitted[k] = self._is_new(view[starts[k] : ends[k]], int(row["system"]), int(row["component"]))
        return admitted

    def _is_new(self, frame: memoryview, system: int, component: int) -> bool:
        digest = self._keyed.copy()
        digest.update(frame[:-_DIGEST_BYTES])
        if not hmac.compare_digest(digest.digest()[:_DIGEST_BYTES], frame[-_DIGEST_BYTES:]):
            self.bad += 1
            return False
        stream = (frame[-SIGNATURE], system, component)
        ticks = int.from_bytes(frame[1 - SIGNATURE : -_DIGEST_BYTES], "little")
        if not (self._before.precede(stream, ticks) and self._now.precede(stream, ticks)):
            self.replayed += 1
            return False
        self._now.take(stream, ticks)
        self.newest = max(self.newest, ticks)
        return True


class _Streams:
    """The newest time stamp of each stream."""

    def __init__(self, latest: Mapping[Stream, int]) -> None:
        self.latest = dict(latest)
        self.newest = max(self.latest.values(), default=0)

    def precede(self, stream: Stream, ticks: int) -> bool:
        """Return whether a time stamp is a new one."""
        return ticks > self.latest.get(stream, self.newest - TICKS_PER_MINUTE - 1)

    def take(self, stream: Stream, ticks: int) -> None:
        self.latest[stream] = ticks
        self.newest = max(self.newest, ticks)
