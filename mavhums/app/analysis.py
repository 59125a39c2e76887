"""Judges a log from disk: feeds the file to the engine."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from mavhums.app.options import Options
from mavhums.app.own_flights import among_own, compared_with_own, swapped
from mavhums.core.errors import MavhumsError
from mavhums.engine.engine import Engine
from mavhums.engine.events import Event
from mavhums.engine.options import EngineOptions
from mavhums.flights.aircraft import latest
from mavhums.flights.compare import LoneFlight
from mavhums.log import read_blocks
from mavhums.report.assessment import Assessment

__all__ = ["analyse", "analyse_alone", "record"]

_BLOCK = 1 << 22  # one or two minutes of flight; a block costs little more than a second

Consumer = Callable[[Sequence[Event]], None]


def analyse(
    path: str | os.PathLike[str],
    options: Options | None = None,
    *,
    recording: str | os.PathLike[str] | None = None,
    position: bool = True,
    consume: Consumer | None = None,
    progress: Callable[[int], None] | None = None,
) -> Assessment:
    """Judge every actuator of a log, in constant memory.

    Parameters
    ----------
    path
        A ``.tlog`` file.
    options
        Profile, model, history and the like; the defaults if None.
    recording
        Path of the Rerun recording to write.
    position
        Whether the recording contains the aircraft's position.
    consume
        Called with the engine's events after each block.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a telemetry log.
    ProfileError, ModelError, DialectError, KeyFileError, AircraftTableError
        If the profile, the model, the XML, the key or the table cannot be used.
    OtherAircraftError
        If the history is of another aircraft.
    MavhumsError
        If there is no folder for the history.
    MissingExtraError
        If a recording is wanted and rerun is not installed.

    Examples
    --------
    >>> assessment = analyse("flight.tlog")
    >>> {verdict.actuator: verdict.condition for verdict in assessment.verdicts}["rudder"]
    'normal'
    """
    options = options or Options()
    options = replace(options, history=options.flights(), aircraft_table=options.whose().table)
    consumers = [consume] if consume else []
    if recording is None:
        return _judge(path, options, consumers, progress)
    if str(path) == "-":
        raise MavhumsError("-: a recording needs a file that can be read twice", "save the log first")
    from mavhums.show import Recorder

    identity = f"{Path(path).name}-{_sha256(path, options.dialect)[:16]}"
    with Recorder(recording, recording_id=identity, position=position) as recorder:
        shown = replace(options, vehicle_states=True)
        assessment = _judge(path, shown, [recorder.consume, *consumers], progress)
        recorder.close(assessment)
    return assessment


def record(assessment: Assessment, path: str | os.PathLike[str], options: Options | None = None) -> None:
    """Write the Rerun recording of an assessment, reading its log once more.

    Parameters
    ----------
    assessment
        From :func:`analyse`.
    path
        The recording.
    options
        The options of the assessment.

    Raises
    ------
    MavhumsError
        If the log is no longer the one that was judged.

    Examples
    --------
    >>> record(analyse("flight.tlog"), "flight.rrd")
    """
    log = assessment.log
    options = options or Options()
    if log.path is None or _sha256(log.path, options.dialect) != log.sha256:
        raise MavhumsError(f"{log.path}: not the log that was judged", "analyse it again")
    analyse(log.path, options, recording=path)


def analyse_alone(
    path: str | os.PathLike[str],
    options: EngineOptions,
    *,
    progress: Callable[[int], None] | None = None,
) -> LoneFlight:
    """Judge a log by itself, whatever baselines the options have; the errors are those of :func:`analyse`.

    :func:`mavhums.flights.compare.compared` compares the result with earlier flights.

    Examples
    --------
    >>> from mavhums.flights.compare import compared
    >>> flight = analyse_alone("flight.tlog", Options(airframe="paper").resolved())
    >>> compared(flight, {}) == flight.assessment
    True
    """
    engine, digest = _fed(path, replace(options, baselines={}, past=None, recorded=True), (), progress)
    assessment = engine.assessment(str(path), digest)
    return LoneFlight(assessment, engine.records(), engine.profiles(), options.false_alarms)


def _judge(
    path: str | os.PathLike[str],
    options: Options,
    consumers: Sequence[Consumer],
    progress: Callable[[int], None] | None,
) -> Assessment:
    """Judge alone, then compare with the past; with consumers, use the past while judging."""
    if not consumers:
        return compared_with_own(analyse_alone(path, options.resolved(), progress=progress), options)
    since = latest(options.since, swapped(path, options))
    engine, digest = _fed(path, replace(options, since=since).resolved(), consumers, progress)
    return among_own(engine.assessment(str(path), digest), options)


def _fed(
    path: str | os.PathLike[str],
    options: EngineOptions,
    consumers: Sequence[Consumer],
    progress: Callable[[int], None] | None,
) -> tuple[Engine, str]:
    """Return an engine that has processed a log, and the log's hash."""
    engine = Engine(options)
    digest, size = hashlib.sha256(), 0
    for block in read_blocks(path, size=_BLOCK, dialect=options.dialect):
        digest.update(block)
        size += len(block)
        events = engine.feed(block)
        for consume in consumers:
            consume(events)
        if progress:
            progress(size)
    last = engine.finish()
    for consume in consumers:
        consume(last)
    return engine, digest.hexdigest()


def _sha256(path: str | os.PathLike[str], dialect: str | os.PathLike[str] | None) -> str:
    digest = hashlib.sha256()
    for block in read_blocks(path, dialect=dialect):
        digest.update(block)
    return digest.hexdigest()
