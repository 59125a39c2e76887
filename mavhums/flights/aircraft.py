"""Identifies the aircraft of a log: by the operator's table, a rule from its path, or the board's id."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

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
    if rule is not None and rule.startswith(GIVEN):
        return rule.removeprefix(GIVEN)
    if rule in (None, BOARD) or not path:
        return UNKNOWN
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
