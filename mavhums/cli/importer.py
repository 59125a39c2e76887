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

from mavhums.cli.sniff import HEAD, is_log
from mavhums.core.errors import MavhumsError
from mavhums.core.packed import opened

__all__ = ["main"]

_NOT_OURS: Final = 66
_AIRFRAME: Final = "MAVHUMS_AIRFRAME"


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
    from mavhums.app.options import Options
    from mavhums.show.recording import PipedRecorder

    options = Options(airframe=os.environ.get(_AIRFRAME), vehicle_states=True)
    with PipedRecorder(recording_id=recording_id or path.name) as recorder:
        assessment = analyse(path, options, consume=recorder.consume)
        recorder.close(assessment)


if __name__ == "__main__":
    main()
