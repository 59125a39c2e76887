"""Whose log it is: by the operator's table, by a rule on its path, or by the id of its board.

The table has which board and which actuators are installed in which aircraft, and when: they are swapped, so
every line has dates. It is a CSV file with a header::

    aircraft,board,actuator,serial,from,to
    D-EABC,4D415648554D5353494D0001,,,,2026-03-01
    D-EXYZ,4D415648554D5353494D0001,,,2026-03-01,
    D-EABC,,elevator,EMA-0042,2026-02-10,
"""

from __future__ import annotations

import csv
import os
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from mavhums.core.errors import MavhumsError
from mavhums.core.models import Frozen
from mavhums.core.output import as_utf8
from mavhums.results.assessment import Assessment

BOARD = "board"
"""The rule that the board's id in the log names the aircraft."""

FOLDER = "folder"
"""The rule that the log's folder is named after the aircraft; an archive is no folder."""

GIVEN = "="
"""Begins a rule that gives the name itself, whatever the path."""

UNKNOWN = ""
"""Name of an aircraft that nothing names; two such logs are never taken for one aircraft's."""

Since = Mapping[str | None, datetime]
"""Dates from which flights count, by actuator, for example after a repair; None applies to all others."""

_LARGEST = 64 << 20
_EVER = datetime.min.replace(tzinfo=UTC)
_EXAMPLE = "write lines such as D-EABC,0A1B2C,,,2026-03-01, below aircraft,board,actuator,serial,from,to"


class AircraftTableError(MavhumsError):
    """An aircraft table that is unreadable or contradicts itself."""


class Installation(Frozen):
    """A board or an actuator in an aircraft, for some time.

    Attributes
    ----------
    aircraft
        Name of the aircraft, such as its registration.
    board
        Unique id of the autopilot's board, as the log or ``mavhums inspect`` shows it.
    actuator, serial
        Instead of a board: name of the actuator in the airframe profile, and its serial number.
    begins, ends
        Dates ``from`` and ``to`` in the file, UTC unless they have an offset; None for no bound.
    """

    aircraft: str = Field(min_length=1)
    board: str | None = None
    actuator: str | None = None
    serial: str | None = None
    begins: datetime | None = Field(default=None, alias="from")
    ends: datetime | None = Field(default=None, alias="to")

    @field_validator("aircraft", "board", "actuator", "serial", mode="before")
    @classmethod
    def _text(cls, value: object) -> object:
        return (value.strip() or None) if isinstance(value, str) else value

    @field_validator("begins", "ends", mode="before")
    @classmethod
    def _moment(cls, value: object) -> object:
        if isinstance(value, str):
            value = datetime.fromisoformat(value.strip()) if value.strip() else None
        if isinstance(value, date) and not isinstance(value, datetime):
            value = datetime.combine(value, time())
        return value.replace(tzinfo=UTC) if isinstance(value, datetime) and value.tzinfo is None else value

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.board is None) == (self.actuator is None) or (self.actuator is None) != (
            self.serial is None
        ):
            raise ValueError("name a board, or an actuator with its serial number")
        if self.begins is not None and self.ends is not None and self.begins >= self.ends:
            raise ValueError("the date 'to' must be after the date 'from'")
        return self

    def at(self, moment: datetime) -> bool:
        """Return whether it is installed at this time; on the date ``to`` it is not any more."""
        return (self.begins is None or self.begins <= moment) and (self.ends is None or moment < self.ends)

    def overlaps(self, other: Installation) -> bool:
        """Return whether the two are installed at a common time."""
        after = self.ends is not None and other.begins is not None and self.ends <= other.begins
        before = other.ends is not None and self.begins is not None and other.ends <= self.begins
        return not (after or before)


class AircraftTable:
    """What is installed where, and when.

    Parameters
    ----------
    installed
        The entries; they do not contradict each other.

    Examples
    --------
    >>> given = {"aircraft": "D-EABC", "board": "0A", "to": "2026-03-01"}
    >>> table = AircraftTable([Installation.model_validate(given)])
    >>> [table.aircraft_of("0a", datetime(2026, month, 1, tzinfo=UTC)) for month in (2, 3)]
    ['D-EABC', None]
    """

    def __init__(self, installed: Iterable[Installation] = ()) -> None:
        self.installed: tuple[Installation, ...] = tuple(installed)
        self._boards: dict[str, list[Installation]] = defaultdict(list)
        self._actuators: dict[str, list[Installation]] = defaultdict(list)
        for each in self.installed:
            if each.board is not None:
                self._boards[each.board.upper()].append(each)
            else:
                self._actuators[each.aircraft].append(each)

    def aircraft_of(self, board: str | None, moment: datetime) -> str | None:
        """Return the aircraft in which a board is installed at a time; None if the table does not say."""
        several = self._boards.get((board or "").upper(), ())
        return next((each.aircraft for each in several if each.at(moment)), None)

    def since(self, aircraft: str | None, moment: datetime) -> Mapping[str | None, datetime]:
        """Return the last time at which each actuator of an aircraft was swapped, up to a moment."""
        dates: dict[str | None, datetime] = {}
        for each in self._actuators.get(aircraft or "", ()):
            for swapped in (each.begins, each.ends):
                if swapped is not None and swapped <= moment:
                    dates[each.actuator] = max(swapped, dates.get(each.actuator, swapped))
        return dates


def load_aircraft_table(path: str | os.PathLike[str]) -> AircraftTable:
    """Read an aircraft table, a CSV file.

    Raises
    ------
    AircraftTableError
        If it cannot be read, has an impossible entry, or contradicts itself.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _LARGEST:
            raise AircraftTableError(f"{path}: is larger than any aircraft table", "name the right file")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        problem = f"{path}: {(error.strerror or str(error)).lower()}"
        raise AircraftTableError(problem, "check the path of the aircraft table") from error
    except UnicodeDecodeError as error:
        raise AircraftTableError(f"{path}: is not UTF-8 text", "save it as UTF-8") from error
    installed: list[tuple[str, Installation]] = []
    for where, entry in _of_csv(path, text):
        try:
            installed.append((where, Installation.model_validate(entry)))
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            mistake = first["msg"].removeprefix("Value error, ")
            raise AircraftTableError(
                f"{where}: {place + ': ' if place else ''}{mistake}", _EXAMPLE
            ) from error
    _check_consistent(installed)
    return AircraftTable(each for _, each in installed)


def _of_csv(path: Path, text: str) -> Iterator[tuple[str, dict[str, Any]]]:
    rows = csv.DictReader(StringIO(text), strict=True)
    known = {"aircraft", "board", "actuator", "serial", "from", "to"}
    try:
        names = [name.strip() for name in rows.fieldnames or ()]
        unknown = [name for name in names if name not in known]
        if "aircraft" not in names or unknown:
            problem = f"unknown column {unknown[0][:40]!r}" if unknown else "has no column named aircraft"
            raise AircraftTableError(f"{path}:1: {problem}", _EXAMPLE)
        rows.fieldnames = names
        for row in rows:
            if None in row:
                raise AircraftTableError(f"{path}:{rows.line_num}: has more fields than the header", _EXAMPLE)
            if any(value and value.strip() for value in row.values()):
                yield f"{path}:{rows.line_num}", {name: value for name, value in row.items() if value}
    except csv.Error as error:
        raise AircraftTableError(f"{path}:{rows.line_num}: is not valid CSV: {error}", _EXAMPLE) from error


def _check_consistent(installed: Sequence[tuple[str, Installation]]) -> None:
    """Refuse entries of which only one can be true."""
    places: dict[tuple[str, ...], list[tuple[str, Installation]]] = defaultdict(list)
    for where, each in installed:
        if each.board is not None:
            places["board", each.board.upper()].append((where, each))
        else:
            places["actuator", each.aircraft, each.actuator or ""].append((where, each))
            places["serial number", each.serial or ""].append((where, each))
    for (kind, *_), several in places.items():
        several.sort(key=lambda each: each[1].begins or _EVER)
        for (first, one), (second, other) in pairwise(several):
            if one.overlaps(other):
                problem = f"{second}: the {kind} is also installed by {first} at the same time"
                raise AircraftTableError(problem, "give the dates 'to' and 'from' at which it was swapped")


class UnnamedAircraftError(MavhumsError):
    """Nothing but a guess names the aircraft of a log.

    Parameters
    ----------
    problem, remedy
        As of :class:`mavhums.MavhumsError`.
    proposed
        Aircraft that it may be, the likeliest first.
    """

    def __init__(self, problem: str, remedy: str = "", proposed: tuple[str, ...] = ()) -> None:
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


def latest(one: Since | None, other: Since | None) -> Mapping[str | None, datetime]:
    """Return the later date of each actuator; the key None means all that have no own one.

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
