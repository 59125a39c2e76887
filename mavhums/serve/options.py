"""The options of the page: where it listens, how it judges, and its limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from mavhums.app.settings import Options
from mavhums.results.assessment import Assessment
from mavhums.results.standing import Standing, TrendReport
from mavhums.results.store import LastFlightOf, StoreStatus
from mavhums.results.verdict import Verdict


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


class LastVerdict(Protocol):
    """An actuator or axis in its aircraft's last flight. ``aircraft`` is empty if it is unknown.

    ``standing`` is how it stands over its flights, where that is known.
    """

    @property
    def aircraft(self) -> str: ...  # noqa: D102
    @property
    def path(self) -> str: ...  # noqa: D102
    @property
    def start_us(self) -> int | None: ...  # noqa: D102
    @property
    def verdict(self) -> Verdict: ...  # noqa: D102
    @property
    def standing(self) -> Standing | None: ...  # noqa: D102
    def published(self) -> LastFlightOf: ...  # noqa: D102


class Fleet(Protocol):
    """What the page shows of a store; each method may take seconds and raises MavhumsError."""

    def status(self) -> StoreStatus:
        """Return how many logs and aircraft there are, and which logs failed."""

    def worst(self, most: int) -> Sequence[LastVerdict]:
        """Return actuators and axes as of the last flights, the worst first."""

    def trend(self, aircraft: str) -> TrendReport:
        """Return the trends of an aircraft."""

    def flights(self, aircraft: str) -> Sequence[Assessment]:
        """Return the verdicts of an aircraft's flights, in time order."""

    def flight(self, aircraft: str, sha256: str) -> Assessment:
        """Return the whole assessment of one flight."""

    def keep(self, log: Path, aircraft: str | None = None) -> str:
        """Copy a log into the store and judge it there; return what was done in one line.

        Raises
        ------
        UnnamedAircraftError
            If the store cannot identify its aircraft, and none is given.
        """


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
    fleet
        A store of flights; None without one.
    live
        Files that ``mavhums live --json`` writes.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    public: str | None = None
    judging: Options = field(default_factory=Options)
    limits: Quotas = field(default_factory=Quotas)
    fleet: Fleet | None = None
    live: tuple[Path, ...] = ()
