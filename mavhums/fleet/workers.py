"""The processes that judge: Dask's workers, on this machine or of a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from math import ceil
from typing import TYPE_CHECKING, Any, Final

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.flights.store import LogFile

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["batches", "connected", "count"]

_MOST: Final = 20
_SHARE: Final = 4
_LARGE: Final = str(32 << 20)
_SETTINGS: Final = {
    # Without these, the memory of each log is returned to the system and fetched again, page by page.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": _LARGE,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": _LARGE,
    "distributed.worker.profile.enabled": False,
}


@contextmanager
def connected(workers: int, scheduler: str | None) -> Iterator[Client]:
    """Connect to a scheduler, or start one with workers on this machine.

    Parameters
    ----------
    workers
        Number of processes on this machine.
    scheduler
        Address of a scheduler that runs; None to start one.

    Raises
    ------
    MavhumsError
        If no scheduler answers there.
    MissingExtraError
        If Dask is not installed.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise MissingExtraError("scanning a fleet", "fleet") from error
    with ExitStack() as stack:
        if scheduler:
            try:
                client = Client(scheduler, timeout=10)
            except (OSError, ValueError) as error:
                problem = f"{scheduler}: no scheduler answers"
                raise MavhumsError(problem, "start one: dask scheduler, and dask worker ADDRESS") from error
            yield stack.enter_context(client)
            return
        stack.enter_context(config.set(_SETTINGS))
        local: Any = LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
        )
        yield stack.enter_context(Client(stack.enter_context(local)))


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
