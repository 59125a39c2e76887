"""What a fleet's store says as JSON: its contents, and its actuators and axes after their last flights."""

from __future__ import annotations

from mavhums.core.models import Contract
from mavhums.results.standing import Standing
from mavhums.results.verdict import Verdict

__all__ = ["ForeignBoard", "LastFlightOf", "StoreCopy", "StoreFailure", "StoreGrowth", "StoreStatus"]


class LastFlightOf(Contract):
    """An actuator or axis in its aircraft's last flight; ``aircraft`` is None where it is unknown.

    ``standing`` is how it stands over its flights, where that is known.
    """

    aircraft: str | None
    log: str
    start_utc: str | None
    verdict: Verdict
    standing: Standing | None

    def to_json(self) -> str:
        """Return it as JSON, without what only later comparisons need."""
        return self.model_dump_json(exclude={"verdict": {"own"}})


class StoreFailure(Contract):
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
    """An actuator that grows, and how it stands over its flights."""

    aircraft: str
    standing: Standing


class StoreStatus(Contract):
    """The contents of a store: judged logs, known aircraft, logs of an unknown one, failures and copies.

    ``removed`` is the number of logs that were removed.
    """

    judged: int
    aircraft: int
    unknown: int
    failures: tuple[StoreFailure, ...]
    copies: tuple[StoreCopy, ...]
    foreign_boards: tuple[ForeignBoard, ...] = ()
    growing: tuple[StoreGrowth, ...] = ()
    removed: int = 0
