"""Processes kept ready to judge: a log that crashes, hangs or grows ends one of them and nothing else."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

_START_S: Final = 300.0  # a busy machine, and a tree without built kernels, which compiles them
_JOBS: Final = 100
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

Job = dict[str, Any]
Progress = Callable[[int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quotas:
    """What one user and one log may use.

    Attributes
    ----------
    log_bytes
        Size of a log.
    upload_s
        Time for an upload.
    judge_s, memory_bytes
        Wall-clock time and memory of one judgement; memory is limited on Linux only.
    logs
        Logs of one session.
    sessions
        Sessions that hold a log, at a time.
    session_s
        Time after which the logs of a session without an open page are removed.
    workers
        Processes that judge.
    """

    log_bytes: int = 1 << 30
    upload_s: float = 900.0
    judge_s: float = 300.0
    memory_bytes: int = 2 << 30
    logs: int = 50
    sessions: int = 100
    session_s: float = 1800.0
    workers: int = 2


class _Worker:
    """One process; ``start`` begins it, and the first ``ask`` waits until it is ready."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self._process: Process | None = None
        self._ready = False
        self._jobs = 0

    async def start(self) -> None:
        self._process = await asyncio.create_subprocess_exec(
            *self._command,
            stdin=PIPE,
            stdout=PIPE,
            stderr=DEVNULL,
            start_new_session=True,
            env=os.environ | _FRUGAL | {"PYTHONUTF8": "1"},
        )

    async def wait_ready(self) -> None:
        """Wait until the process has loaded what it needs.

        Raises
        ------
        TimeoutError, ConnectionError
            If it does not.
        """
        if not self._ready:
            async with asyncio.timeout(_START_S):
                self._ready = "ready" in await self._answer()

    async def ask(self, job: Job, progress: Progress) -> Job:
        """Return the answer to a job; ConnectionError if the process ends instead."""
        assert self._process
        assert self._process.stdin
        self._process.stdin.write(json.dumps(job, default=os.fspath).encode() + b"\n")
        await self._process.stdin.drain()
        self._jobs += 1
        while True:
            answer = await self._answer()
            if "read" not in answer:
                return answer
            progress(int(answer["read"]))

    async def _answer(self) -> Job:
        assert self._process
        assert self._process.stdout
        line = await self._process.stdout.readline()
        if not line:
            raise ConnectionError
        answer: Job = json.loads(line)
        return answer

    @property
    def usable(self) -> bool:
        """Whether the process can take another job."""
        return self._process is not None and self._process.returncode is None and self._jobs < _JOBS

    async def end(self) -> str:
        """End the process at once; return how it ended, in words."""
        if self._process is None:
            return "did not start"
        if self._process.returncode is None:
            with suppress(ProcessLookupError):
                _kill(self._process)
        code = await self._process.wait()
        if code >= 0:
            return f"ended with code {code}"
        return f"ended with {signal.Signals(-code).name}"


class Workers:
    """Judges with a few processes, for several users in turn.

    Parameters
    ----------
    limits
        Number of processes, and time and memory of one job.
    command
        The program; None for :mod:`mavhums.serve.worker`.

    Attributes
    ----------
    yields
        Whether a user comes after all others who have as many running jobs.
    """

    def __init__(self, limits: Quotas, command: Sequence[str] | None = None) -> None:
        self._limits = limits
        usual = (sys.executable, "-m", "mavhums.serve.worker", str(limits.memory_bytes))
        self._command = usual if command is None else command
        self._free: list[_Worker] = []
        self._waiting: list[tuple[str, asyncio.Future[_Worker]]] = []
        self._running: Counter[str] = Counter()
        self._all: set[_Worker] = set()
        self._closed = False
        self.yields: Callable[[str], bool] = lambda _: False

    async def start(self) -> None:
        """Start the processes; they get ready meanwhile."""
        for _ in range(self._limits.workers):
            await self._add()

    async def run(self, user: str, job: Job, progress: Progress) -> Job:
        """Return the answer to a job, or a ``problem`` with its ``remedy``.

        A user with many jobs does not delay a user with one: the user with the fewest running jobs is next.
        A process may be killed for what is not in its log: the job is run once more.
        """
        return await self._once(user, job, progress, last=False) or await self._once(user, job, progress)

    async def _once(self, user: str, job: Job, progress: Progress, *, last: bool = True) -> Job:
        """Return the answer; nothing where the process ended and this is not the last attempt."""
        worker = await self._acquire(user)
        self._running[user] += 1
        try:
            await worker.wait_ready()
            async with asyncio.timeout(self._limits.judge_s):
                return await worker.ask(job, progress)
        except TimeoutError:
            how = await worker.end()
            problem = f"took longer than {self._limits.judge_s:.0f} s and was stopped"
            return {"problem": problem, "remedy": "judge it with `mavhums analyse`", "how": how}
        except (ConnectionError, ValueError):
            how = await worker.end()
            if not last:
                return {}
            remedy = "it may need more memory than the page allows: judge it with `mavhums analyse`"
            return {"problem": f"the process that judged it {how}", "remedy": remedy}
        except asyncio.CancelledError:
            await asyncio.shield(worker.end())
            raise
        finally:
            self._running[user] -= 1
            self._running += Counter()
            await asyncio.shield(self._release(worker))

    async def close(self) -> None:
        """End every process."""
        self._closed = True
        for worker in list(self._all):
            await worker.end()

    async def _acquire(self, user: str) -> _Worker:
        while self._free:
            worker = self._free.pop(0)
            if worker.usable or self._closed:
                return worker
            await self._release(worker)  # killed while it was idle: another takes its place
        turn: asyncio.Future[_Worker] = asyncio.get_running_loop().create_future()
        entry = (user, turn)
        self._waiting.append(entry)
        try:
            return await turn
        except asyncio.CancelledError:
            if entry in self._waiting:
                self._waiting.remove(entry)
            elif turn.done() and not turn.cancelled():
                self._hand(turn.result())
            raise

    async def _release(self, worker: _Worker) -> None:
        if worker.usable:
            self._hand(worker)
            return
        await worker.end()
        self._all.discard(worker)
        if not self._closed:
            await self._add()

    async def _add(self) -> None:
        worker = _Worker(self._command)
        await worker.start()
        self._all.add(worker)
        self._hand(worker)

    def _hand(self, worker: _Worker) -> None:
        """Give a worker to the waiting user whose turn it is, or keep it."""
        waiting = [one for one in self._waiting if not one[1].cancelled()]
        if not waiting:
            self._free.append(worker)
            return
        entry = min(waiting, key=lambda one: (self._running[one[0]], self.yields(one[0])))
        self._waiting.remove(entry)
        entry[1].set_result(worker)


def _kill(process: Process) -> None:
    """Kill a process and all that it started.

    ``Process.kill`` asks for the exit code first, which would hide it from asyncio.
    """
    if sys.platform == "win32":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)
