"""JSON from a fleet's store: its contents, the state of its aircraft, and the changes since a time."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from mavhums.core.about import NOTICE
from mavhums.core.conditions import SEVERITY
from mavhums.core.errors import ExitCode
from mavhums.core.models import Contract
from mavhums.results.standing import Standing
from mavhums.results.verdict import Verdict


class LastFlightOf(Contract):
    """An actuator or axis in its aircraft's last flight; ``aircraft`` is None where it is unknown.

    ``standing`` is its state over the flights, where it is known.
    """

    aircraft: str | None
    log: str
    start_utc: str | None
    verdict: Verdict
    standing: Standing | None

    def to_json(self, *, indent: int | None = None) -> str:
        """Return it as JSON, without what only later comparisons need."""
        return self.model_dump_json(indent=indent, exclude={"verdict": {"own"}})


class FailedLog(Contract):
    """A log that could not be judged."""

    problem: str
    remedy: str


class StoreCopy(Contract):
    """A log whose flight another log records better; that one counts."""

    log: str
    counted: str


class ForeignBoard(Contract):
    """A board in flights of an aircraft that usually has another one.

    ``usual`` is the board that the aircraft has in most flights, in so many; ``elsewhere`` the aircraft
    of which the board is the usual one, None if there is none.
    """

    aircraft: str
    board: str
    logs: tuple[str, ...]
    usual: str
    flights: int
    elsewhere: str | None

    def __str__(self) -> str:
        count = len(self.logs)
        told = f"{count} logs, {self.logs[0]} and others, have" if count > 1 else f"{self.logs[0]} has"
        whose = f" of {self.elsewhere}" if self.elsewhere else ""
        others = f"{self.flights} other flight{'s have' if self.flights > 1 else ' has'}"
        return f"{self.aircraft}: {told} the board {self.board}{whose}, and {others} {self.usual}"


class StoreGrowth(Contract):
    """An actuator with growing wear, and its state over the flights."""

    aircraft: str
    standing: Standing


class StoreStatus(Contract):
    """The contents of a store: judged logs, known aircraft, logs of an unknown one, failures and copies.

    ``removed`` is the number of logs that were removed.
    """

    judged: int
    aircraft: int
    unknown: int
    failures: tuple[FailedLog, ...]
    copies: tuple[StoreCopy, ...]
    foreign_boards: tuple[ForeignBoard, ...] = ()
    growing: tuple[StoreGrowth, ...] = ()
    removed: int = 0


class Change(Contract):
    """A change in the state of an actuator or axis.

    Attributes
    ----------
    kind
        ``new`` finding, ``worse``, ``growing`` (certain growth, or one that comes within ten flights of a
        limit), ``step``, ``eased``, or ``gone``.
    before, now
        The state then, None for one that is new, and the state now.
    """

    kind: Literal["new", "worse", "growing", "step", "eased", "gone"]
    aircraft: str
    before: Standing | None
    now: Standing


class SilentAircraft(Contract):
    """An aircraft without flights for longer than usual; ``days`` have passed since the last one."""

    aircraft: str
    last_utc: str
    days: float


class FleetDigest(Contract):
    """The changes in a fleet, for a reader who looks once a day.

    Attributes
    ----------
    since_utc, until_utc
        The period that it covers; the time at which a log came into the store counts.
    aircraft, flights
        Number of aircraft with a name, and of logs that came meanwhile.
    changes
        The most urgent first.
    silent
        Aircraft that fell silent meanwhile.
    failed
        Logs that could not be judged, meanwhile.
    standing
        Number of unchanged findings.
    silent_longer
        Number of aircraft that were silent before.
    """

    schema_: Literal["mavhums.digest/1"] = Field(default="mavhums.digest/1", alias="schema")
    notice: str = NOTICE
    since_utc: str
    until_utc: str
    aircraft: int
    flights: int
    changes: tuple[Change, ...] = ()
    silent: tuple[SilentAircraft, ...] = ()
    failed: tuple[FailedLog, ...] = ()
    standing: int = 0
    silent_longer: int = 0

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to say."""
        return not (self.changes or self.silent or self.failed)

    @property
    def exit_code(self) -> ExitCode:
        """The exit code for what is new: of ``--fail-on-news``."""
        worsened = [one.now for one in self.changes if one.kind in ("new", "worse")]
        if any(SEVERITY[one.condition] == SEVERITY["emergency"] for one in worsened):
            return ExitCode.EMERGENCY
        if worsened or any(one.kind in ("growing", "step") for one in self.changes):
            return ExitCode.DEGRADED
        return ExitCode.ERROR if self.failed else ExitCode.OK
