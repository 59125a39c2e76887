"""What each user has dropped: kept in a temporary folder, and removed when the session ends."""

from __future__ import annotations

import asyncio
import json
import secrets
import shutil
import tempfile
import time
from collections.abc import AsyncIterator, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from mavhums.app.settings import Options
from mavhums.core.conditions import Condition
from mavhums.core.errors import MavhumsError
from mavhums.serve.uploads import Quotas, is_archive, receive, safe_name
from mavhums.serve.worker import Job
from mavhums.serve.workers import Progress, Workers

State = Literal["waiting", "judging", "done", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeOptions:
    """The options of the page.

    Attributes
    ----------
    host, port
        Address to listen at; port 0 takes a free one.
    public
        Name, with its port if it has one, under which a proxy with TLS serves the page; None without one.
    judging
        Options of each judgement: names, files and numbers, for the processes that judge.
    limits
        What one user and one log may use.
    live
        Files that ``mavhums live --json`` writes.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    public: str | None = None
    judging: Options = field(default_factory=Options)
    limits: Quotas = field(default_factory=Quotas)
    live: tuple[Path, ...] = ()

    @property
    def store(self) -> str | None:
        """Place of the store that the fleet's pages show; None without one."""
        return None if self.judging.store is None else str(self.judging.store)


@dataclass(slots=True, eq=False)
class Dropped:
    """A log that a user dropped, and what is known of it.

    Attributes
    ----------
    recording
        Whether there is a Rerun recording of it: ``""`` none yet, ``making``, ``ready``, or the problem.
    kept
        What the page says of keeping it in the store.
    note
        Which archive it came in, and what else that held.
    asked
        Aircraft that are proposed where the user must name its own; None where it is not asked for.
    entered
        Whether it belongs to a session.
    """

    id: str
    path: Path
    state: State = "waiting"
    size: int = 0
    read: int = 0
    condition: Condition = "undecided"
    word: str = ""
    headline: str = ""
    todo: str = ""
    problem: str = ""
    remedy: str = ""
    recording: str = ""
    kept: str = ""
    note: str = ""
    asked: tuple[str, ...] | None = None
    entered: bool = False

    def fail(self, problem: str, remedy: str) -> None:
        """Say why it cannot be judged."""
        self.problem, self.remedy, self.state = problem, remedy, "failed"

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.path.name

    @property
    def is_busy(self) -> bool:
        """Whether something is being made of it."""
        keeping = self.kept.endswith("…")
        return self.state in ("waiting", "judging") or self.recording == "making" or keeping

    @property
    def report(self) -> Path:
        """The report, once it is judged."""
        return self.path.parent / "report" / "report.html"

    @property
    def shown(self) -> Path:
        """The answer in parts, once it is judged: see :func:`mavhums.show.html.parts`."""
        return self.path.parent / "report" / "shown.json"

    @property
    def assessment(self) -> Path:
        """Its assessment as JSON, once it is judged."""
        return self.path.parent / "report" / "assessment.json"

    @property
    def rrd(self) -> Path:
        """The Rerun recording, once it is made."""
        return self.path.parent / "report" / "flight.rrd"


@dataclass(slots=True)
class UserSession:
    """One user's logs, in the order in which they came."""

    id: str
    logs: dict[str, Dropped] = field(default_factory=dict)
    seen_s: float = field(default_factory=time.monotonic)
    opened: bool = False
    tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def touch(self) -> None:
        """Note that a page of the session is open."""
        self.seen_s, self.opened = time.monotonic(), True


class Sessions:
    """The users' logs, in one folder that only this system user reads.

    Parameters
    ----------
    limits
        What a session may hold, and for how long.
    judging
        Options of each judgement.
    workers
        The processes that judge.
    """

    def __init__(self, limits: Quotas, judging: Options, workers: Workers) -> None:
        self.limits = limits
        self.folder = Path(tempfile.mkdtemp(prefix="mavhums-page-"))
        self._options = {name: value for name, value in asdict(judging).items() if value is not None}
        self._workers = workers
        self._sessions: dict[str, UserSession] = {}
        self._passing = 0
        # A hundred logs that somebody sends without a page keep nobody waiting who looks at one.
        workers.yields = lambda user: user in self._sessions and not self._sessions[user].opened

    def get(self, id_: str) -> UserSession:
        """Return the session of an id; it is kept only while it holds a log."""
        return self._sessions.get(id_) or UserSession(id_)

    def log(self, session: str, log: str) -> Dropped | None:
        """Return a log of a session; None if it is not this user's."""
        found = self._sessions.get(session)
        return found.logs.get(log) if found else None

    async def add(self, user: str, name: str, stream: AsyncIterator[bytes]) -> Dropped:
        """Receive a log for the session of this id and have it judged; return at its arrival.

        Raises
        ------
        MavhumsError
            If it is refused.
        """
        self._check_number(user)
        with self._placed(safe_name(name)) as log:
            log.size = await receive(stream, log.path, self.limits)
            self._make_room(user)
            self._enter(self._sessions.setdefault(user, UserSession(user)), log)
        return log

    @contextmanager
    def _placed(self, name: str) -> Iterator[Dropped]:
        """Yield a log in a folder of its own, which is removed unless the log has entered a session."""
        id_ = secrets.token_hex(8)
        log = Dropped(id_, self.folder / id_ / name)
        try:
            log.report.parent.mkdir(parents=True, mode=0o700)
            yield log
        finally:
            if not log.entered:
                shutil.rmtree(log.path.parent, ignore_errors=True)

    def _enter(self, session: UserSession, log: Dropped) -> None:
        """Put a log into a session, and judge it."""
        log.entered = True
        session.logs[log.id] = log
        self._begin(session, self._judge(session, log))

    def _make_room(self, user: str) -> None:
        """Refuse a log too many; for a session too many, the one whose page was closed first ends.

        A session that no page ever showed comes before all others, so that a program without cookies, each
        log of which begins a session, ends only its own.
        """
        self._check_number(user)
        if user not in self._sessions and len(self._sessions) >= self.limits.sessions:
            oldest = min(self._sessions.values(), key=lambda one: (one.opened, one.seen_s))
            if oldest.opened and oldest.seen_s > time.monotonic() - _OPEN_S:
                raise MavhumsError("too many users at a time", "close other pages, or wait half an hour")
            self.forget(oldest)

    def _check_number(self, user: str) -> None:
        if len(self.get(user).logs) >= self.limits.logs:
            raise MavhumsError(f"{self.limits.logs} logs are here already", "remove some of them first")

    @property
    def is_full(self) -> bool:
        """Whether as many logs are here to be assessed as there may be sessions."""
        return self._passing >= self.limits.sessions

    async def assess(self, user: str, name: str, stream: AsyncIterator[bytes]) -> bytes:
        """Receive a log, judge it in its user's turn, and return the assessment as JSON; nothing is kept.

        Raises
        ------
        MavhumsError
            If the log is refused, or cannot be judged.
        """
        if self.is_full:
            raise MavhumsError("too many logs at a time", "wait for the answers, then send it again")
        self._passing += 1
        try:
            with self._placed(safe_name(name)) as log:
                await receive(stream, log.path, self.limits)
                job = {"do": "judge", "assessment": str(log.assessment)}
                await self._complete(user, log.path, job)
                return await asyncio.to_thread(log.assessment.read_bytes)
        finally:
            self._passing -= 1

    async def curves(self, user: str, log: Path, sha256: str) -> dict[str, Any]:
        """Judge a log where it lies for its curves; return them as :func:`mavhums.show.html.parts` has them.

        Raises
        ------
        MavhumsError
            If it is not there, or is not the log any more.
        """
        if not await asyncio.to_thread(log.is_file):
            raise MavhumsError(f"no curves: {log} is not on this computer", "drop the log to see them")
        with self._placed("log") as made:
            await self._complete(user, log, _judging(made))
            if json.loads(made.assessment.read_bytes())["log"]["sha256"] != sha256:
                raise MavhumsError(f"no curves: {log} is another log by now", "drop the log to see them")
            curves: dict[str, Any] = json.loads(made.shown.read_bytes())["curves"]
            return curves

    def record(self, session: UserSession, log: Dropped) -> None:
        """Have the Rerun recording of a log made, once."""
        if log.state == "done" and log.recording not in ("making", "ready"):
            log.recording = "making"
            self._begin(session, self._record(session, log))

    def remove(self, session: UserSession, log: Dropped) -> None:
        """Remove a log and everything made of it; with its last log, its session."""
        session.logs.pop(log.id, None)
        shutil.rmtree(log.path.parent, ignore_errors=True)
        if not session.logs:
            self._sessions.pop(session.id, None)

    def forget(self, session: UserSession) -> None:
        """Remove a session and its logs; a process goes on with one that it judges, for nobody."""
        for log in list(session.logs.values()):
            self.remove(session, log)

    async def forget_old(self) -> None:
        """Remove sessions without an open page, until cancelled."""
        while True:
            await asyncio.sleep(min(30.0, self.limits.session_s))
            limit_s = time.monotonic() - self.limits.session_s
            for session in [one for one in self._sessions.values() if one.seen_s < limit_s]:
                self.forget(session)

    def close(self) -> None:
        """Remove everything."""
        shutil.rmtree(self.folder, ignore_errors=True)

    async def _judge(self, session: UserSession, log: Dropped) -> None:
        def progress(read: int) -> None:
            log.state, log.read = "judging", read

        if is_archive(log.path) and await self._unpacked(session, log):
            return
        answer = await self._run(session.id, log.path, _judging(log), progress)
        if session.logs.get(log.id) is not log:
            return
        if "brief" in answer:
            log.condition, log.word, log.headline, log.todo = (answer["brief"][key] for key in _BRIEF)
            log.state = "done"
        else:
            log.fail(answer["problem"], answer["remedy"])

    async def _unpacked(self, session: UserSession, archive: Dropped) -> bool:
        """Judge each log of an archive by itself; return False if the archive can be judged as one log."""
        room = self.limits.logs - len(session.logs) + 1
        job = {"do": "unpack", "into": str(archive.path.parent / "unpacked")}
        limits = {"most_bytes": self.limits.log_bytes, "most_logs": room}
        answer = await self._run(session.id, archive.path, job | limits)
        if session.logs.get(archive.id) is not archive:
            return True
        if "problem" in answer:
            archive.fail(answer["problem"], answer["remedy"])
            return True
        if answer["logs"] is None:
            return False
        others = ", ".join(answer["others"][:_NAMED]) + (", …" if len(answer["others"]) > _NAMED else "")
        if not answer["logs"]:
            remedy = "drop the logs themselves, or an archive that contains them"
            archive.fail(f"it contains no log, but {others}", remedy)
            return True
        note = f"From {archive.name}" + (f"; not judged in it: {others}" if others else "")
        for path in map(Path, answer["logs"]):
            self._take(session, path, note)
        self.remove(session, archive)
        return True

    def _take(self, session: UserSession, path: Path, note: str) -> None:
        """Judge a log that lies on this computer already."""
        with self._placed(path.name) as log:
            log.size, log.note = path.stat().st_size, note
            path.rename(log.path)
            self._enter(session, log)

    async def _record(self, session: UserSession, log: Dropped) -> None:
        answer = await self._run(session.id, log.path, {"do": "record", "recording": str(log.rrd)})
        log.recording = "ready" if "recorded" in answer else f"{answer['problem']}: {answer['remedy']}"

    async def _complete(self, user: str, log: Path, job: Job) -> None:
        """Run a job; raise what went wrong."""
        answer = await self._run(user, log, job)
        if "problem" in answer:
            raise MavhumsError(answer["problem"], answer["remedy"])

    async def _run(self, user: str, log: Path, job: Job, progress: Progress = lambda _: None) -> Job:
        return await self._workers.run(user, job | {"log": str(log), "options": self._options}, progress)

    def _begin(self, session: UserSession, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        session.tasks.add(task)
        task.add_done_callback(session.tasks.discard)


def _judging(log: Dropped) -> Job:
    outputs = {"report": log.report, "shown": log.shown, "assessment": log.assessment}
    return {"do": "judge", **{name: str(path) for name, path in outputs.items()}}


_NAMED = 10
_OPEN_S = 10.0  # an open page asks at least once a second
_BRIEF = ("condition", "word", "text", "todo")
