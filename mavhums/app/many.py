"""Judges many logs on several cores; the results come in the order of the logs, and memory stays flat."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from mavhums.app.analysis import Failed, Judged, among_own, judge
from mavhums.app.settings import Options, Settings
from mavhums.app.sinks import Sink
from mavhums.core.errors import MavhumsError

_WORTH_BYTES: Final = 64 << 20  # fewer are judged in the time that processes need to start

Progress = Callable[[Path], AbstractContextManager[Callable[[int], None] | None]]


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
    progress: Progress = lambda _: nullcontext()


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
    flights = in_processes(alone, logs, jobs, preload=["mavhums.app.many"])
    with closing(flights):
        for log, judged in zip(logs, flights, strict=True):
            yield Failed.crashed(log) if isinstance(judged, LostItem) else judged


def _without_cause(settings: Settings, log: Path) -> Judged | Failed:
    """Judge a log in another process; not every exception can be sent."""
    judged = judge(log, settings)
    return judged._replace(cause=None) if isinstance(judged, Failed) else judged


def _compared(judged: Judged | Failed, settings: Settings) -> Judged | Failed:
    """Compare a flight that another process has judged with the earlier flights."""
    if isinstance(judged, Failed) or judged.alone is None:
        return judged
    try:
        return among_own(judged.log, judged.alone, settings)[0]
    except MavhumsError as error:
        return Failed.of(judged.log, error)
