"""What a fleet's store says as JSON: its contents, and its actuators and axes after their last flights."""

from __future__ import annotations

from mavhums.core.models import Contract
from mavhums.results.standing import Standing
from mavhums.results.verdict import Verdict

__all__ = ["LastFlightOf", "StoreCopy", "StoreFailure", "StoreGrowth", "StoreStatus", "StoreStranger"]


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


class StoreStranger(Contract):
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
    strangers: tuple[StoreStranger, ...] = ()
    growing: tuple[StoreGrowth, ...] = ()
    removed: int = 0
