"""Queries on a fleet's store."""

from __future__ import annotations

import os
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.fleet.aircraft import UNKNOWN
from mavhums.fleet.store import Store
from mavhums.history.comparison import unpacked
from mavhums.history.flights import FlightHistory, PastFlight
from mavhums.history.trends import trend_report
from mavhums.report.assessment import Assessment, Verdict, exit_code_of
from mavhums.report.trend import TrendReport

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Status", "Worst", "assessments", "exit_code", "export", "status", "trend", "verdicts", "worst"]

_LATEST = """
SELECT aircraft, vehicle, actuator, condition, worst, friction_nm, start_us, path, verdict FROM verdicts
QUALIFY row_number() OVER (
    PARTITION BY aircraft, CASE WHEN aircraft = '' THEN path END, vehicle, actuator
    ORDER BY start_us DESC NULLS LAST, path) = 1
ORDER BY urgency DESC, friction_nm DESC NULLS LAST, aircraft, path, vehicle, actuator
"""


class Status(NamedTuple):
    """The contents of a store.

    Attributes
    ----------
    judged, aircraft, unknown
        Number of judged logs, of known aircraft, and of logs without one.
    failures
        Problem and remedy of each log that could not be judged.
    copies
        Each log whose flight another log records better, and that log, which counts.
    """

    judged: int
    aircraft: int
    unknown: int
    failures: tuple[tuple[str, str], ...]
    copies: tuple[tuple[str, str], ...] = ()


class Worst(NamedTuple):
    """An actuator in its aircraft's last flight. ``aircraft`` is empty if it is unknown."""

    aircraft: str
    path: str
    start_us: int | None
    verdict: Verdict


def status(store: str | os.PathLike[str]) -> Status:
    """Return the contents of a store.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    kept = Store(store).opened()
    judged, aircraft, unknown = kept.query(
        "SELECT COUNT(DISTINCT sha256), COUNT(DISTINCT nullif(aircraft, '')),"
        " COUNT(DISTINCT CASE WHEN aircraft = '' THEN sha256 END) FROM logs WHERE flight IS NOT NULL"
    ).fetchone()
    failures = kept.query(
        "SELECT problem, remedy FROM logs WHERE problem IS NOT NULL"
        " QUALIFY row_number() OVER (PARTITION BY path ORDER BY scanned DESC) = 1 ORDER BY path"
    ).fetchall()
    copies = kept.query("SELECT DISTINCT path, counted FROM copies ORDER BY path").fetchall()
    return Status(judged, aircraft, unknown, tuple(failures), tuple(copies))


def worst(store: str | os.PathLike[str], *, most: int | None = None) -> list[Worst]:
    """Return every actuator as of its aircraft's last flight, the worst first.

    Parameters
    ----------
    store
        Folder of the store.
    most
        Maximum number of actuators; None for all.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    rows = Store(store).opened().query(_LATEST + (f" LIMIT {most:d}" if most is not None else "")).fetchall()
    return [
        Worst(aircraft, path, start_us, Verdict.model_validate_json(verdict))
        for aircraft, _, _, _, _, _, start_us, path, verdict in rows
    ]


def exit_code(store: str | os.PathLike[str]) -> ExitCode:
    """Return the exit code of ``fleet worst``: that of ``analyse`` for the last flights and the failures."""
    rows = Store(store).opened().query(f"SELECT condition, worst FROM ({_LATEST})").fetchall()
    code = exit_code_of(max(condition, worst, key=URGENCY.__getitem__) for condition, worst in rows)
    if code not in (ExitCode.EMERGENCY, ExitCode.DEGRADED) and status(store).failures:
        return ExitCode.ERROR
    return code if rows else ExitCode.UNDECIDED


def verdicts(store: str | os.PathLike[str], aircraft: str) -> list[tuple[str, Verdict]]:
    """Return an aircraft's verdicts with its past, each with its log, in time order."""
    rows = (
        Store(store)
        .opened()
        .query("SELECT path, verdict FROM verdicts WHERE aircraft = ? ORDER BY start_us, path", aircraft)
        .fetchall()
    )
    return [(path, Verdict.model_validate_json(verdict)) for path, verdict in rows]


def assessments(store: str | os.PathLike[str], aircraft: str) -> list[Assessment]:
    """Return an aircraft's assessments with its past, in time order.

    Raises
    ------
    MavhumsError
        If the store does not exist, or does not contain the aircraft.
    """
    kept = Store(store).opened()
    held: dict[str, list[Verdict]] = defaultdict(list)
    for path, verdict in verdicts(store, aircraft):
        held[path].append(verdict)
    rows = kept.query(
        "SELECT arg_max(flight, scanned) FROM logs WHERE aircraft = ? AND flight IS NOT NULL"
        " GROUP BY sha256 ORDER BY min(start_us), min(path)",
        aircraft,
    ).fetchall()
    if not rows:
        named = kept.query("SELECT DISTINCT aircraft FROM logs WHERE aircraft <> '' ORDER BY 1").fetchall()
        there = ", ".join(name for (name,) in named[:20]) or "none"
        raise MavhumsError(f"{store}: no flight of the aircraft {aircraft!r}", f"the store has: {there}")
    alone = [unpacked(data).assessment for (data,) in rows]
    return [each.model_copy(update={"verdicts": tuple(held[each.log.path or ""])}) for each in alone]


def trend(store: str | os.PathLike[str], aircraft: str) -> TrendReport:
    """Return the trends of an aircraft's actuators; the errors are those of :func:`assessments`."""
    if aircraft == UNKNOWN:
        raise MavhumsError(f"{store}: an unknown aircraft has no trend", "name aircraft with --aircraft")
    flown = [each for each in assessments(store, aircraft) if each.log.start_utc is not None]
    return trend_report(FlightHistory(tuple(map(PastFlight.of, flown))))


def export(store: str | os.PathLike[str], output: str | os.PathLike[str] | None = None) -> pd.DataFrame:
    """Return one row per verdict; also write them to a .csv or .parquet table if one is named.

    Raises
    ------
    MavhumsError
        If the store does not exist, or the table cannot be written.
    """
    from mavhums.core.files import written_whole
    from mavhums.core.table_writers import writer_for

    columns = "aircraft, path, sha256, start_us, vehicle, actuator, condition, worst, friction_nm, airframe"
    answer = (
        Store(store)
        .opened()
        .query(f"SELECT {columns} FROM verdicts ORDER BY aircraft, start_us, path, vehicle, actuator")
    )
    frame: pd.DataFrame = answer.df()
    if output is not None:
        writer = writer_for(Path(output))
        with written_whole(Path(output)) as temporary, writer(temporary) as table:
            table.write(frame)
    return frame
