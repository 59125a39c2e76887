"""Identifies the aircraft of a log: by the operator's table, a rule from its path, or the board's id."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from itertools import combinations
from pathlib import Path
from typing import NamedTuple, Protocol

from mavhums.core.errors import MavhumsError
from mavhums.core.output import as_utf8
from mavhums.flights.aircraft_table import AircraftTable, Since
from mavhums.results.assessment import Assessment

BOARD = "board"
"""The rule that the board's id in the log names the aircraft."""

FOLDER = "folder"
"""The rule that the log's folder is named after the aircraft; an archive is no folder."""

GIVEN = "="
"""Begins a rule that gives the name itself, whatever the path."""

UNKNOWN = ""
"""Stands for an aircraft that nothing names; two such logs are never taken for one aircraft's."""


class UnnamedAircraftError(MavhumsError):
    """Nothing but a guess names the aircraft of a log.

    Parameters
    ----------
    problem, remedy
        As of :class:`mavhums.MavhumsError`.
    proposed
        Aircraft that it may be, the likeliest first.
    """

    def __init__(self, problem: str, remedy: str, proposed: tuple[str, ...] = ()) -> None:
        super().__init__(problem, remedy)
        self.proposed = proposed


def check_aircraft_rule(rule: str | None) -> None:
    """Refuse a rule that cannot identify an aircraft.

    Raises
    ------
    MavhumsError
        If it is neither ``folder``, nor ``board``, nor ``=NAME``, nor a regular expression with a group
        ``aircraft``.
    """
    if rule and rule != as_utf8(rule):
        raise MavhumsError(f"--aircraft {as_utf8(rule)}: is not UTF-8", "name the aircraft in UTF-8")
    if rule in (None, FOLDER, BOARD) or (rule.startswith(GIVEN) and rule != GIVEN):
        return
    remedy = f"name {FOLDER!r}, {BOARD!r}, '=D-EABC', or an expression such as '(?P<aircraft>D-[A-Z]+)'"
    try:
        if "aircraft" in re.compile(rule).groupindex:
            return
    except re.error as error:
        raise MavhumsError(f"--aircraft {rule}: is not a regular expression: {error}", remedy) from error
    raise MavhumsError(f"--aircraft {rule}: has no group named aircraft", remedy)


def aircraft_of(path: str, rule: str | None) -> str:
    """Return the aircraft's name by the rule, or :data:`UNKNOWN`.

    Examples
    --------
    >>> aircraft_of("logs/D-EABC/0007.tlog", "folder")
    'D-EABC'
    >>> aircraft_of("logs/D-EABC_0007.tlog", r"(?P<aircraft>D-[A-Z]+)_")
    'D-EABC'
    >>> aircraft_of("logs/0007.tlog", "=D-EABC")
    'D-EABC'
    >>> aircraft_of("logs/0007.tlog", None)
    ''
    """
    if rule in (None, BOARD):
        return UNKNOWN
    if rule.startswith(GIVEN):
        return rule.removeprefix(GIVEN)
    if rule == FOLDER:
        return next(folder.name for folder in Path(path).resolve().parents if not folder.is_file())
    match = re.search(rule, path)
    return UNKNOWN if match is None else match["aircraft"] or UNKNOWN


def board_of(assessment: Assessment) -> str | None:
    """Return the id of the only board that a log reports; None if it reports none or several."""
    boards = {flight.board for flight in assessment.log.flight}
    return boards.pop() if len(boards) == 1 else None


@dataclass(frozen=True, slots=True)
class AircraftResolver:
    """The operator's knowledge of whose log it is; the table takes precedence over the rule.

    Attributes
    ----------
    rule
        How the path of a log names the aircraft, as for :func:`aircraft_of`; None if it does not.
    table
        Where boards and actuators are installed.
    renamed
        New names of aircraft, by those that table and rule give.
    """

    rule: str | None = None
    table: AircraftTable = field(default_factory=AircraftTable)
    renamed: Mapping[str, str] = field(default_factory=dict)

    def name(self, path: str | None, board: str | None, start_utc: str | None) -> str | None:
        """Return the operator's name for the aircraft; None if neither table nor rule gives one."""
        named = None
        if start_utc is not None:
            named = self.table.aircraft_of(board, datetime.fromisoformat(start_utc))
        named = named or aircraft_of(path or "", self.rule) or None
        return self.renamed.get(named or "", named)

    def named(self, assessment: Assessment) -> Assessment:
        """Return the assessment with the operator's names for the aircraft in its log."""
        log = assessment.log
        flights = tuple(
            each.model_copy(update={"aircraft": self.name(log.path, each.board, log.start_utc)})
            for each in log.flight
        )
        return assessment.model_copy(update={"log": log.model_copy(update={"flight": flights})})

    def since(self, assessment: Assessment) -> Mapping[str | None, datetime]:
        """Return when each actuator of the log's aircraft was last swapped, before the log's start."""
        if assessment.log.start_utc is None:
            return {}
        start = datetime.fromisoformat(assessment.log.start_utc)
        names = {each.aircraft for each in assessment.log.flight}
        return self.table.since(names.pop(), start) if len(names) == 1 else {}


def latest(one: Since | None, other: Since | None) -> Mapping[str | None, datetime]:
    """Return the later date of each actuator; the key None stands for all that have no own one.

    Examples
    --------
    >>> days = [datetime(2026, 1, day) for day in (1, 2, 3)]
    >>> latest({None: days[1]}, {"rudder": days[2], "elevator": days[0]})["elevator"].day
    2
    """
    one, other = one or {}, other or {}
    merged: dict[str | None, datetime] = {}
    for name in {*one, *other}:
        dates = [date for each in (one, other) if (date := each.get(name, each.get(None))) is not None]
        merged[name] = max(dates)
    return merged


class OtherAircraftError(MavhumsError):
    """A flight is of another aircraft than the history."""


class KnownAircraft(NamedTuple):
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

    def differs(self, other: KnownAircraft) -> bool:
        """Return whether the two are known to be different aircraft."""
        if self.vehicle != other.vehicle:
            return False
        if self.aircraft and other.aircraft:
            return self.aircraft != other.aircraft
        return bool(self.board and other.board and self.board != other.board)

    def __str__(self) -> str:
        return self.aircraft or f"the aircraft with the board {self.board}"


class AircraftFlights(Protocol):
    """Earlier flights, as :class:`mavhums.flights.history.FlightHistory` has them."""

    @property
    def name(self) -> str:
        """What the history is called in messages."""

    def owners(self) -> list[KnownAircraft]:
        """Return what is known of the aircraft of its flights."""


def owners_of(assessment: Assessment, start: datetime) -> Iterator[KnownAircraft]:
    """Yield what an assessment says of the aircraft of each vehicle."""
    for flight in assessment.log.flight:
        yield KnownAircraft(flight.vehicle, flight.board, flight.aircraft, (start, start))


def check_same_aircraft(
    assessment: Assessment, history: AircraftFlights, table: AircraftTable | None = None
) -> Assessment:
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
                f" but {history.name} contains flights of {other}",
                f"name the folder of {one} with --history; if only its board was swapped, list both boards"
                " in a table and name that with --aircraft-table",
            )
    check_one_aircraft(history, table)
    vehicles = {one.vehicle for one in past if one.is_known}
    if any(one.is_known and one.vehicle in vehicles for one in own):
        notice = _foreign_board(own, past, table)
        if notice is None:
            return assessment
    else:
        silent = "the log" if any(one.is_known for one in past) else history.name
        notice = f"{silent} reports no board id: whether the flight is of this aircraft was not checked"
    log = assessment.log
    return assessment.model_copy(update={"log": log.model_copy(update={"notices": (*log.notices, notice)})})


def _foreign_board(
    own: Iterable[KnownAircraft], past: Iterable[KnownAircraft], table: AircraftTable | None
) -> str | None:
    """Return the notice on a board that no earlier flight of a named aircraft has; None without one."""
    for one in own:
        boards = {each.board for each in past if each.vehicle == one.vehicle and each.board}
        is_listed = table is not None and table.aircraft_of(one.board, one.starts[0]) == one.aircraft
        if one.board and boards and one.board not in boards and not is_listed:
            return (
                f"compared with flights of {one} with the board {min(boards)}, but this log has the board"
                f" {one.board}: it is another aircraft's log, or the board was swapped (then list both in"
                " --aircraft-table)"
            )
    return None


def check_one_aircraft(history: AircraftFlights, table: AircraftTable | None = None) -> None:
    """Refuse a history of several aircraft; the parameters are those of :func:`check_same_aircraft`.

    Raises
    ------
    OtherAircraftError
        If two flights of one system id are of different aircraft.
    """
    for one, other in combinations(_named(history.owners(), table), 2):
        if one.differs(other):
            raise OtherAircraftError(
                f"{history.name}: contains flights of {one} and of {other}",
                "move those of one into a folder of its own; if only the board was swapped, list both"
                " boards in a table and name that with --aircraft-table",
            )


def swaps_of(
    history: AircraftFlights, table: AircraftTable, moment: datetime
) -> Mapping[str | None, datetime]:
    """Return the last time up to a moment at which each actuator of the history's aircraft was swapped."""
    names = {owner.aircraft for owner in _named(history.owners(), table)} - {None}
    return table.since(names.pop(), moment) if len(names) == 1 else {}


def _named(owners: Iterable[KnownAircraft], table: AircraftTable | None) -> Iterator[KnownAircraft]:
    """Yield owners with the table's names at the start of their first and of their last flight."""
    for owner in owners:
        names = {table.aircraft_of(owner.board, start) if table else None for start in owner.starts}
        for name in names:
            yield owner._replace(aircraft=name or owner.aircraft)
