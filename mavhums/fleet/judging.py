"""Judges the logs of a scan one by one: here, in processes of this machine, or by a Dask scheduler."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from itertools import islice
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from mavhums.app.analysis import Failed, analyse_alone
from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.process_pool import LostItem, in_processes
from mavhums.engine.options import EngineOptions
from mavhums.fleet.sources import UnreachedError, at_hand
from mavhums.flights.aircraft import UNKNOWN, AircraftResolver
from mavhums.flights.landing import row_of
from mavhums.flights.store import LogFile, Row

if TYPE_CHECKING:
    from distributed import Client

AGAIN: Final = ""
"""Settings of a log that the next scan judges again."""

_IN_FLIGHT: Final = 8
_MOST: Final = 20
_SHARE: Final = 4
_TLS: Final = (
    "start it with TLS (https://distributed.dask.org/en/stable/tls.html), name it tls://…, and its"
    " certificates here by Dask's settings distributed.comm.tls.*"
)


class Judging(NamedTuple):
    """How the logs of a scan are judged: the options, their hash, and what names the aircraft."""

    engine: EngineOptions
    settings: str
    resolver: AircraftResolver


def judge_several(files: Sequence[LogFile], judging: Judging) -> list[Row]:
    """Judge logs one by one."""
    return [judge(file, judging) for file in files]


def judge(file: LogFile, judging: Judging) -> Row:
    """Judge a log alone; a log that cannot be judged gives a row with the reason."""
    path = file.path
    try:
        with at_hand(file) as path:
            alone = analyse_alone(path, judging.engine)
    except UnreachedError as error:
        return _failed(file, judging._replace(settings=AGAIN), error.problem, error.remedy)
    except Exception as error:
        failed = Failed.of(Path(path), error)
        return _failed(file, judging, failed.problem.replace(path, file.path), failed.remedy)
    return row_of(alone, file, judging.settings, judging.resolver)


def _failed(file: LogFile, judging: Judging, problem: str, remedy: str) -> Row:
    aircraft = judging.resolver.name(file.path, None, None) or UNKNOWN
    return Row(*file, judging.settings, aircraft, problem=problem, remedy=remedy)


def _crashed(file: LogFile, judging: Judging) -> Row:
    problem = f"{file.path}: crashed the worker that judged it"
    return _failed(file, judging, problem, "judge it alone to see why: mavhums analyse LOG")


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """Connect to a scheduler.

    Dask unpickles what comes to its ports, so whoever reaches them runs code. So every connection has TLS
    with certificates on both sides: those that Dask's configuration names.

    Raises
    ------
    MavhumsError
        If no scheduler answers there, or the connection would not be authenticated.
    MissingExtraError
        If Dask is not installed.
    """
    try:
        from distributed import Client, Security
    except ImportError as error:
        raise MissingExtraError("scanning by a cluster", "fleet") from error
    try:
        client = Client(scheduler, timeout=10, security=Security(require_encryption=True))
    except (OSError, ValueError) as error:
        problem = f"{scheduler}: no scheduler answers"
        raise MavhumsError(problem, "start one: dask scheduler, and dask worker ADDRESS") from error
    except (RuntimeError, TypeError) as error:
        # The address is not tls://, or there is no certificate.
        problem = f"{scheduler}: refused, for without TLS anybody could run code in it"
        raise MavhumsError(problem, _TLS) from error
    with client:
        yield client


def judged(files: Sequence[LogFile], judging: Judging, workers: int) -> Generator[Row]:
    """Yield the row of each log, judged by processes of this machine, or without any by this one."""
    if not workers:
        yield from (judge(file, judging) for file in files)
        return
    with closing(in_processes(partial(judge, judging=judging), files, workers, preload=[__name__])) as rows:
        for file, row in zip(files, rows, strict=True):
            yield _crashed(file, judging) if isinstance(row, LostItem) else row


def count(client: Client) -> int:
    """Return the number of tasks that run at once, at least 1."""
    cores: dict[str, int] = client.ncores()
    return max(sum(cores.values()), 1)


def batches(files: Sequence[LogFile], workers: int) -> Iterator[tuple[LogFile, ...]]:
    """Yield the logs in batches: one log first, so that progress is seen early, and small ones at the end.

    Parameters
    ----------
    files
        All logs.
    workers
        Number of workers, which should end together.

    Examples
    --------
    >>> files = [LogFile(str(n), 0, 0) for n in range(40)]
    >>> [len(several) for several in batches(files, 2)]
    [1, 1, 5, 5, 4, 3, 3, 3, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1]
    """
    done = 0
    while done < len(files):
        share = ceil((len(files) - done) / (_SHARE * workers))
        size = 1 if done < workers else min(share, _MOST)
        yield tuple(files[done : done + size])
        done += size


def judged_by_workers(client: Client, files: Sequence[LogFile], judging: Judging) -> Generator[Row]:
    """Yield the row of each log as it is judged.

    A worker that dies loses its waiting batches. So the logs of a batch that no worker completes are tried
    again at the end, one at a time: a log on which a worker then dies is the cause.
    """
    from distributed import as_completed, wait

    workers = count(client)
    waiting = batches(files, workers)
    running: Any = as_completed()
    pending: dict[str, tuple[LogFile, ...]] = {}
    suspects: list[LogFile] = []

    def submit(several: tuple[LogFile, ...]) -> Any:
        return client.submit(judge_several, several, judging, pure=False)

    def go_on(most: int) -> None:
        for several in islice(waiting, most):
            future = submit(several)
            pending[future.key] = several
            running.add(future)

    go_on(_IN_FLIGHT * workers)
    for future in running:
        several = pending.pop(future.key)
        if future.status == "finished":
            yield from future.result()
        else:
            suspects += several
        future.release()
        go_on(1)
    for file in suspects:
        future = submit((file,))
        wait([future])
        if future.status == "finished":
            yield from future.result()
        else:
            yield _crashed(file, judging)
