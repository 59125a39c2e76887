"""The options of the page: where it listens, how it judges, and its limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from mavhums.app.settings import Options


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
