"""Judge a log from disk: the engine fed from a file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.core.errors import MavhumsError
from mavhums.engine.engine import Engine
from mavhums.engine.events import Event
from mavhums.health.decision import FALSE_ALARMS
from mavhums.history.files import read_history
from mavhums.history.flights import FlightHistory, Since
from mavhums.learn import Model, load_model, packaged_models
from mavhums.log import read_blocks
from mavhums.log.mavlink.signing import load_key
from mavhums.report.assessment import Assessment

__all__ = ["analyse", "record"]

_BLOCK = 1 << 22  # a minute or two of flight: judging a block costs little more than judging a second


def analyse(
    path: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    model: Model | Sequence[Model] | str | Path | None = None,
    history: FlightHistory | str | os.PathLike[str] | None = None,
    since: Since | None = None,
    false_alarms: float = FALSE_ALARMS,
    dialect: str | os.PathLike[str] | None = None,
    key: bytes | str | os.PathLike[str] | None = None,
    recording: str | os.PathLike[str] | None = None,
    position: bool = True,
    vehicle_states: bool = False,
    consume: Callable[[Sequence[Event]], None] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Assessment:
    """Judge every actuator of a log, in memory that does not grow with it.

    Parameters
    ----------
    path
        A ``.tlog`` file.
    airframe
        A profile, its name or its path; if None, the one that the log names itself.
    model
        A model or its file, or several models; if None, those that ship with mavhums.
    history
        The flights before, or their folder (:func:`mavhums.history.files.read_history`): they give each
        actuator its own baseline.
    since
        Dates from which they count, by actuator; None as the name of all others.
    false_alarms
        How many false alarms 100 hours of an actuator may bring.
    dialect
        A MAVLink XML file whose definitions go before the shipped ones.
    key
        A MAVLink 2 signing key of 32 bytes, or its file: only frames signed with it count.
    recording
        Where to write a Rerun recording on the way.
    position
        Whether the recording may say where the aircraft was.
    vehicle_states
        Whether ``consume`` gets attitude, position and flight mode as well.
    consume
        Called with the engine's events after each block.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a telemetry log.
    ProfileError, ModelError, DialectError, KeyFileError
        If the profile, the model, the XML or the key cannot be used.
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
    profile = airframe if isinstance(airframe, Airframe) or airframe is None else load_airframe(airframe)
    models = _models(model)
    if not isinstance(history, FlightHistory):
        history = FlightHistory() if history is None else read_history(history)
    if key is not None and not isinstance(key, bytes):
        key = load_key(key)
    if recording is not None:
        if str(path) == "-":
            raise MavhumsError("-: a recording needs a file that can be read twice", "save the log first")
        from mavhums.show import Recorder

        identity = f"{Path(path).name}-{_sha256(path, dialect)[:16]}"
        with Recorder(recording, recording_id=identity, position=position) as recorder:

            def both(events: Sequence[Event]) -> None:
                recorder.consume(events)
                if consume:
                    consume(events)

            assessment = analyse(
                path,
                airframe=profile,
                model=models,
                history=history,
                since=since,
                false_alarms=false_alarms,
                dialect=dialect,
                key=key,
                vehicle_states=True,
                consume=both,
                progress=progress,
            )
            recorder.close(assessment)
        return assessment
    baselines = partial(history.baselines, since=since)
    engine = Engine(
        profile,
        model=models,
        baselines=baselines,
        past=partial(history.past, since=since),
        false_alarms=false_alarms,
        dialect=dialect,
        key=key,
        vehicle_states=vehicle_states,
    )
    digest, size = hashlib.sha256(), 0
    for block in read_blocks(path, size=_BLOCK, dialect=dialect):
        digest.update(block)
        size += len(block)
        events = engine.feed(block)
        if consume:
            consume(events)
        if progress:
            progress(size)
    last = engine.finish()
    if consume:
        consume(last)
    return engine.assessment(str(path), digest.hexdigest())


def record(
    assessment: Assessment,
    path: str | os.PathLike[str],
    *,
    airframe: Airframe | str | Path | None = None,
    model: Model | Sequence[Model] | str | Path | None = None,
    history: FlightHistory | str | os.PathLike[str] | None = None,
    since: Since | None = None,
    false_alarms: float = FALSE_ALARMS,
    dialect: str | os.PathLike[str] | None = None,
    key: bytes | str | os.PathLike[str] | None = None,
) -> None:
    """Write the Rerun recording of an assessment, reading its log once more.

    Give the ``airframe``, ``model``, ``history``, ``false_alarms``, ``dialect`` and ``key`` that the
    assessment was made with.

    Raises
    ------
    MavhumsError
        If the log is no longer the one that was judged.

    Examples
    --------
    >>> record(analyse("flight.tlog"), "flight.rrd")
    """
    log = assessment.log
    if log.path is None or _sha256(log.path, dialect) != log.sha256:
        raise MavhumsError(f"{log.path}: not the log that was judged", "analyse it again")
    analyse(
        log.path,
        airframe=airframe,
        model=model,
        history=history,
        since=since,
        false_alarms=false_alarms,
        dialect=dialect,
        key=key,
        recording=path,
    )


def _models(given: Model | Sequence[Model] | str | Path | None) -> Sequence[Model]:
    if given is None:
        return packaged_models()
    if isinstance(given, str | Path):
        return (load_model(given),)
    return (given,) if isinstance(given, Model) else given


def _sha256(path: str | os.PathLike[str], dialect: str | os.PathLike[str] | None) -> str:
    digest = hashlib.sha256()
    for block in read_blocks(path, dialect=dialect):
        digest.update(block)
    return digest.hexdigest()
