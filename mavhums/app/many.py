"""Judges many logs on several cores; the results come in the order of the logs, and memory stays flat."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple

from mavhums.app.analysis import analyse, analyse_alone
from mavhums.app.options import Options
from mavhums.app.own_flights import compared_with_own
from mavhums.app.processes import Crashed, in_processes
from mavhums.core.errors import MavhumsError
from mavhums.engine.options import EngineOptions
from mavhums.flights.compare import LoneFlight
from mavhums.flights.stores.folder import keep_assessment
from mavhums.report.assessment import Assessment

__all__ = ["Batch", "Outcome", "analyse_many"]

_WORTH_BYTES: Final = 64 << 20  # fewer are judged in the time that processes need to start

Progress = Callable[[Path], AbstractContextManager[Callable[[int], None] | None]]
_Judged = Callable[[Options], Assessment]


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """How many logs are judged together.

    Attributes
    ----------
    jobs
        Number of processes; None for all cores, or for one if the logs are few or small. Recordings are
        written by one.
    keep
        Folder that each assessment is written into, so that the flight is one of those before the next log.
    recordings
        Path of a log's Rerun recording, by log.
    position
        Whether recordings contain the aircraft's position.
    progress
        Returns a context for a log, in which one process reports the number of bytes read.
    prepare
        Called in each process before its first log.
    """

    jobs: int | None = None
    keep: str | os.PathLike[str] | None = None
    recordings: Mapping[Path, Path] = field(default_factory=dict)
    position: bool = True
    progress: Progress = lambda _: nullcontext()
    prepare: Callable[[], None] | None = None


class Outcome(NamedTuple):
    """A log with its assessment, or with the error why there is none; with both if it could not be kept."""

    log: Path
    assessment: Assessment | None
    error: MavhumsError | None


def analyse_many(
    logs: Sequence[str | os.PathLike[str]], options: Options | None = None, batch: Batch | None = None
) -> Iterator[Outcome]:
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
        Number of processes, recordings and the like; the defaults if None.

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
    options, batch, paths = options or Options(), batch or Batch(), [Path(log) for log in logs]
    options = replace(options, history=options.flights(), aircraft_table=options.whose().table)
    options.resolved()
    jobs = 1 if batch.recordings else min(batch.jobs or _jobs(paths), len(paths))
    judged = _by_processes(paths, options, jobs, batch) if jobs > 1 else _one_by_one(paths, batch)
    with closing(judged) as each:
        for log, judge in zip(paths, each, strict=True):
            try:
                assessment = judge(options)
            except MavhumsError as error:
                yield Outcome(log, None, error)
                continue
            except Exception as error:
                if len(paths) == 1:
                    raise
                yield Outcome(log, None, _unexpected(log, error))
                continue
            try:
                if batch.keep is not None:
                    keep_assessment(assessment, batch.keep)
                    options = replace(options, history=options.flights().with_flight(assessment))
            except MavhumsError as error:
                yield Outcome(log, assessment, error)
            else:
                yield Outcome(log, assessment, None)


def _jobs(logs: Sequence[Path]) -> int:
    """Return the number of processes that judge the logs soonest."""
    try:
        if sum(log.stat().st_size for log in logs) < _WORTH_BYTES:
            return 1
    except OSError:  # an outcome later on
        pass
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _one_by_one(logs: Sequence[Path], batch: Batch) -> Generator[_Judged]:
    for log in logs:

        def judge(options: Options, log: Path = log) -> Assessment:
            with batch.progress(log) as progress:
                recording = batch.recordings.get(log)
                return analyse(log, options, recording=recording, position=batch.position, progress=progress)

        yield judge


def _by_processes(logs: Sequence[Path], options: Options, jobs: int, batch: Batch) -> Generator[_Judged]:
    alone = _Alone(replace(options, history=None))
    with closing(in_processes(alone, logs, jobs, batch.prepare)) as flights:
        for log, flight in zip(logs, flights, strict=True):

            def judge(
                options: Options, log: Path = log, flight: LoneFlight | _Failure | Crashed = flight
            ) -> Assessment:
                if isinstance(flight, Crashed):
                    problem = f"{log}: crashed the process that judged it"
                    raise MavhumsError(problem, "judge it alone to see why: mavhums analyse LOG --jobs 1")
                if isinstance(flight, _Failure):
                    raise MavhumsError(*flight)
                return compared_with_own(flight, options)

            yield judge


def _unexpected(log: Path, error: Exception) -> MavhumsError:
    return MavhumsError(f"{log}: {type(error).__name__}: {str(error)[:200]}", "report it with the log")


class _Failure(NamedTuple):
    """An error on its way between processes."""

    problem: str
    remedy: str


@dataclass(frozen=True)
class _Alone:
    """Judges a log alone, in another process."""

    options: Options

    def __call__(self, log: Path) -> LoneFlight | _Failure:
        try:
            return analyse_alone(log, self._resolved)
        except MavhumsError as error:
            return _Failure(error.problem, error.remedy)
        except Exception as error:
            unexpected = _unexpected(log, error)
            return _Failure(unexpected.problem, unexpected.remedy)

    @cached_property
    def _resolved(self) -> EngineOptions:
        return self.options.resolved()
