"""A log as a row of the store: judged alone, or with the reason why it could not be judged."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Final

from mavhums.app.analysis import Failed, analyse_alone
from mavhums.app.settings import Options, Settings
from mavhums.core.about import __version__
from mavhums.engine.options import EngineOptions
from mavhums.fleet.sources import UnreachedError, at_hand
from mavhums.flights.aircraft import UNKNOWN, AircraftResolver, board_of
from mavhums.flights.compare import StandaloneAssessment, packed
from mavhums.flights.history import PastFlight, UndatedError
from mavhums.flights.naming import aircraft_in_store
from mavhums.flights.store import LogFile, Row

__all__ = ["AGAIN", "crashed", "judge", "judge_several", "settings_of"]


AGAIN: Final = ""
"""Settings of a log that the next scan judges again."""


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


def judge_several(
    files: tuple[LogFile, ...], options: Options, settings: str, whose: AircraftResolver
) -> list[Row]:
    """Judge logs one by one."""
    return [judge(file, options, settings, whose) for file in files]


def judge(file: LogFile, options: Options, settings: str, whose: AircraftResolver) -> Row:
    """Judge a log alone; a log that cannot be judged gives a row with the reason."""
    aircraft = whose.name(file.path, None, None) or UNKNOWN
    path = file.path
    try:
        with at_hand(file) as path:
            flight = _named(analyse_alone(path, _resolved(options)), file)
    except UnreachedError as error:
        return _failed(file, AGAIN, aircraft, error.problem, error.remedy)
    except Exception as error:
        failed = Failed.of(Path(path), error)
        return _failed(file, settings, aircraft, failed.problem.replace(path, file.path), failed.remedy)
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


def _named(flight: StandaloneAssessment, file: LogFile) -> StandaloneAssessment:
    """Return a flight under the path of its log, wherever its copy lay."""
    log = flight.assessment.log.model_copy(update={"path": file.path})
    return flight._replace(assessment=flight.assessment.model_copy(update={"log": log}))


def crashed(file: LogFile, settings: str, whose: AircraftResolver) -> Row:
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
