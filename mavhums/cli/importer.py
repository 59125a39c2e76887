"""``rerun flight.tlog``: the importer that the Rerun viewer runs for every file it opens.

The viewer calls ``rerun-importer-mavhums FILE --application-id … --recording-id …`` and reads the recording
from its standard output. For any other file the importer must answer fast: exit code 66.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Final

from mavhums.core.errors import MavhumsError
from mavhums.core.packed import opened
from mavhums.log.formats import SIGNATURES

_NOT_OURS: Final = 66
_AIRFRAME: Final = "MAVHUMS_AIRFRAME"

HEAD: Final = 1 << 16
"""Bytes that are enough to tell."""

_STAMP: Final = 8
_CHAIN, _FEW = 6, 2
_OVERHEAD: Final = {0xFE: 8, 0xFD: 12}
_SIGNATURE: Final = 13


def main() -> None:
    """Write the recording of a telemetry log to the standard output."""
    path, recording_id = _arguments()
    try:
        with opened(path) as file:
            ours = is_log(file.read(HEAD))
    except (OSError, MavhumsError):
        ours = False
    if not ours:
        sys.exit(_NOT_OURS)
    try:
        _import(path, recording_id)
    except MavhumsError as error:
        print(f"mavhums: {error.problem}" + (f"; {error.remedy}" if error.remedy else ""), file=sys.stderr)
        sys.exit(1)


def _arguments() -> tuple[Path, str | None]:
    parser = argparse.ArgumentParser(
        prog="rerun-importer-mavhums",
        description="Show an aircraft's log in the Rerun viewer: rerun flight.tlog, flight.BIN, flight.ulg",
        epilog=f"{_AIRFRAME}: airframe profile (a TOML file or a packaged name) for logs that name none.",
    )
    parser.add_argument("file", type=Path, help="the log; other files are refused with exit code 66")
    parser.add_argument("--recording-id", help="what the viewer wants the recording to be called")
    known, _ = parser.parse_known_args()
    return known.file, known.recording_id


def _import(path: Path, recording_id: str | None) -> None:
    from mavhums.app.analysis import analyse
    from mavhums.app.sinks import Events
    from mavhums.show.viewer import Recorder

    with Recorder(None, recording_id=recording_id or path.name) as recorder:
        assessment = analyse(
            path, airframe=os.environ.get(_AIRFRAME), sinks=[Events(recorder.consume, draws=True)]
        )
        recorder.close(assessment)


def is_log(head: bytes) -> bool:
    """Return whether a file that begins with ``head`` is a log that mavhums reads.

    It is a MAVLink telemetry log if six consecutive frames occur somewhere in it, all with a time
    stamp or all without, or if it consists of only a few frames. A damaged start does not matter. An
    on-board log begins with its signature.

    Examples
    --------
    >>> heartbeat = bytes(8) + b"\\xfe\\x09" + bytes(15)
    >>> is_log(6 * heartbeat), is_log(b"{}"), is_log(b"")
    (True, False, False)
    """
    return head.startswith(SIGNATURES) or any(_chained(head, stamp) for stamp in (_STAMP, 0))


def _chained(head: bytes, stamp: int) -> bool:
    lines: dict[
        int, tuple[int, int]
    ] = {}  # by offset of the next frame: number of frames so far, and the first offset
    for magic in range(stamp, len(head) - 2):
        overhead = _OVERHEAD.get(head[magic])
        if overhead is None:
            continue
        signed = head[magic] == 0xFD and head[magic + 2] & 1
        end = magic + head[magic + 1] + overhead + (_SIGNATURE if signed else 0)
        count, start = lines.pop(magic - stamp, (0, magic - stamp))
        count += 1
        if count >= _CHAIN or (count >= _FEW and start == 0 and end == len(head)):
            return True
        if count > lines.get(end, (0, 0))[0]:
            lines[end] = count, start
    return False


if __name__ == "__main__":
    main()
