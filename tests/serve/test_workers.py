"""The judging processes: whatever a log does to one, the others and the next log are served."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, MutableSequence
from pathlib import Path
from typing import Any

import psutil
import pytest

from mavhums.serve.uploads import Quotas
from mavhums.serve.worker import Job, answer
from mavhums.serve.workers import Workers


def stand_in(read: MutableSequence[int], placed: tuple[int, Job]) -> Job:
    """Do what a job says, in place of judging a log."""
    place, job = placed
    if job["do"] == "crash":
        os.abort()
    if job["do"] == "killed once" and not Path(job["seen"]).exists():
        Path(job["seen"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if job["do"] == "hang":
        time.sleep(1000)
    read[place] = 1
    time.sleep(job.get("s", 0))
    return {"pid": os.getpid()}


pytestmark = pytest.mark.anyio


@contextlib.asynccontextmanager
async def working(limits: Quotas, function: Callable[..., Job] = stand_in) -> AsyncIterator[Workers]:
    workers = Workers(limits, function)
    workers.start()
    try:
        yield workers
    finally:
        await workers.close()


@pytest.fixture
async def workers(request: pytest.FixtureRequest) -> AsyncIterator[Workers]:
    async with working(getattr(request, "param", Quotas(workers=2))) as workers:
        yield workers


def ask(workers: Workers, do: str, user: str = "a", **more: Any) -> Awaitable[dict[str, Any]]:
    return workers.run(user, {"do": do, **more}, lambda _: None)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [Quotas(workers=2, judge_s=2.0)], indirect=True)
async def test_a_crash_and_a_hang_end_only_their_own_log(workers: Workers) -> None:
    crashed, hung, fine = await asyncio.gather(*(ask(workers, do) for do in ("crash", "hang", "judge")))
    assert "ended with SIGABRT" in crashed["problem"]
    assert "took longer than 2 s" in hung["problem"]
    assert crashed["remedy"]
    assert hung["remedy"]
    assert "pid" in fine
    assert "pid" in await ask(workers, "judge")


@pytest.mark.parametrize("workers", [Quotas(workers=1)], indirect=True)
async def test_the_log_of_a_killed_process_is_judged_once_more(workers: Workers, tmp_path: Path) -> None:
    assert "pid" in await ask(workers, "killed once", seen=str(tmp_path / "seen"))


async def test_processes_killed_while_idle_cost_no_attempt(workers: Workers) -> None:
    for _ in range(3):
        pids = {(await ask(workers, "judge"))["pid"] for _ in range(2)}
        for pid in pids:
            process = psutil.Process(pid)
            process.kill()
            await asyncio.to_thread(psutil.wait_procs, [process], 10.0)
        await asyncio.sleep(0.1)
        assert "pid" in await ask(workers, "judge")


async def test_no_process_stays() -> None:
    before = set(psutil.Process().children())
    async with working(Quotas(workers=2)) as workers:
        pids = [(await ask(workers, "judge"))["pid"] for _ in range(2)]
        hanging = asyncio.ensure_future(ask(workers, "hang"))
        await asyncio.sleep(0.1)
        hanging.cancel()
        await asyncio.gather(hanging, return_exceptions=True)
    assert not any(map(psutil.pid_exists, pids))
    assert set(psutil.Process().children()) <= before


async def test_a_user_with_many_logs_does_not_delay_another(workers: Workers) -> None:
    order: list[str] = []

    async def one(user: str) -> None:
        await ask(workers, "judge", user, s=0.2)  # longer than a busy machine stops one of the two
        order.append(user)

    many = [asyncio.ensure_future(one("many")) for _ in range(12)]
    await asyncio.sleep(0)  # all of them wait for a worker now, however slow the machine is
    await asyncio.gather(one("few"), *many)
    # In the order of asking it would be the last; a slow process lets some pass.
    assert "few" in order[:8]


@pytest.mark.parametrize("workers", [Quotas(workers=1)], indirect=True)
async def test_a_cancelled_wait_loses_no_worker(workers: Workers) -> None:
    first = asyncio.ensure_future(ask(workers, "judge", s=0.2))
    await asyncio.sleep(0.05)
    second = asyncio.ensure_future(ask(workers, "judge"))
    await asyncio.sleep(0.05)
    second.cancel()
    await asyncio.gather(first, second, return_exceptions=True)
    assert "pid" in await asyncio.wait_for(ask(workers, "judge"), 5)


@pytest.mark.parametrize("workers", [Quotas(workers=1)], indirect=True)
async def test_a_turn_is_not_lost_with_someone_who_leaves_once_it_has_come(workers: Workers) -> None:
    first = asyncio.ensure_future(ask(workers, "judge"))
    await asyncio.sleep(0)
    leaver = asyncio.ensure_future(ask(workers, "judge", "b"))
    first.add_done_callback(lambda _: leaver.cancel())  # its turn has come, and it does not know yet
    with pytest.raises(asyncio.CancelledError):
        await leaver
    assert "pid" in await asyncio.wait_for(ask(workers, "judge"), 5)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
async def test_the_true_process_judges_refuses_and_records_in_the_least_memory(
    growing_log: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rerun", reason="the 3-D view needs the extra 'viewer'")
    from mavhums.cli.serve import LEAST_MEMORY_MB

    odd = tmp_path / "notes.tlog"
    odd.write_text("this is no log, whatever its name says\n" * 100)
    job: dict[str, Any] = {"log": str(growing_log), "options": {}, "report": str(tmp_path / "report.html")}
    least = Quotas(workers=1, judge_s=300.0, memory_bytes=LEAST_MEMORY_MB << 20)
    async with working(least, answer) as workers:
        good = await ask(workers, "judge", **job)
        bad = await ask(workers, "judge", **job | {"log": str(odd)})
        wrong = await ask(workers, "judge", **job | {"options": {"airframe": "nowhere.toml"}})
        assert await ask(workers, "record", recording=str(tmp_path / "f.rrd"), **job) == {"recorded": True}
    assert good["brief"]["condition"] == "emergency"
    assert "elevator" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "notes.tlog" in bad["problem"]
    assert str(tmp_path) not in bad["problem"]
    assert bad["remedy"]
    assert "nowhere.toml" in wrong["problem"]


GROW = """
import resource, sys
from mavhums.serve.worker import limit
limit(200 << 20)
try:
    held = bytearray(400 << 20)
except MemoryError:
    sys.exit(resource.getrlimit(resource.RLIMIT_CORE) != (0, 0))
sys.exit(2)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
def test_memory_beyond_the_limit_is_refused() -> None:
    assert subprocess.run([sys.executable, "-c", GROW], check=False).returncode == 0
