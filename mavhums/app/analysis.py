"""Judges logs from disk: feeds files to the engine, and compares with the aircraft's earlier flights."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, closing, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple, Unpack

from mavhums.app.settings import GivenOptions, Options, Settings
from mavhums.app.sinks import Follower, Place, Recording, Report, Sink, sha256_of
from mavhums.core.errors import MavhumsError
from mavhums.core.packed import is_stream
from mavhums.engine.engine import Engine
from mavhums.engine.events import StandaloneAssessment
from mavhums.engine.options import EngineOptions
from mavhums.log import read_blocks
from mavhums.results.assessment import Assessment

_BLOCK: Final = 1 << 22  # one or two minutes of flight; a block costs little more than a second
_LONGEST_REASON: Final = 200  # characters of an unexpected error; some quote a whole file

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
        The flight before the comparison.
    error
        Why it could not be kept; None if it was, or was not to be.
    kept
        Whether the store has it as it was judged now: of a copy it keeps the log that it has.
    """

    log: Path
    assessment: Assessment
    alone: StandaloneAssessment
    error: MavhumsError | None = None
    kept: bool = False


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
    def kept(self) -> bool:
        """False: it is not."""
        return False

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
        How it is judged, the earlier flights that it is compared with, and whether it is kept among them.
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
        if settings.keep and is_stream(log):
            raise MavhumsError(f"{log}: a store names logs by their files", "save the log first")
        draws = any(sink.draws for sink in sinks)
        options = settings.with_vehicle_states().engine if draws else settings.engine
        with ExitStack() as stack:
            followers = [stack.enter_context(sink.follow(path, options.dialect)) for sink in sinks]
            judged = among_own(path, analyse_alone(log, options, followers, progress=progress), settings)
            for follower in followers:
                follower.close(judged.assessment)
        return judged
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
        Profile, model, store and the like; the defaults if None.
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
    UnnamedAircraftError
        If it is to be kept, and nothing but a guess names its aircraft.
    MavhumsError
        If the store cannot be read or written, or an output cannot be written or would replace the log.
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
    if judged.error is not None:
        raise judged.error
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


def analyse_alone(
    path: Place, options: EngineOptions, followers: Sequence[Follower] = (), *, progress: Progress = None
) -> StandaloneAssessment:
    """Judge a log by itself; the errors are those of :func:`analyse`.

    :func:`mavhums.flights.compare.compared` compares the result with earlier flights.

    Examples
    --------
    >>> analyse_alone("flight.tlog", Options(airframe="paper").resolved()).assessment.airframe
    'paper'
    """
    engine, digest, size = Engine(options), hashlib.sha256(), 0
    for block in read_blocks(path, size=_BLOCK, dialect=options.dialect):
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
    assessment = engine.assessment(str(path), digest.hexdigest())
    return StandaloneAssessment(assessment, engine.profiles(), options.false_alarms)


def among_own(log: Path, alone: StandaloneAssessment, settings: Settings) -> Judged:
    """Compare a flight with its aircraft's earlier ones, and keep it among them if that is wanted."""
    if settings.store is None:
        return Judged(log, settings.resolver.named(alone.assessment), alone)
    from mavhums.flights.landing import OwnFlights, land
    from mavhums.flights.store import LogFile

    landed = False
    if settings.keep:
        file = LogFile.at(log.absolute())
        try:
            landed = land(settings.store, alone, file, settings.fingerprint(), settings.resolver)
        except MavhumsError as error:
            return Judged(log, settings.resolver.named(alone.assessment), alone, error)
    own = OwnFlights(settings.store, alone.assessment, settings.resolver)
    return Judged(log, own.kept(alone) if landed else own.compared(alone), alone, kept=landed)


_WORTH_BYTES: Final = 64 << 20  # fewer are judged in the time that processes need to start


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """How many logs are judged together.

    Attributes
    ----------
    jobs
        Number of processes; None for all cores, or for one if the logs are few or small. What logs leave is
        written by one.
    sinks
        What a log is to leave beside its verdicts, by log.
    progress
        Returns a context for a log, in which one process reports the number of bytes read.
    """

    jobs: int | None = None
    sinks: Mapping[Path, Sequence[Sink]] = field(default_factory=dict)
    progress: Callable[[Path], AbstractContextManager[Progress]] = lambda _: nullcontext()


def analyse_many(
    logs: Sequence[str | os.PathLike[str]],
    options: Options | Settings | None = None,
    batch: Batch | None = None,
) -> Iterator[Judged | Failed]:
    """Judge logs, and yield each outcome as it comes, in the order of the logs.

    The verdicts are those of :func:`mavhums.analyse` on one log after the other. A log that cannot be judged,
    and one on which its process dies, is an outcome with an error. Several processes import the calling
    script, which must therefore begin its work under ``if __name__ == "__main__"``.

    Parameters
    ----------
    logs
        Paths of the logs, the oldest first.
    options
        Options of each judgement; the defaults if None.
    batch
        Number of processes, sinks and the like; the defaults if None.

    Raises
    ------
    ProfileError, ModelError, DialectError, KeyFileError, MavhumsError
        If the options cannot be used.

    Examples
    --------
    >>> import mavhums
    >>> for outcome in mavhums.analyse_many(["flight.tlog"]):
    ...     print(outcome.log, outcome.assessment.exit_code.name)
    flight.tlog EMERGENCY
    """
    settings, batch, paths = Settings.read(options), batch or Batch(), [Path(log) for log in logs]
    jobs = 1 if batch.sinks else min(batch.jobs or _jobs(paths), len(paths))
    alone = _by_processes(paths, settings, jobs, batch) if jobs > 1 else None
    with closing(alone) if alone is not None else nullcontext():
        for log in paths:
            judged = _one(log, settings, batch) if alone is None else _compared(next(alone), settings)
            cause = judged.cause if isinstance(judged, Failed) else None
            if len(paths) == 1 and cause is not None and not isinstance(cause, MavhumsError):
                raise cause  # nothing else waits to be judged, and a traceback shows where
            yield judged


def _jobs(logs: Sequence[Path]) -> int:
    """Return the number of processes that judge the logs soonest."""
    try:
        if sum(log.stat().st_size for log in logs) < _WORTH_BYTES:
            return 1
    except OSError:  # an outcome later on
        pass
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _one(log: Path, settings: Settings, batch: Batch) -> Judged | Failed:
    with batch.progress(log) as progress:
        return judge(log, settings, batch.sinks.get(log, ()), progress)


def _by_processes(
    logs: Sequence[Path], settings: Settings, jobs: int, batch: Batch
) -> Generator[Judged | Failed]:
    """Yield each log judged without the earlier flights, which only this process has."""
    from mavhums.core.process_pool import LostItem, in_processes  # one log needs no pool

    alone = partial(_without_cause, settings.alone())
    flights = in_processes(alone, logs, jobs, preload=["mavhums.app.analysis"])
    with closing(flights):
        for log, judged in zip(logs, flights, strict=True):
            yield Failed.crashed(log) if isinstance(judged, LostItem) else judged


def _without_cause(settings: Settings, log: Path) -> Judged | Failed:
    """Judge a log in another process; not every exception can be sent."""
    judged = judge(log, settings)
    return judged._replace(cause=None) if isinstance(judged, Failed) else judged


def _compared(judged: Judged | Failed, settings: Settings) -> Judged | Failed:
    """Compare a flight that another process has judged with the earlier flights."""
    if isinstance(judged, Failed):
        return judged
    try:
        return among_own(judged.log, judged.alone, settings)
    except MavhumsError as error:
        return Failed.of(judged.log, error)
