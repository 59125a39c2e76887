"""A log as a row of the store: judged alone, or with the reason why it could not be judged."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

from mavhums import __version__
from mavhums.app.analysis import analyse_alone
from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError
from mavhums.engine.options import EngineOptions
from mavhums.fleet.sources import LogFile, UnreachedError, at_hand
from mavhums.history.aircraft import BOARD, UNKNOWN, Whose, board_of
from mavhums.history.comparison import LoneFlight, packed
from mavhums.history.flights import PastFlight, UndatedError
from mavhums.report.assessment import Assessment

__all__ = ["BOARD_NAME", "Row", "aircraft_in_store", "crashed", "judge", "judge_several", "settings_of"]


BOARD_NAME: Final = "board "
"""Begins the name of an aircraft that only its board identifies."""

_AGAIN: Final = ""
"""Settings of a log that the next scan judges again."""


class Row(NamedTuple):
    """The data of a log in the store.

    ``settings`` is the hash of everything besides the log that a judgement depends on. ``board`` is the id of
    the only board that the log reports, None if it reports none or several. ``start_us`` is UTC,
    None for a log without a date. ``flight`` contains the flight judged alone; it is None if ``problem`` and
    ``remedy`` state why it could not be judged.
    """

    path: str
    size: int
    time_ns: int
    settings: str
    sha256: str | None
    aircraft: str
    board: str | None
    start_us: int | None
    duration_s: float | None
    losses: bool
    flight: bytes | None
    problem: str | None
    remedy: str | None


def settings_of(options: Options) -> str:
    """Return the hash of everything besides the log that a judgement depends on."""
    resolved = Settings.read(options).engine
    told = {
        "version": __version__,
        "airframe": resolved.airframe.model_dump_json() if resolved.airframe else None,
        "models": [model.hash for model in resolved.models],
        "false_alarms": resolved.false_alarms,
        "dialect": None if resolved.dialect is None else _hash_of_file(str(resolved.dialect)),
        "key": None if resolved.key is None else hashlib.sha256(resolved.key).hexdigest(),
    }
    if resolved.decide != "physics":  # left out, so that stores of older versions keep their hashes
        told["decide"] = resolved.decide
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:32]


def judge_several(files: tuple[LogFile, ...], options: Options, settings: str, whose: Whose) -> list[Row]:
    """Judge logs one by one."""
    return [judge(file, options, settings, whose) for file in files]


def judge(file: LogFile, options: Options, settings: str, whose: Whose) -> Row:
    """Judge a log alone; a log that cannot be judged gives a row with the reason."""
    aircraft = whose.name(file.path, None, None) or UNKNOWN
    path = file.path
    try:
        with at_hand(file) as path:
            flight = _named(analyse_alone(path, _resolved(options)), file)
    except UnreachedError as error:
        return _failed(file, _AGAIN, aircraft, error.problem, error.remedy)
    except MavhumsError as error:
        return _failed(file, settings, aircraft, error.problem.replace(path, file.path), error.remedy)
    except Exception as error:
        told = f"{file.path}: {type(error).__name__}: {str(error)[:200]}"
        return _failed(file, settings, aircraft, told, "report it with the log")
    try:
        start_us: int | None = round(PastFlight.of(flight.assessment).start.timestamp() * 1e6)
    except UndatedError:
        start_us = None
    log = flight.assessment.log
    return Row(
        *file,
        settings=settings,
        sha256=log.sha256,
        aircraft=aircraft_in_store(file.path, flight.assessment, whose),
        board=board_of(flight.assessment),
        start_us=start_us,
        duration_s=log.duration_s,
        losses=bool(log.losses.any),
        flight=packed(flight),
        problem=None,
        remedy=None,
    )


def _named(flight: LoneFlight, file: LogFile) -> LoneFlight:
    """Return a flight under the path of its log, wherever its copy lay."""
    log = flight.assessment.log.model_copy(update={"path": file.path})
    return flight._replace(assessment=flight.assessment.model_copy(update={"log": log}))


def aircraft_in_store(path: str, assessment: Assessment, whose: Whose) -> str:
    """Return the aircraft's name in a store: by the table, else by the rule; without a rule, by its board."""
    board = board_of(assessment)
    named = whose.name(path, board, assessment.log.start_utc)
    if named is None and board and whose.rule in (None, BOARD):
        return f"{BOARD_NAME}{board}"
    return named or UNKNOWN


def crashed(file: LogFile, settings: str, whose: Whose) -> Row:
    """Return the row of a log on which every worker died."""
    remedy = "judge it alone to see why: mavhums analyse LOG"
    problem = f"{file.path}: crashed the worker that judged it"
    return _failed(file, settings, whose.name(file.path, None, None) or UNKNOWN, problem, remedy)


def _failed(file: LogFile, settings: str, aircraft: str, problem: str, remedy: str) -> Row:
    return Row(
        *file,
        settings=settings,
        sha256=None,
        aircraft=aircraft,
        board=None,
        start_us=None,
        duration_s=None,
        losses=False,
        flight=None,
        problem=problem,
        remedy=remedy,
    )


@cache
def _resolved(options: Options) -> EngineOptions:
    return Settings.read(options).engine


def _hash_of_file(path: str) -> str:
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
