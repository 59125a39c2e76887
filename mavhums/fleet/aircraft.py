"""Identifies the aircraft of a log: by the operator's rule from the log's path, or by the board's id."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from mavhums.core.errors import MavhumsError
from mavhums.report.assessment import Assessment

__all__ = ["FOLDER", "UNKNOWN", "aircraft_of", "board_of", "hold_rule"]

FOLDER = "folder"
"""The rule that the log's folder is named after the aircraft."""

UNKNOWN = ""
"""Stands for an aircraft that nothing names; two such logs are never taken for one aircraft's."""


def hold_rule(rule: str | None) -> None:
    """Refuse a rule that cannot identify an aircraft.

    Raises
    ------
    MavhumsError
        If it is neither ``folder`` nor a regular expression with a group ``aircraft``.
    """
    if rule is None or rule == FOLDER:
        return
    remedy = f"name {FOLDER!r}, or an expression such as '(?P<aircraft>D-[A-Z]+)'"
    try:
        if "aircraft" in re.compile(rule).groupindex:
            return
    except re.error as error:
        raise MavhumsError(f"--aircraft {rule}: is no regular expression: {error}", remedy) from error
    raise MavhumsError(f"--aircraft {rule}: has no group named aircraft", remedy)


def aircraft_of(path: str, rule: str | None) -> str:
    """Return the aircraft's name by the rule, or :data:`UNKNOWN`.

    Examples
    --------
    >>> aircraft_of("logs/D-EABC/0007.tlog", "folder")
    'D-EABC'
    >>> aircraft_of("logs/D-EABC_0007.tlog", r"(?P<aircraft>D-[A-Z]+)_")
    'D-EABC'
    >>> aircraft_of("logs/0007.tlog", None)
    ''
    """
    if rule is None:
        return UNKNOWN
    if rule == FOLDER:
        return Path(path).resolve().parent.name
    match = _compiled(rule).search(path)
    return UNKNOWN if match is None else match["aircraft"] or UNKNOWN


def board_of(assessment: Assessment) -> str:
    """Return the id of the only board that a log reports, as the aircraft's name, or :data:`UNKNOWN`."""
    boards = {flight.board for flight in assessment.log.flight}
    board = boards.pop() if len(boards) == 1 else None
    return UNKNOWN if board is None else f"board {board}"


@cache
def _compiled(rule: str) -> re.Pattern[str]:
    return re.compile(rule)
