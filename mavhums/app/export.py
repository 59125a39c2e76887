"""Writes tables from a log, as Parquet or CSV: V1–V12 of each actuator, messages, or curves."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mavhums.actuator.mapping import MappedSamples, VehicleMappers, messages_for
from mavhums.actuator.profile import Actuator, Airframe, ProfileError, load_airframe
from mavhums.app.analysis import analyse
from mavhums.app.settings import Options, models_of
from mavhums.app.sinks import Events
from mavhums.core.errors import MavhumsError
from mavhums.core.output import TableWriter, writer_for, written_whole
from mavhums.core.packed import is_stream
from mavhums.core.quantities import KEYS
from mavhums.engine.events import Event
from mavhums.health.actuator.votes import answer_samples
from mavhums.health.decision.events import Window
from mavhums.learn import Model
from mavhums.log import Decoder, decode_blocks
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.formats import message_of
from mavhums.vehicle.states import TEXT_MESSAGES

Progress = Callable[[int], None] | None
_OF_WINDOWS = {
    "vehicle": "vehicle",
    "actuator": "actuator",
    "start_s": "start_s",
    "end_s": "end_s",
    "network": "class",
    "probability": "probability",
    "p_fault": "p_fault",
}
"""Fields of a window that are written, and their columns."""
_TYPES = {"class": "string", "probability": "float64", "p_fault": "float64"}
_RANGE_US = (1000, 1500, 2000)
_NAMELESS = Airframe(
    name="none",
    actuators=(
        *(Actuator(name=f"servo_{n}", servo=n, pwm_us=_RANGE_US) for n in range(1, 17)),
        *(Actuator(name=f"esc_{k}", servo=17 + k, esc=k, pwm_us=_RANGE_US) for k in range(16)),
    ),
)
"""A neutral profile: servos by their channel, ESCs by their number, no angles."""


def export_quantities(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    classify: bool = False,
    model: Model | str | Path | None = None,
    progress: Progress = None,
) -> dict[Path, int]:
    """Write V1–V12 of every actuator of a log, in constant memory.

    The columns are ``vehicle``, ``actuator``, ``time`` (UTC), ``flight_time_s`` (seconds since the
    log's first frame) and ``V1`` … ``V12``, empty where unknown; units in
    :data:`mavhums.core.quantities.QUANTITIES`. The rows of one actuator are in time order. Without a
    profile, the second column is ``output``: an ESC may drive a propeller, and then it
    is not a surface's actuator.

    With ``classify`` three more say what the network says of each sample: ``p_emergency``, the most probable
    ``class``, both empty where the sample lacks an input of the network, and ``inside``, whether the sample
    lies within the training range; outside it the network abstains. A second file, ``flight-windows.csv``
    beside ``flight.csv``, has a row for each ten seconds: ``start_s`` and ``end_s`` in flight time, the
    ``class`` (``abstained`` where the network is not sure, ``outside`` its training range, empty where it is
    not asked), its ``probability``, and that of all faults together, ``p_fault``.

    Parameters
    ----------
    path
        A log of any format.
    output
        Path ending in ``.parquet`` or ``.csv``; the file is written whole or not at all.
    airframe
        A profile, its name or its path. If None, each vehicle's own, if the log names it; without a profile,
        the data that need none are written, by servo and by ESC.
    classify
        Whether to add the network's answers.
    model
        The network, its packaged name or its file, for ``classify``. If None, each sample is classified by
        the first packaged one for its airframe whose inputs it carries.
    progress
        Called with the number of bytes read after each block.

    Returns
    -------
    dict
        Number of rows by written file.

    Raises
    ------
    UnreadableLogError
        If the log is missing, or of no known format.
    ProfileError
        If the profile cannot be used, or the log comes from the standard input and names none.
    ModelError
        If the model cannot be used.
    MavhumsError
        If the log contains no data of its actuators, no network covers it, or the file cannot be written.
    MissingExtraError
        If Parquet is wanted and pyarrow is not installed.
    """
    given = None if airframe is None else load_airframe(airframe)
    output = Path(output)
    writer_for(output)
    if classify and is_stream(path):
        raise MavhumsError(f"{path}: --classify needs a file that can be read twice", "save the log first")
    asked = _SampleClassifier(path, models_of(model)) if classify else None
    decoder, fleet, rows = _write(path, output, given, asked, progress)
    if not fleet.airframes:
        if is_stream(path) or asked is not None:
            raise ProfileError(f"{path}: the log names no airframe profile", "name one with --airframe")
        decoder, fleet, rows = _write(path, output, _NAMELESS, None, progress)
    if not rows:
        raise MavhumsError(*_nothing(path, given, fleet, message_of("outputs", decoder.format)))
    return {output: rows} | (_write_windows(path, output, given, asked.models, progress) if asked else {})


def _write_windows(
    path: str | os.PathLike[str],
    output: Path,
    airframe: Airframe | None,
    models: Sequence[Model],
    progress: Progress,
) -> dict[Path, int]:
    """Write what the networks say of each window, by the same engine that judges the flight."""
    file = output.with_name(f"{output.stem}-windows{output.suffix}")
    with suppress(_EmptyError), written_whole(file) as temporary, writer_for(file)(temporary) as table:

        def take(events: Sequence[Event]) -> None:
            windows = [event for event in events if isinstance(event, Window)]
            if windows:
                rows = [[getattr(window, field) for field in _OF_WINDOWS] for window in windows]
                table.write(pd.DataFrame(rows, columns=[*_OF_WINDOWS.values()]).astype(_TYPES))

        analyse(path, Options(airframe=airframe, model=models), sinks=[Events(take)], progress=progress)
        if not table.rows:
            raise _EmptyError
    return {file: table.rows} if table.rows else {}


class _SampleClassifier:
    """The networks that a log's samples are shown to, and what came of it.

    Parameters
    ----------
    path
        The log, for the error.
    models
        Those that may be asked.
    """

    def __init__(self, path: str | os.PathLike[str], models: Sequence[Model]) -> None:
        self._path, self.models = path, models
        self._answered = False
        self._carried: set[str] = set()

    def columns(self, mapped: MappedSamples, airframe: str) -> dict[str, Any]:
        """Return the columns that hold the answers on these samples."""
        serving = [model for model in self.models if model.card.airframe == airframe]
        answers = answer_samples(serving, mapped.values, mapped.measured)
        names = np.array([*answers.classes, None], dtype=object)[answers.said]
        self._answered |= bool((answers.said >= 0).any())
        self._carried |= {KEYS[k] for k in np.flatnonzero(np.isfinite(mapped.values).any(axis=0)).tolist()}
        return {
            "p_emergency": answers.p_emergency,
            "class": pd.array(names, dtype="string"),
            "inside": answers.inside,
        }

    def hold(self, airframes: Sequence[str]) -> None:
        """Raise an error if no sample was classified: three empty columns would look like an answer."""
        if self._answered:
            return
        takes = "; ".join(
            f"{model.card.name} takes {', '.join(model.keys)} of {model.card.airframe}"
            for model in self.models
        )
        has = ", ".join(key for key in KEYS if key in self._carried)
        raise MavhumsError(
            f"{self._path}: no network covers it: it carries {has} of {', '.join(airframes)}, and {takes}",
            "name a model for it with --model, or export without --classify",
        )


def _write(
    path: str | os.PathLike[str],
    output: Path,
    airframe: Airframe | None,
    asked: _SampleClassifier | None,
    progress: Progress,
) -> tuple[Decoder, VehicleMappers, int]:
    """Write the table of a log by a profile; return decoder, vehicles and rows written; no rows, no file."""
    decoder = Decoder(messages_for(airframe.actuators if airframe else ()) | TEXT_MESSAGES)
    fleet, clocks = VehicleMappers(airframe), Clocks()
    with suppress(_EmptyError), written_whole(output) as temporary, writer_for(output)(temporary) as table:
        for tables, _, final in decode_blocks(path, decoder, progress=progress):
            timed = clocks.feed(tables)
            for _ in fleet.listen(timed):
                pass
            for mapper, mapped in fleet.feed(timed, final=final):
                if mapped.utc_us.size:
                    answers = asked.columns(mapped, mapper.airframe.name) if asked else {}
                    frame = _rows(mapped, decoder.first_time_us or 0, named=airframe is not _NAMELESS)
                    table.write(frame.assign(**answers))
        if not table.rows:
            raise _EmptyError
        if asked:
            asked.hold(fleet.airframes)
    return decoder, fleet, table.rows


def export_curves(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    progress: Progress = None,
) -> dict[Path, int]:
    """Write the curves behind a log's verdicts as the report draws them, thinned to their extremes.

    The columns are ``curve``, its title; ``time_s`` in flight time; ``low``, ``value`` and ``high`` of its
    95 % interval; ``demanded``, what the value is compared with, and ``limits``, in words.

    Parameters
    ----------
    path, output, airframe, progress
        As in :func:`export_quantities`.

    Returns
    -------
    dict
        Number of rows by written file.

    Raises
    ------
    UnreadableLogError, ProfileError, MissingExtraError
        As in :func:`export_quantities`.
    MavhumsError
        If nothing of the log was judged, or the file cannot be written.
    """
    from mavhums.show.curves import EvidenceCollector
    from mavhums.show.evidence import evidence
    from mavhums.show.html_plot import curve_table, flight_charts

    output, gathered = Path(output), EvidenceCollector()
    with written_whole(output) as temporary, writer_for(output)(temporary) as table:
        events = Events(gathered.consume, draws=True)
        assessment = analyse(path, Options(airframe=airframe), sinks=[events], progress=progress)
        shown = evidence(assessment, gathered)
        drawn = flight_charts(shown, assessment.log.duration_s)["charts"]
        if not drawn:
            raise MavhumsError(f"{path}: no curves: nothing in it is judged", f"see: mavhums analyse {path}")
        table.write(curve_table(drawn))
    return {output: table.rows}


class _EmptyError(Exception):
    """The table would be empty."""


def _nothing(
    path: str | os.PathLike[str], airframe: Airframe | None, fleet: VehicleMappers, message: str
) -> tuple[str, str]:
    """Return why nothing of a log was written, and what could be; ``message`` carries its pulses."""
    pulses = f"or write its pulses as they are: --messages {message}"
    if airframe is None and fleet.airframes == ["none"]:
        remedy = f"name a profile with --airframe, {pulses}"
        return f"{path}: names no airframe profile, and carries no V1–V12 without one", remedy
    if airframe is not None and all(actuator.travel_deg is None for actuator in airframe.actuators):
        problem = f"{path}: the profile {airframe.name} has no travel_deg, without which a pulse has no angle"
        return problem, f"fill it in, {pulses}"
    problem = f"{path}: contains no telemetry of the actuators of {', '.join(fleet.airframes)}"
    return problem, f"list its contents with: mavhums inspect {path}"


def export_messages(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    names: Sequence[str],
    *,
    progress: Progress = None,
) -> dict[Path, int]:
    """Write messages of a log, in constant memory.

    One message type goes to ``output``. Several go to one file each, named by ``output`` with the message's
    name appended: ``flight.csv`` becomes ``flight-ATTITUDE.csv``. The columns are ``time`` (of
    reception, UTC), ``system``, ``component``, ``sequence`` and the message's fields; an array field of
    k elements becomes k columns. Rows are in the order of the log.

    Parameters
    ----------
    path, output, progress
        As in :func:`export_quantities`.
    names
        Names of the messages in the format; case is ignored.

    Returns
    -------
    dict
        Number of rows by written file.

    Raises
    ------
    UnreadableLogError, MissingExtraError
        As in :func:`export_quantities`.
    MavhumsError
        If a message is not in the log, or a file cannot be written.
    """
    output = Path(output)
    writer = writer_for(output)
    names = list({name.upper(): name for name in names}.values())
    if not names:
        raise MavhumsError("no message is named", f"list its contents: mavhums inspect {path}")
    decoder = Decoder({form for name in names for form in (name, name.upper(), name.lower())})
    files: dict[str, Path] = {}
    writers: dict[str, TableWriter] = {}
    with ExitStack() as stack:
        for tables, _, _ in decode_blocks(path, decoder, progress=progress):
            for name, table in tables.items():
                wanted = name.upper()
                if wanted not in writers:
                    files[wanted] = (
                        output
                        if len(names) == 1
                        else output.with_name(f"{output.stem}-{name}{output.suffix}")
                    )
                    file = stack.enter_context(written_whole(files[wanted]))
                    writers[wanted] = stack.enter_context(writer(file))
                writers[wanted].write(table.to_frame().reset_index())
        for name in names:
            if name.upper() not in writers:
                raise _absent(path, name, {there for _, _, there in decoder.counts})
    return {files[name.upper()]: writers[name.upper()].rows for name in names}


def _rows(mapped: MappedSamples, first_time_us: int, *, named: bool) -> pd.DataFrame:
    frame = pd.DataFrame(mapped.values, columns=list(KEYS))
    frame.insert(0, "vehicle", mapped.vehicle)
    frame.insert(1, "actuator" if named else "output", mapped.actuator.name)
    frame.insert(2, "time", pd.DatetimeIndex(mapped.utc_us.astype("datetime64[us]"), tz="UTC"))
    frame.insert(3, "flight_time_s", (mapped.utc_us - first_time_us) / 1e6)
    return frame


def _absent(path: str | os.PathLike[str], name: str, there: set[str]) -> MavhumsError:
    close = get_close_matches(name, sorted(there), n=3) or get_close_matches(name.upper(), sorted(there), n=3)
    remedy = f"did you mean {' or '.join(close)}?" if close else f"list its contents: mavhums inspect {path}"
    return MavhumsError(f"{path}: contains no message {name}", remedy)
