"""Holds a flight against the aircraft of a history: one aircraft's history takes no flight of another."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from itertools import combinations
from typing import NamedTuple, Protocol

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft_table import AircraftTable
from mavhums.report.assessment import Assessment

__all__ = ["OtherAircraftError", "Owned", "Owner", "held_own", "hold_one_aircraft", "owners_of", "swaps_of"]


class OtherAircraftError(MavhumsError):
    """A flight is of another aircraft than the history."""


class Owner(NamedTuple):
    """What is known of the aircraft of a vehicle's flights.

    Attributes
    ----------
    vehicle
        System id.
    board
        Unique id of the autopilot's board; None if it is unknown.
    aircraft
        The operator's name for the aircraft; None if there is none.
    starts
        Starts of the first and of the last flight of which this is known.
    """

    vehicle: int
    board: str | None
    aircraft: str | None
    starts: tuple[datetime, datetime]

    @property
    def is_known(self) -> bool:
        """Whether anything identifies the aircraft."""
        return bool(self.board or self.aircraft)

    def differs(self, other: Owner) -> bool:
        """Return whether the two are known to be different aircraft."""
        if self.vehicle != other.vehicle:
            return False
        if self.aircraft and other.aircraft:
            return self.aircraft != other.aircraft
        return bool(self.board and other.board and self.board != other.board)

    def __str__(self) -> str:
        return self.aircraft or f"the aircraft with the board {self.board}"


class Owned(Protocol):
    """Earlier flights, as :class:`mavhums.flights.history.FlightHistory` has them."""

    @property
    def name(self) -> str:
        """What the history is called in messages."""

    def owners(self) -> list[Owner]:
        """Return what is known of the aircraft of its flights."""


def owners_of(assessment: Assessment, start: datetime) -> Iterator[Owner]:
    """Yield what an assessment says of the aircraft of each vehicle."""
    for flight in assessment.log.flight:
        yield Owner(flight.vehicle, flight.board, flight.aircraft, (start, start))


def held_own(assessment: Assessment, history: Owned, table: AircraftTable | None = None) -> Assessment:
    """Return the assessment, with a notice if it cannot be told whether the history is of its aircraft.

    Parameters
    ----------
    assessment
        Of the flight; its identities have the operator's names.
    history
        The earlier flights.
    table
        Where boards are installed; it also names the aircraft of the earlier flights.

    Raises
    ------
    OtherAircraftError
        If the flight is of another aircraft than the history, or the history is of several.
    """
    start = assessment.log.start_utc
    past = [*_named(history.owners(), table)]
    if start is None or not past:
        return assessment
    own = [*owners_of(assessment, datetime.fromisoformat(start))]
    for one, other in ((one, other) for one in own for other in past):
        if one.differs(other):
            raise OtherAircraftError(
                f"{assessment.log.path or 'the live link'}: is of {one},"
                f" but {history.name} holds flights of {other}",
                f"name the folder of {one} with --history; if only its board was swapped, list both boards"
                " in a table and name that with --aircraft-table",
            )
    hold_one_aircraft(history, table)
    vehicles = {one.vehicle for one in past if one.is_known}
    if any(one.is_known and one.vehicle in vehicles for one in own):
        return assessment
    silent = "the log" if any(one.is_known for one in past) else history.name
    told = f"{silent} tells no board id, so that the flight is of this aircraft was not checked"
    log = assessment.log
    return assessment.model_copy(update={"log": log.model_copy(update={"notices": (*log.notices, told)})})


def hold_one_aircraft(history: Owned, table: AircraftTable | None = None) -> None:
    """Refuse a history of several aircraft; the parameters are those of :func:`held_own`.

    Raises
    ------
    OtherAircraftError
        If two flights of one system id are of different aircraft.
    """
    for one, other in combinations(_named(history.owners(), table), 2):
        if one.differs(other):
            raise OtherAircraftError(
                f"{history.name}: holds flights of {one} and of {other}",
                "move those of one into a folder of its own; if only the board was swapped, list both"
                " boards in a table and name that with --aircraft-table",
            )


def swaps_of(history: Owned, table: AircraftTable, moment: datetime) -> Mapping[str | None, datetime]:
    """Return the last time up to a moment at which each actuator of the history's aircraft was swapped."""
    names = {owner.aircraft for owner in _named(history.owners(), table)} - {None}
    return table.since(names.pop(), moment) if len(names) == 1 else {}


def _named(owners: Iterable[Owner], table: AircraftTable | None) -> Iterator[Owner]:
    """Yield owners with the table's names at the start of their first and of their last flight."""
    for owner in owners:
        names = {table.aircraft_of(owner.board, start) if table else None for start in owner.starts}
        for name in names:
            yield owner._replace(aircraft=name or owner.aircraft)
