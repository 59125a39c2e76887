"""Sessions: each user's logs are that user's, and nothing of them stays."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import Future
from pathlib import Path

import pytest

from mavhums.app.settings import Options
from mavhums.core.errors import MavhumsError
from mavhums.serve.sessions import Sessions, UserSession
from mavhums.serve.uploads import Quotas
from mavhums.serve.worker import Job
from mavhums.serve.workers import Progress, Workers

BRIEF = {"condition": "normal", "word": "", "text": "All normal", "todo": "nothing"}


pytestmark = pytest.mark.anyio


class Judged(Workers):
    """Gives the prepared answer at once."""

    def __init__(self, answer: Job | None = None) -> None:
        super().__init__(Quotas())
        self.answer = answer or {"brief": BRIEF}
        self.jobs: list[Job] = []

    async def run(self, user: str, job: Job, progress: Progress) -> Job:
        self.jobs.append(job)
        progress(2)
        await asyncio.sleep(0)
        if job["do"] == "record":
            return {"recorded": True}
        return self.answer


async def content(*parts: bytes) -> AsyncIterator[bytes]:
    for part in parts:
        yield part


@pytest.fixture
async def sessions(request: pytest.FixtureRequest) -> AsyncIterator[Sessions]:
    """With the limits, or of workers that give the answer, of the parameter."""
    wanted = getattr(request, "param", None)
    limits = wanted if isinstance(wanted, Quotas) else Quotas()
    answer = wanted if isinstance(wanted, dict) else None
    sessions = Sessions(limits, Options(airframe="paper"), Judged(answer))
    yield sessions
    sessions.close()
    assert not sessions.folder.exists()


async def settled(session: UserSession) -> None:
    while session.tasks:
        await asyncio.gather(*session.tasks)


async def test_a_log_is_judged_with_the_options_of_the_page(sessions: Sessions) -> None:
    log = await sessions.add("a", "../../x/flight.tlog", content(b"abc", b"de"))
    session = sessions.get("a")
    assert (log.name, log.size, log.state) == ("flight.tlog", 5, "waiting")
    assert log.path.read_bytes() == b"abcde"
    assert log.path.is_relative_to(sessions.folder)
    await settled(session)
    assert (log.state, log.condition, log.headline) == ("done", "normal", "All normal")
    (job,) = sessions._workers.jobs  # type: ignore[attr-defined]
    assert job["options"]["airframe"] == "paper"
    sessions.record(session, log)
    sessions.record(session, log)
    await settled(session)
    assert log.recording == "ready"
    assert len(sessions._workers.jobs) == 2  # type: ignore[attr-defined]


@pytest.mark.parametrize("sessions", [{"problem": "no log", "remedy": "check it"}], indirect=True)
async def test_a_failure_is_reported(sessions: Sessions) -> None:
    log = await sessions.add("a", "a.tlog", content(b"a"))
    session = sessions.get("a")
    await settled(session)
    assert (log.state, log.problem, log.remedy) == ("failed", "no log", "check it")
    sessions.record(session, log)
    assert log.recording == "", "of a log that cannot be judged there is no recording"


async def test_another_user_has_no_access(sessions: Sessions) -> None:
    log = await sessions.add("a", "a.tlog", content(b"a"))
    assert sessions.log("a", log.id) is log
    assert sessions.log("b", log.id) is None
    sessions.get("b")
    assert sessions.log("b", log.id) is None


async def test_what_is_removed_is_gone(sessions: Sessions) -> None:
    log = await sessions.add("a", "a.tlog", content(b"a"))
    session = sessions.get("a")
    sessions.remove(session, log)
    assert not log.path.parent.exists()
    await settled(session)
    assert sessions.log("a", log.id) is None
    other = await sessions.add("a", "b.tlog", content(b"b"))
    sessions.forget(sessions.get("a"))
    assert not other.path.exists()
    assert sessions.get("a").logs == {}


@pytest.mark.parametrize("sessions", [Quotas(session_s=0.1)], indirect=True)
async def test_a_session_without_an_open_page_ends(sessions: Sessions) -> None:
    log = await sessions.add("a", "a.tlog", content(b"a"))
    session = sessions.get("a")
    janitor = asyncio.create_task(sessions.forget_old())
    for _ in range(3):
        await asyncio.sleep(0.05)
        session.touch()
    assert log.path.exists(), "its page is open"
    async with asyncio.timeout(10):
        while log.path.exists():
            await asyncio.sleep(0.02)
    janitor.cancel()


@pytest.mark.parametrize("sessions", [Quotas(logs=2)], indirect=True)
async def test_logs_are_limited_and_a_refused_log_takes_no_place(sessions: Sessions) -> None:
    for _ in range(3):
        with pytest.raises(MavhumsError, match="empty"):
            await sessions.add("a", "a.tlog", content())
    assert not list(sessions.folder.iterdir())
    for _ in range(2):
        await sessions.add("a", "a.tlog", content(b"a"))
    with pytest.raises(MavhumsError, match="2 logs are here already"):
        await sessions.add("a", "a.tlog", content(b"a"))


@pytest.mark.parametrize("sessions", [Quotas(sessions=3)], indirect=True)
async def test_uploads_without_a_page_take_no_session_from_a_user_with_one(sessions: Sessions) -> None:
    first = await sessions.add("user", "a.tlog", content(b"a"))
    sessions.get("user").touch()
    for number in range(9):
        await sessions.add(f"visitor {number}", "a.tlog", content(b"a"))
    assert sessions.log("user", first.id) is first
    assert first.path.exists()
    assert len(list(sessions.folder.iterdir())) == 3
    await sessions.add("other", "a.tlog", content(b"a"))
    for user in ("other", "third"):
        await sessions.add(user, "a.tlog", content(b"a"))
        sessions.get(user).touch()
    with pytest.raises(MavhumsError, match="too many users"):
        await sessions.add("fourth", "a.tlog", content(b"a"))


async def test_who_looks_at_a_page_does_not_wait_for_logs_that_nobody_looks_at() -> None:
    order: list[str] = []

    class Slow(Workers):
        def _submitted(self, place: int, job: Job) -> Future[Job]:
            order.append(Path(job["log"]).name)
            done = Future[Job]()
            if first.done():
                done.set_result({"brief": BRIEF})
            return done if first.done() else first

    first = Future[Job]()
    limits = Quotas(workers=1)
    sessions = Sessions(limits, Options(airframe="paper"), Slow(limits))
    users = [*map(str, range(9)), "user"]
    for user in users:
        await sessions.add(user, f"{user}.tlog", content(b"a"))
    sessions.get("user").touch()
    await asyncio.sleep(0)  # all but the first wait
    first.set_result({"brief": BRIEF})
    for user in users:
        await settled(sessions.get(user))
    sessions.close()
    assert order == ["0.tlog", "user.tlog", *(f"{number}.tlog" for number in range(1, 9))]


@pytest.mark.parametrize("sessions", [Quotas(sessions=1)], indirect=True)
async def test_a_session_costs_nothing_without_a_log(sessions: Sessions) -> None:
    for number in range(9):
        sessions.get(f"visitor {number}").touch()

    async def stalls() -> AsyncIterator[bytes]:
        yield b"a"
        await asyncio.sleep(60)

    begun = [asyncio.create_task(sessions.add(f"{n}", "a.tlog", stalls())) for n in range(9)]
    await asyncio.sleep(0)
    log = await sessions.add("a", "a.tlog", content(b"a"))
    sessions.remove(sessions.get("a"), log)
    await sessions.add("b", "a.tlog", content(b"a"))
    for one in begun:
        one.cancel()


@pytest.mark.parametrize("sessions", [{"problem": "no log", "remedy": "check it"}], indirect=True)
async def test_of_a_log_that_is_only_assessed_nothing_stays_and_few_are_taken_at_a_time(
    sessions: Sessions,
) -> None:
    with pytest.raises(MavhumsError, match="no log"):
        await sessions.assess("api", "a.tlog", content(b"a"))
    with pytest.raises(MavhumsError, match="empty"):
        await sessions.assess("api", "a.tlog", content())
    assert not list(sessions.folder.iterdir())
    sessions._passing = sessions.limits.sessions
    assert sessions.is_full
    with pytest.raises(MavhumsError, match="too many"):
        await sessions.assess("api", "a.tlog", content(b"a"))


async def test_a_wrong_method_is_answered_with_the_right_one(sessions: Sessions) -> None:
    pytest.importorskip("plotly", reason="the page needs the extra 'serve'")
    import httpx  # NiceGUI brings it

    from mavhums.serve.routes import api

    transport = httpx.ASGITransport(app=api(sessions, None))
    async with httpx.AsyncClient(transport=transport, base_url="http://api") as client:
        answers = [await client.delete(path) for path in ("/version", "/logs")]
    assert [answer.status_code for answer in answers] == [405, 405]
    assert [answer.headers["allow"] for answer in answers] == ["GET", "POST"]
