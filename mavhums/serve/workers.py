"""Processes that judge for the page: a log that crashes, hangs or grows ends one of them and nothing else."""

from __future__ import annotations

import asyncio
import os
import signal
from collections import Counter
from collections.abc import AsyncIterator, Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, asynccontextmanager
from ctypes import c_longlong
from functools import partial
from multiprocessing.sharedctypes import RawArray
from typing import Final

from mavhums.core.process_pool import process_pool
from mavhums.serve import worker
from mavhums.serve.uploads import Quotas
from mavhums.serve.worker import Job

_JOBS: Final = 100  # after which a process is replaced
_PROGRESS_S: Final = 0.1
_FRUGAL: Final = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "RAYON_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "1",
    "MIMALLOC_ARENA_EAGER_COMMIT": "0",
}
"""One log uses one core; each further thread reserves memory that counts against the limit: 1.5 GB in all.

Rerun's allocator reserves 1 GiB in one piece; committed at once, it counts against the limit before any use,
and where it is refused, chance decides whether a thread's stack still fits.
"""

Progress = Callable[[int], None]


class Workers:
    """Judges with a few processes, for several users in turn.

    Parameters
    ----------
    limits
        Number of processes, and time and memory of one job.
    function
        Returns the answer to a job; it also gets an array and a place in it for the bytes that are read.

    Attributes
    ----------
    yields
        Whether a user comes after all others who have as many running jobs.
    """

    def __init__(self, limits: Quotas, function: Callable[..., Job] = worker.answer) -> None:
        self._limits, self._stack = limits, ExitStack()
        self._read = RawArray(c_longlong, limits.workers)
        self._function = partial(function, self._read)
        self._free = [*range(limits.workers)]
        self._waiting: list[str] = []
        self._change = asyncio.Condition()
        self._running: Counter[str] = Counter()
        self.yields: Callable[[str], bool] = lambda _: False

    def start(self) -> None:
        """Start the processes; they get ready meanwhile."""
        os.environ.update(_FRUGAL)
        pool = process_pool(
            self._function,
            self._limits.workers,
            preload=["mavhums.engine.engine", worker.__name__],
            item_s=self._limits.judge_s,
            items=_JOBS,
            begin=partial(worker.limit, self._limits.memory_bytes),
        )
        self._submit: Callable[[tuple[int, Job]], Future[Job]] = self._stack.enter_context(pool)
        for place in self._free:
            self._submit((place, {"do": "start"}))  # a pool starts its processes with the first item

    async def close(self) -> None:
        """End every process."""
        await asyncio.to_thread(self._stack.close)

    async def run(self, user: str, job: Job, progress: Progress) -> Job:
        """Return the answer to a job, or a ``problem`` with its ``remedy``.

        A user with many jobs does not delay a user with one: the user with the fewest running jobs is next.
        A process may be killed for what is not in its log: the job is run once more.
        """
        async with self._turn(user) as place:
            return await self._once(place, job, progress, last=False) or await self._once(
                place, job, progress
            )

    async def _once(self, place: int, job: Job, progress: Progress, *, last: bool = True) -> Job:
        """Return the answer; nothing where the process ended and this is not the last attempt."""
        from pebble import ProcessExpired

        self._read[place] = 0
        future = asyncio.wrap_future(self._submitted(place, job))  # one that is cancelled ends its process
        try:
            while not future.done():
                await asyncio.wait([future], timeout=_PROGRESS_S)
                if read := self._read[place]:
                    progress(read)
            return future.result()
        except TimeoutError:
            problem = f"took longer than {self._limits.judge_s:.0f} s and was stopped"
            return {"problem": problem, "remedy": "judge it with `mavhums analyse`"}
        except (ProcessExpired, BrokenProcessPool) as error:
            if not last:
                return {}
            code = getattr(error, "exitcode", 1)
            how = f"code {code}" if code >= 0 else signal.Signals(-code).name
            remedy = "it may need more memory than the page allows: judge it with `mavhums analyse`"
            return {"problem": f"the process that judged it ended with {how}", "remedy": remedy}
        finally:
            future.cancel()

    def _submitted(self, place: int, job: Job) -> Future[Job]:
        try:
            return self._submit((place, job))
        except RuntimeError:  # a pool gives up where a process is killed while all are idle
            self._stack.close()
            self.start()
            return self._submit((place, job))

    @asynccontextmanager
    async def _turn(self, user: str) -> AsyncIterator[int]:
        """Wait until one job more may run and this user is next; yield its place among those that run."""
        async with self._change:
            self._waiting.append(user)
            try:
                await self._change.wait_for(lambda: self._free and self._next() == user)
                place = self._free.pop()
                self._running[user] += 1
            finally:
                self._waiting.remove(user)
                self._change.notify_all()
        try:
            yield place
        finally:
            self._running[user] -= 1
            self._running += Counter()
            self._free.append(place)
            async with self._change:
                self._change.notify_all()

    def _next(self) -> str:
        """Return the waiting user whose turn it is."""
        return min(self._waiting, key=lambda user: (self._running[user], self.yields(user)))
