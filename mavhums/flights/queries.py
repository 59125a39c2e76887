"""Queries on a fleet's store."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter

from mavhums.core.conditions import URGENCY, Condition
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.compare import unpacked
from mavhums.flights.corrections import installed_in, named_in, repairs_of, since_of
from mavhums.flights.history import FlightHistory, PastFlight
from mavhums.flights.naming import foreign_boards
from mavhums.flights.store import Store, listed_sql
from mavhums.flights.trends import trend_report
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary, exit_code_of
from mavhums.results.standing import RepairDate, Standing, TrendReport
from mavhums.results.store import (
    FailedLog,
    ForeignBoard,
    LastFlightOf,
    StoreCopy,
    StoreGrowth,
    StoreStatus,
)
from mavhums.results.verdict import Verdict

STANDINGS_OF: Final = TypeAdapter(tuple[Standing, ...])
_COLUMNS = "aircraft, path, start_us, vehicle, actuator, condition, worst"
_LAST = f"""
WITH last AS (
    SELECT aircraft, CASE WHEN aircraft = '' THEN path END AS log, vehicle, actuator,
        max(start_us) AS start_us
    FROM verdicts GROUP BY ALL)
SELECT {_COLUMNS} FROM (
    SELECT each.aircraft, each.vehicle, each.actuator, each.start_us, min(each.path) AS path,
        arg_min(each.condition, each.path) AS condition, arg_min(each.worst, each.path) AS worst,
        arg_min(each.urgency, each.path) AS urgency, arg_min(each.friction_nm, each.path) AS friction_nm
    FROM verdicts AS each JOIN last ON each.aircraft = last.aircraft AND each.actuator = last.actuator
        AND each.vehicle IS NOT DISTINCT FROM last.vehicle
        AND each.start_us IS NOT DISTINCT FROM last.start_us AND (last.log IS NULL OR each.path = last.log)
    GROUP BY each.aircraft, last.log, each.vehicle, each.actuator, each.start_us)
ORDER BY urgency DESC, friction_nm DESC NULLS LAST, aircraft, path, vehicle, actuator
"""
"""The actuators in their last flights, the worst first; without the JSON of the verdicts, which is large."""


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
    foreign_boards
        Boards that do not belong to the aircraft in whose flights they are.
    growing
        Actuators that grow, with their aircraft, the most urgent first.
    removed
        Number of logs that were removed.
    """

    judged: int
    aircraft: int
    unknown: int
    failures: tuple[tuple[str, str], ...]
    copies: tuple[tuple[str, str], ...] = ()
    foreign_boards: tuple[ForeignBoard, ...] = ()
    growing: tuple[tuple[str, Standing], ...] = ()
    removed: int = 0

    def published(self) -> StoreStatus:
        """Return it as the object that is written as JSON."""
        return StoreStatus(
            judged=self.judged,
            aircraft=self.aircraft,
            unknown=self.unknown,
            failures=tuple(FailedLog(problem=problem, remedy=remedy) for problem, remedy in self.failures),
            copies=tuple(StoreCopy(log=log, counted=counted) for log, counted in self.copies),
            foreign_boards=self.foreign_boards,
            growing=tuple(StoreGrowth(aircraft=name, standing=one) for name, one in self.growing),
            removed=self.removed,
        )


class OperatorTasks(NamedTuple):
    """What an operator should look into: ``foreign_boards`` and ``removed`` of :class:`Status`."""

    foreign_boards: tuple[ForeignBoard, ...]
    removed: int


class WorstActuator(NamedTuple):
    """An actuator in its aircraft's last flight. ``aircraft`` is empty if it is unknown.

    ``standing`` is how it stands over its flights; None of an unknown aircraft, and in a store of an older
    version until the next flight of the aircraft is scanned.
    """

    aircraft: str
    path: str
    start_us: int | None
    verdict: Verdict
    standing: Standing | None = None

    def published(self) -> LastFlightOf:
        """Return it as the object that is written as JSON."""
        start = None if self.start_us is None else datetime.fromtimestamp(self.start_us / 1e6, tz=UTC)
        return LastFlightOf(
            aircraft=self.aircraft or None,
            log=self.path,
            start_utc=start.isoformat() if start else None,
            verdict=self.verdict,
            standing=self.standing,
        )


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
        "SELECT problem, remedy FROM"
        " (FROM logs QUALIFY row_number() OVER (PARTITION BY path ORDER BY scanned DESC) = 1)"
        " WHERE problem IS NOT NULL ORDER BY path"
    ).fetchall()
    copies = kept.query("SELECT DISTINCT path, counted FROM copies ORDER BY path").fetchall()
    odd = odd_in(store)
    grows = [(name, one) for name, several in standings(kept).items() for one in several if one.growth]
    return Status(
        judged,
        aircraft,
        unknown,
        tuple(failures),
        tuple(copies),
        odd.foreign_boards,
        tuple(sorted(grows, key=lambda one: one[1].rank)),
        odd.removed,
    )


def odd_in(store: str | os.PathLike[str]) -> OperatorTasks:
    """Return what a scan tells besides what it judged; its errors are those of :func:`status`."""
    kept = Store(store).opened()
    (removed,) = kept.query("SELECT count(DISTINCT path) FROM removed").fetchone()
    return OperatorTasks(tuple(foreign_boards(kept)), removed)


def worst(store: str | os.PathLike[str], *, most: int | None = None) -> list[WorstActuator]:
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
    kept = Store(store).opened()
    rows = _ranked(kept)
    chosen = rows if most is None else rows[:most]
    judged = _verdicts_of(kept, {path for (_, path, *_), _ in chosen})
    return [
        WorstActuator(
            aircraft,
            path,
            start_us,
            kept.parsed(judged.__getitem__, (aircraft, path, vehicle, actuator)),
            standing,
        )
        for (aircraft, path, start_us, vehicle, actuator, *_), standing in chosen
    ]


def actuators_in(store: str | os.PathLike[str]) -> int:
    """Return how many actuators and axes :func:`worst` has; its errors are the same."""
    (count,) = Store(store).opened().query(f"SELECT count(*) FROM ({_LAST})").fetchone()
    return int(count)


def _ranked(store: Store) -> list[tuple[tuple[Any, ...], Standing | None]]:
    """Return the actuators in their last flights and how they stand, the worst first."""
    found = {
        (aircraft, one.vehicle, one.actuator): one
        for aircraft, several in standings(store).items()
        for one in sorted(several, key=lambda one: one.last_utc)
    }
    rows = [(row, found.get((row[0], row[3] or 0, row[4]))) for row in store.query(_LAST).fetchall()]

    def rank(row: tuple[tuple[Any, ...], Standing | None]) -> tuple[float, float]:
        (*_, condition, worst), standing = row
        if standing is not None:
            return standing.rank[:2]
        return -float(max(URGENCY[condition], URGENCY[worst])), float("inf")

    return sorted(rows, key=rank)


def standings(store: Store, *, until_ns: int | None = None) -> dict[str, tuple[Standing, ...]]:
    """Return how each aircraft with a name stands, or stood at a time; worst first within each."""
    rows = store.query(
        "SELECT aircraft, arg_max(standings, stored) FROM standings WHERE stored <= ? GROUP BY aircraft",
        until_ns if until_ns is not None else 2**62,
    ).fetchall()
    return {
        aircraft: found
        for aircraft, text in rows
        if (found := store.parsed(STANDINGS_OF.validate_json, text))
    }


def exit_code(store: str | os.PathLike[str]) -> ExitCode:
    """Return the exit code of ``fleet worst``: for the states and last flights, and the failures."""
    rows = _ranked(Store(store).opened())
    found: list[Condition] = []
    for (*_, condition, worst), standing in rows:
        found.append(max(condition, worst, key=URGENCY.__getitem__))
        if standing is not None:
            found += [standing.condition, "degraded" if standing.growth else "normal"]
    code = exit_code_of(found)
    if code not in (ExitCode.EMERGENCY, ExitCode.DEGRADED) and status(store).failures:
        return ExitCode.ERROR
    return code if rows else ExitCode.UNDECIDED


def verdicts(store: str | os.PathLike[str], aircraft: str) -> list[tuple[str, Verdict]]:
    """Return an aircraft's verdicts with its past, each with its log, in time order."""
    kept = Store(store).opened()
    rows = kept.query(
        "SELECT path, verdict FROM"
        " (SELECT *, row_number() OVER () AS place FROM verdicts WHERE aircraft = ?)"
        " ORDER BY start_us, path, place",
        aircraft,
    ).fetchall()
    return [(path, kept.parsed(Verdict.model_validate_json, verdict)) for path, verdict in rows]


def trend(store: str | os.PathLike[str], aircraft: str) -> TrendReport:
    """Return the trends of an aircraft's actuators.

    Raises
    ------
    MavhumsError
        If the store does not exist, or does not contain the aircraft.
    """
    return trend_of(Store(store).opened(), aircraft)


def trend_of(store: Store, aircraft: str) -> TrendReport:
    """Return the trends of an aircraft in an opened store; the errors are those of :func:`trend`."""
    if aircraft == UNKNOWN:
        raise MavhumsError(
            f"{store.place}: an unknown aircraft has no trend", "name aircraft with --aircraft"
        )
    with no_collection():
        flown = tuple(past_flights(store, aircraft))
        if not flown:
            raise MavhumsError(f"{store.place}: no flight of the aircraft {aircraft!r}", named_in(store))
        since = installed_in(store, aircraft).since(aircraft, flown[-1].end)
        repaired = since_of(store, aircraft)(flown[-1].end)
        report = trend_report(FlightHistory(flown), since=since, repaired=repaired)
    repairs = sorted(repairs_of(store, aircraft), key=lambda repair: repair.at)
    told = tuple(RepairDate(actuator=one.actuator, at_utc=one.at.isoformat()) for one in repairs)
    return report.model_copy(update={"repairs": told})


def flights(store: str | os.PathLike[str], aircraft: str) -> list[Assessment]:
    """Return an aircraft's dated flights in time order, with verdicts only: without losses, usage and texts.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    return [flown.assessment for flown in past_flights(Store(store).opened(), aircraft)]


def flight(store: str | os.PathLike[str], aircraft: str, sha256: str) -> Assessment:
    """Return the whole assessment of a log, its verdicts compared with the aircraft's past.

    Raises
    ------
    MavhumsError
        If the store does not exist or does not have the log.
    """
    kept = Store(store).opened()
    row = kept.query(
        "SELECT arg_max(flight, scanned) FROM logs WHERE aircraft = ? AND sha256 = ? AND flight IS NOT NULL",
        aircraft,
        sha256,
    ).fetchone()
    if row is None or row[0] is None:
        raise MavhumsError(f"{store}: no such flight of the aircraft {aircraft!r}", "choose one of its list")
    alone = unpacked(row[0]).assessment
    told = kept.query(
        "SELECT verdict FROM verdicts WHERE aircraft = ? AND sha256 = ?", aircraft, sha256
    ).fetchall()
    if not told:
        return alone
    return alone.model_copy(
        update={"verdicts": tuple(kept.parsed(Verdict.model_validate_json, verdict) for (verdict,) in told)}
    )


def past_flights(store: Store, aircraft: str) -> Iterator[PastFlight]:
    """Yield an aircraft's dated flights in time order, each with its verdicts and the times of its log."""
    rows = store.query(
        "SELECT path, sha256, start_us, airframe, duration_s, list(verdict ORDER BY place) FROM ("
        " SELECT v.*, row_number() OVER () AS place,"
        "  coalesce((SELECT max(duration_s) FROM logs AS l WHERE l.sha256 = v.sha256), 0.0) AS duration_s"
        " FROM verdicts AS v WHERE aircraft = ? AND start_us IS NOT NULL)"
        " GROUP BY ALL ORDER BY start_us, path",
        aircraft,
    ).fetchall()
    for path, sha256, start_us, airframe, duration_s, told in rows:
        start = datetime.fromtimestamp(0, tz=UTC) + timedelta(microseconds=start_us)
        log = LogSummary(
            path=path,
            sha256=sha256,
            start_utc=start.isoformat(),
            duration_s=duration_s,
            vehicles=(),
            losses=Losses(),
        )
        verdicts = tuple(store.parsed(Verdict.model_validate_json, verdict) for verdict in told)
        flight = Assessment(log=log, airframe=airframe, model=None, verdicts=verdicts)
        yield PastFlight(flight, start, start + timedelta(seconds=duration_s))


def _verdicts_of(store: Store, paths: Collection[str]) -> dict[tuple[str, str, int | None, str], Verdict]:
    """Return the verdicts on some logs; literal names let DuckDB skip most of the table."""
    if not paths:
        return {}
    rows = store.query(
        f"SELECT aircraft, path, vehicle, actuator, verdict FROM verdicts WHERE path IN ({listed_sql(paths)})"
    ).fetchall()
    return {(*key,): store.parsed(Verdict.model_validate_json, verdict) for *key, verdict in rows}
