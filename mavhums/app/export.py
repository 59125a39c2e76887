"""Write what a log holds as tables: V1–V12 of each actuator, or messages; Parquet or CSV."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from difflib import get_close_matches
from pathlib import Path

import pandas as pd

from mavhums.actuator.mapping import Mapped, messages_for
from mavhums.actuator.profile import Airframe, ProfileError, load_airframe, packaged_airframes
from mavhums.actuator.vehicle_mappers import VehicleMappers
from mavhums.core.errors import MavhumsError
from mavhums.core.files import written_whole
from mavhums.core.quantities import KEYS
from mavhums.core.table_writers import TableWriter, writer_for
from mavhums.log import Decoder, decode_blocks

__all__ = ["export_messages", "export_quantities"]

Progress = Callable[[int], None] | None


def export_quantities(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    progress: Progress = None,
) -> dict[Path, int]:
    """Write V1–V12 of every actuator of a log, in memory that does not grow with it.

    The columns are ``vehicle``, ``actuator``, ``time`` (UTC), ``flight_time_s`` (seconds since the
    log's first frame) and ``V1`` … ``V12``, empty where not known; units in
    :data:`mavhums.core.quantities.QUANTITIES`. Rows of one actuator are in the order of time.

    Parameters
    ----------
    path
        A ``.tlog`` file.
    output
        Ends in ``.parquet`` or ``.csv``; it appears whole or not at all.
    airframe
        A profile, its name or its path; if None, each vehicle's own, if the log names it.
    progress
        Called with the number of bytes read after each block.

    Returns
    -------
    dict
        Number of rows by file written.

    Raises
    ------
    UnreadableLogError
        If the log is missing or not a telemetry log.
    ProfileError
        If there is no profile, or it cannot be used.
    MavhumsError
        If the log carries nothing of its actuators, or the file cannot be written.
    MissingExtraError
        If Parquet is wanted and pyarrow is not installed.
    """
    given = airframe if isinstance(airframe, Airframe) or airframe is None else load_airframe(airframe)
    output = Path(output)
    writer = writer_for(output)
    decoder = Decoder(messages_for(given.actuators if given else ()) | {"STATUSTEXT"})
    fleet = VehicleMappers(given)
    with written_whole(output) as temporary, writer(temporary) as table:
        for tables, size, final in decode_blocks(path, decoder):
            for _ in fleet.listen(tables):
                pass
            for _, mapped in fleet.feed(tables, final=final):
                if mapped.utc_us.size:
                    table.write(_rows(mapped, decoder.first_time_us or 0))
            if progress:
                progress(size)
        if not fleet.airframes:
            known = ", ".join(packaged_airframes())
            remedy = f"name one with --airframe (a TOML file, or one of: {known})"
            raise ProfileError(f"{path}: the log names no airframe profile", remedy)
        if not table.rows:
            problem = f"{path}: carries nothing of the actuators of {', '.join(fleet.airframes)}"
            raise MavhumsError(problem, f"see what it holds with: mavhums inspect {path}")
    return {output: table.rows}


def export_messages(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    names: Sequence[str],
    *,
    progress: Progress = None,
) -> dict[Path, int]:
    """Write messages of a log, in memory that does not grow with it.

    One message goes to ``output``, several to a file each, whose name ``output`` gets the message's
    name appended: ``flight.csv`` becomes ``flight-ATTITUDE.csv``. The columns are ``time`` (of
    reception, UTC), ``system``, ``component``, ``sequence`` and the message's fields; an array field of
    k elements becomes k columns. Rows are in the order of the log.

    Parameters
    ----------
    path
        A ``.tlog`` file.
    output
        Ends in ``.parquet`` or ``.csv``; files appear whole or not at all.
    names
        Of the messages, as in the MAVLink definition.
    progress
        Called with the number of bytes read after each block.

    Returns
    -------
    dict
        Number of rows by file written.

    Raises
    ------
    UnreadableLogError
        If the log is missing or not a telemetry log.
    MavhumsError
        If a message is not in the log, or a file cannot be written.
    MissingExtraError
        If Parquet is wanted and pyarrow is not installed.
    """
    output = Path(output)
    writer = writer_for(output)
    names = list(dict.fromkeys(name.upper() for name in names))
    if not names:
        raise MavhumsError("no message is named", f"see what the log holds: mavhums inspect {path}")
    files = {name: output if len(names) == 1 else _beside(output, name) for name in names}
    decoder = Decoder(names)
    with ExitStack() as stack:
        writers: dict[str, TableWriter] = {}
        for name, file in files.items():
            writers[name] = stack.enter_context(writer(stack.enter_context(written_whole(file))))
        for tables, size, _ in decode_blocks(path, decoder):
            for name, table in tables.items():
                writers[name].write(table.to_frame().reset_index())
            if progress:
                progress(size)
        for name in names:
            if not writers[name].rows:
                raise _absent(path, name, {there for _, _, there in decoder.counts})
    return {files[name]: writers[name].rows for name in names}


def _rows(mapped: Mapped, first_time_us: int) -> pd.DataFrame:
    frame = pd.DataFrame(mapped.values, columns=list(KEYS))
    frame.insert(0, "vehicle", mapped.vehicle)
    frame.insert(1, "actuator", mapped.actuator.name)
    frame.insert(2, "time", pd.DatetimeIndex(mapped.utc_us.astype("datetime64[us]"), tz="UTC"))
    frame.insert(3, "flight_time_s", (mapped.utc_us - first_time_us) / 1e6)
    return frame


def _beside(output: Path, name: str) -> Path:
    return output.with_name(f"{output.stem}-{name}{output.suffix}")


def _absent(path: str | os.PathLike[str], name: str, there: set[str]) -> MavhumsError:
    close = get_close_matches(name, sorted(there), n=3)
    remedy = f"did you mean {' or '.join(close)}?" if close else f"see what it holds: mavhums inspect {path}"
    return MavhumsError(f"{path}: holds no message {name}", remedy)
