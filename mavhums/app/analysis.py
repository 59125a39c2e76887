"""Judges a log from disk: feeds the file to the engine, and compares with the aircraft's earlier flights."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Unpack

from mavhums.app.settings import GivenOptions, Options, Settings
from mavhums.app.sinks import Follower, Recording, Report, Sink, sha256_of
from mavhums.core.errors import MavhumsError
from mavhums.core.packed import is_stream
from mavhums.engine.engine import Engine
from mavhums.engine.events import StandaloneAssessment
from mavhums.engine.options import EngineOptions
from mavhums.flights.aircraft import check_same_aircraft, latest
from mavhums.flights.history import FlightHistory, with_duplicate_flights
from mavhums.log import Decoder, read_blocks
from mavhums.vehicle.identity import FLIGHT_MESSAGES, RecordedFlights

if TYPE_CHECKING:
    from mavhums.flights.aircraft_table import Since
    from mavhums.flights.compare import FlightComparison
    from mavhums.results.assessment import Assessment

_BLOCK: Final = 1 << 22  # one or two minutes of flight; a block costs little more than a second
_LONGEST_REASON: Final = 200  # characters of an unexpected error; some quote a whole file

Place = str | os.PathLike[str]
Progress = Callable[[int], None] | None


class Judged(NamedTuple):
    """A log that was judged.

    Attributes
    ----------
    log
        Path of the log.
    assessment
        Its verdicts, compared with the earlier flights.
    alone
        The flight before the comparison; None where it was compared while it was judged, for a sink.
    error
        Why it could not be kept; None if it was, or was not to be.
    """

    log: Path
    assessment: Assessment
    alone: StandaloneAssessment | None = None
    error: MavhumsError | None = None


class Failed(NamedTuple):
    """A log that could not be judged, and why; ``cause`` stays in the process that met it."""

    log: Path
    problem: str
    remedy: str
    cause: Exception | None = None

    @classmethod
    def of(cls, log: Path, cause: Exception) -> Failed:
        """Return the failure that an error means."""
        if isinstance(cause, MavhumsError):
            return cls(log, cause.problem, cause.remedy, cause)
        if isinstance(cause, MemoryError):
            problem = f"{log}: needs more memory than this process may use"
            return cls(log, problem, "judge it with `mavhums analyse`, which sets no limit", cause)
        problem = f"{log}: {type(cause).__name__}: {str(cause)[:_LONGEST_REASON]}"
        return cls(log, problem, "report it with the log, if you may share it", cause)

    @classmethod
    def crashed(cls, log: Path) -> Failed:
        """Return the failure of a log on which its process died."""
        problem = f"{log}: crashed the process that judged it"
        return cls(log, problem, "judge it alone to see why: mavhums analyse LOG --jobs 1")

    @property
    def assessment(self) -> None:
        """None: there is none."""

    @property
    def error(self) -> MavhumsError:
        """The error to show or to raise."""
        return self.cause if isinstance(self.cause, MavhumsError) else MavhumsError(self.problem, self.remedy)


def judge(
    log: Place, settings: Settings, sinks: Sequence[Sink] = (), progress: Progress = None
) -> Judged | Failed:
    """Judge every actuator, axis and motor of a log, in constant memory: every caller's one way.

    It is for a caller that goes on whatever happens: any error is a problem with its remedy.

    Parameters
    ----------
    log
        A log of any format, or ``-`` for the standard input.
    settings
        How it is judged, and the earlier flights that it is compared with.
    sinks
        What it is to leave beside its verdicts.
    progress
        Called with the number of bytes read after each block.

    Examples
    --------
    >>> judge("missing.tlog", Settings.read(None)).problem
    'missing.tlog: no such file'
    """
    path = Path(log)
    try:
        if not sinks:
            alone = analyse_alone(log, settings.engine, progress=progress)
            return Judged(path, compared_with_own(alone, settings), alone)
        if any(sink.draws for sink in sinks):
            settings = settings.with_vehicle_states()
        with ExitStack() as stack:
            followers = [stack.enter_context(sink.follow(path, settings.engine.dialect)) for sink in sinks]
            assessment = _followed(log, settings, followers, progress)
            for follower in followers:
                follower.close(assessment)
        return Judged(path, assessment)
    except Exception as error:
        return Failed.of(path, error)


def analyse(
    path: Place,
    options: Options | Settings | None = None,
    *,
    recording: Place | None = None,
    report: Place | None = None,
    sinks: Sequence[Sink] = (),
    progress: Progress = None,
    **given: Unpack[GivenOptions],
) -> Assessment:
    """Judge every actuator of a log, in constant memory.

    Parameters
    ----------
    path
        A log of any format, or ``-`` for the standard input.
    options
        Profile, model, history and the like; the defaults if None.
    recording
        Path of the Rerun recording to write.
    report
        Path of the HTML report to write.
    sinks
        What it is to leave besides.
    progress
        Called with the number of bytes read after each block.
    given
        Options by name, in place of those of ``options``.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a log.
    ProfileError, ModelError, DialectError, KeyFileError, AircraftTableError
        If the profile, the model, the XML, the key or the table cannot be used.
    OtherAircraftError
        If the history is of another aircraft.
    MavhumsError
        If there is no folder for the history, or an output cannot be written or would replace the log.
    MissingExtraError
        If a recording is wanted and rerun is not installed.

    Examples
    --------
    >>> assessment = analyse("flight.tlog", airframe="paper")
    >>> {verdict.actuator: verdict.condition for verdict in assessment.verdicts}["rudder"]
    'normal'
    """
    named = [kind(place) for kind, place in ((Recording, recording), (Report, report)) if place is not None]
    judged = judge(path, Settings.read(options, **given), [*named, *sinks], progress)
    if isinstance(judged, Failed):
        raise judged.cause or judged.error
    return judged.assessment


def record(assessment: Assessment, path: Place, options: Options | Settings | None = None) -> None:
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
    log, settings = assessment.log, Settings.read(options)
    if log.path is None or sha256_of(log.path, settings.engine.dialect) != log.sha256:
        raise MavhumsError(f"{log.path}: not the log that was judged", "analyse it again")
    analyse(log.path, settings, recording=path)


def analyse_alone(path: Place, options: EngineOptions, *, progress: Progress = None) -> StandaloneAssessment:
    """Judge a log by itself; the errors are those of :func:`analyse`.

    :func:`mavhums.flights.compare.compared` compares the result with earlier flights.

    Examples
    --------
    >>> analyse_alone("flight.tlog", Options(airframe="paper").resolved()).assessment.airframe
    'paper'
    """
    engine = Engine(replace(options, recorded=True))
    digest = _fed(path, engine, options.dialect, progress=progress)
    assessment = engine.assessment(str(path), digest)
    return StandaloneAssessment(assessment, engine.records(), engine.profiles(), options.false_alarms)


def compared_with_own(flight: StandaloneAssessment, settings: Settings) -> Assessment:
    """Return the assessment of a flight that was judged alone, compared with its aircraft's earlier flights.

    Raises
    ------
    OtherAircraftError
        If the history is of another aircraft.
    """
    assessment = with_aircraft_identity(flight.assessment, settings)
    since = latest(settings.since, settings.resolver.since(assessment))
    if not _has_flights(settings):
        return assessment
    from mavhums.flights.compare import compared
    from mavhums.flights.trends import with_standings

    beside = compared(flight._replace(assessment=assessment), *settings.earlier(since))
    return with_standings(beside, settings.history, since)


def _has_flights(settings: Settings) -> bool:
    """Whether there may be earlier flights to compare with."""
    return not isinstance(settings.history, FlightHistory) or bool(settings.history.flights)


def with_aircraft_identity(assessment: Assessment, settings: Settings) -> Assessment:
    """Return the assessment with names of aircraft and with other recordings of its flights.

    Raises
    ------
    OtherAircraftError
        If the history is of another aircraft.
    """
    resolver, history = settings.resolver, settings.history
    return with_duplicate_flights(
        check_same_aircraft(resolver.named(assessment), history, resolver.table), history
    )


def _followed(
    path: Place, settings: Settings, followers: Sequence[Follower], progress: Progress
) -> Assessment:
    """Compare while judging, so that the followers see what the earlier flights change."""
    options, since = settings.engine, latest(settings.since, _swaps(path, settings))
    engine = Engine(options)
    if not _has_flights(settings):
        digest = _fed(path, engine, options.dialect, followers, progress)
        return with_aircraft_identity(engine.assessment(str(path), digest), settings)
    from mavhums.flights.compare import FlightComparison
    from mavhums.flights.trends import with_standings

    comparison = FlightComparison(engine, *settings.earlier(since), options.false_alarms)
    digest = _fed(path, comparison, options.dialect, followers, progress)
    assessment = with_aircraft_identity(comparison.assessment(str(path), digest), settings)
    return with_standings(assessment, settings.history, since)


def _fed(
    path: Place,
    engine: Engine | FlightComparison,
    dialect: Place | None,
    followers: Sequence[Follower] = (),
    progress: Progress = None,
) -> str:
    """Process a log, and return its hash."""
    digest, size = hashlib.sha256(), 0
    for block in read_blocks(path, size=_BLOCK, dialect=dialect):
        digest.update(block)
        size += len(block)
        events = engine.feed(block)
        for follower in followers:
            follower.consume(events)
        if progress:
            progress(size)
    last = engine.finish()
    for follower in followers:
        follower.consume(last)
    return digest.hexdigest()


def _swaps(path: Place, settings: Settings) -> Since:
    """Return when the actuators of a log's aircraft were last swapped, from the messages that identify it."""
    resolver, dialect = settings.resolver, settings.engine.dialect
    if not resolver.table.installed:
        return {}
    if is_stream(path):
        raise MavhumsError(
            f"{path}: an aircraft table needs a file that can be read twice", "save the log first"
        )
    decoder, recorded = Decoder(FLIGHT_MESSAGES, dialect=dialect), RecordedFlights()
    for block in read_blocks(path, dialect=dialect):
        recorded.feed(decoder.feed(block))
    recorded.feed(decoder.feed(b"", final=True))
    if decoder.first_time_us is None or decoder.undated:
        return {}
    start = datetime.fromtimestamp(decoder.first_time_us / 1e6, UTC)
    names = {
        resolver.name(str(path), recorded.of(each).board, start.isoformat()) for each in decoder.vehicles
    }
    return resolver.table.since(names.pop(), start) if len(names) == 1 else {}
