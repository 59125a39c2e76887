"""Reports from a store: an aircraft's trends, what changed since a time, and all verdicts as a table.

The store keeps each aircraft's state after each change, beside the verdicts: what changed since yesterday is
the difference of what a reader saw then and what there is now, whatever came late or was judged again.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sqlalchemy import Connection, func, select

from mavhums.core.conditions import SEVERITY
from mavhums.core.errors import MavhumsError
from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.history import PastFlight
from mavhums.flights.naming import foreign_boards
from mavhums.flights.queries import standings
from mavhums.flights.store import Store
from mavhums.flights.store.earlier import flights_within
from mavhums.flights.store.logs import FLOWN, aircraft_id, installed, repairs_of, there_are
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, INDICATOR, LOG, RECORDING, VERDICT, us_of
from mavhums.flights.trends import trend_report
from mavhums.results.standing import (
    Change,
    FailedLog,
    FleetDigest,
    Growth,
    RepairDate,
    SilentAircraft,
    Standing,
    StoreCopy,
    StoreGrowth,
    StoreStatus,
    TrendReport,
)

if TYPE_CHECKING:
    import pandas as pd

SILENT_DAYS: Final = 14.0
"""Days without a flight after which an aircraft is said to be silent; by hand."""

_SOON_FLIGHTS: Final = 10.0
Place = str | os.PathLike[str]
_ORDER: Final = ("new", "worse", "growing", "step", "eased", "gone")


def status(store: Place) -> StoreStatus:
    """Return the contents of a store.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    kept = Store(store).opened()
    with kept.reading() as connection:
        flown = select(AIRCRAFT.c.name, func.count()).join(FLIGHT).group_by(AIRCRAFT.c.name)
        counts: dict[str, int] = dict(connection.execute(flown).all())
        failed = select(LOG.c.problem, LOG.c.remedy).where(LOG.c.problem.is_not(None), ~LOG.c.removed)
        failures = connection.execute(failed.order_by(LOG.c.path)).mappings().all()
        best = FLIGHT.alias()
        copies = (
            select(FLIGHT.c.path.label("log"), best.c.path.label("counted"))
            .join(RECORDING, RECORDING.c.flight_id == FLIGHT.c.id)
            .join(best, best.c.id == RECORDING.c.counted_id)
            .where(RECORDING.c.counted_id.is_not(None))
            .distinct()
            .order_by(FLIGHT.c.path)
        )
        removed = connection.scalar(select(func.count(LOG.c.path.distinct())).where(LOG.c.removed))
        grows = [
            (name, one) for name, several in standings(connection).items() for one in several if one.growth
        ]
        grows.sort(key=lambda one: one[1].rank)
        return StoreStatus(
            judged=sum(counts.values()),
            aircraft=len(counts.keys() - {UNKNOWN}),
            unknown=counts.get(UNKNOWN, 0),
            failures=tuple(FailedLog(**row) for row in failures),
            copies=tuple(StoreCopy(**row) for row in connection.execute(copies).mappings()),
            foreign_boards=tuple(foreign_boards(connection)),
            growing=tuple(StoreGrowth(aircraft=name, standing=one) for name, one in grows),
            removed=removed or 0,
        )


def digest(
    store: str | os.PathLike[str],
    since: datetime,
    until: datetime | None = None,
    *,
    silent_days: float = SILENT_DAYS,
) -> FleetDigest:
    """Return what changed in a fleet since a time.

    Parameters
    ----------
    store
        The store.
    since, until
        Times with a time zone, of logs that came into the store; until now if None.
    silent_days
        Days without a flight after which an aircraft is said to be silent.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    until = until or datetime.now(UTC)
    begin, end = us_of(since), us_of(until)
    with Store(store).opened().reading() as connection:
        before, now = (standings(connection, until_us=at) for at in (begin, end))
        problems = select(LOG.c.problem, LOG.c.remedy).where(LOG.c.problem.is_not(None), ~LOG.c.removed)
        problems = problems.where(LOG.c.scanned_us > begin, LOG.c.scanned_us <= end)
        failed = connection.execute(problems.distinct().order_by(LOG.c.problem)).all()
        came = select(func.count()).where(FLIGHT.c.aircraft_id.is_not(None), FLIGHT.c.came_us > begin)
        flights = connection.scalar(came.where(FLIGHT.c.came_us <= end)) or 0
    changes = [
        change for aircraft in now for change in _changes(aircraft, before.get(aircraft, ()), now[aircraft])
    ]
    changed = {(one.aircraft, one.now.vehicle, one.now.actuator) for one in changes}
    findings = {(name, one.vehicle, one.actuator) for name in now for one in now[name] if one.is_finding}
    silent = [*_silent(now, until, silent_days)]
    newly = [one for one in silent if one.days - (until - since) / timedelta(days=1) <= silent_days]
    return FleetDigest(
        since_utc=since.astimezone(UTC).isoformat(timespec="seconds"),
        until_utc=until.astimezone(UTC).isoformat(timespec="seconds"),
        aircraft=len(now),
        flights=flights,
        changes=tuple(sorted(changes, key=lambda one: (_ORDER.index(one.kind), one.now.rank, one.aircraft))),
        silent=tuple(newly),
        failed=tuple(FailedLog(problem=problem, remedy=remedy) for problem, remedy in failed),
        standing=len(findings - changed),
        silent_longer=len(silent) - len(newly),
    )


def _changes(aircraft: str, before: Sequence[Standing], now: Sequence[Standing]) -> Iterator[Change]:
    then = {(one.vehicle, one.actuator, one.airframe): one for one in before}
    for one in now:
        was = then.get((one.vehicle, one.actuator, one.airframe))
        for kind in _kinds(was, one):
            yield Change(kind=kind, aircraft=aircraft, before=was, now=one)  # type: ignore[arg-type]


def _kinds(was: Standing | None, now: Standing) -> Iterator[str]:
    worse = max(SEVERITY[now.condition], 0)
    old = max(SEVERITY[was.condition], 0) if was else 0
    if worse > old:
        yield "worse" if old else "new"
    elif now.growth and (was is None or was.growth is None or _is_soon(now.growth) > _is_soon(was.growth)):
        # A fault that is reported needs no second line for its growth: its sentence contains it.
        yield "growing"
    elif worse < old:
        yield "eased" if worse or now.growth else "gone"
    elif was is not None and was.growth and not now.growth and not worse:
        yield "gone"
    if now.step and (was is None or was.step is None or was.step.at_utc < now.step.at_utc):
        # One before the reported step is not new: a later one was taken back.
        yield "step"


def _is_soon(growth: Growth) -> int:
    """Return how many limits the growth reaches within ten flights."""
    return sum(left.estimate <= _SOON_FLIGHTS for left in growth.ahead)


def _silent(
    now: Mapping[str, Sequence[Standing]], until: datetime, silent_days: float
) -> Iterator[SilentAircraft]:
    for aircraft in sorted(now):
        last = max(datetime.fromisoformat(one.last_utc) for one in now[aircraft])
        days = (until - last) / timedelta(days=1)
        if days > silent_days:
            yield SilentAircraft(aircraft=aircraft, last_utc=last.isoformat(), days=round(days, 1))


def trend(
    store: str | os.PathLike[str],
    aircraft: str | None = None,
    *,
    actuators: Collection[str] = (),
    faults: Collection[str] = (),
) -> TrendReport:
    """Return the trends of an aircraft's actuators.

    Parameters
    ----------
    store
        The store.
    aircraft
        Its name; None for the only one that there is.
    actuators, faults
        Names to include; all if empty.

    Raises
    ------
    MavhumsError
        If the store does not exist, or does not contain the aircraft, the actuators or the faults.

    Examples
    --------
    >>> import mavhums
    >>> _ = mavhums.analyse("flight.tlog", store="flights.sqlite", keep=True, aircraft="=D-EABC")
    >>> mavhums.trend("flights.sqlite", faults=["friction"]).flights
    1
    """
    return trend_and_flights(store, aircraft, actuators=actuators, faults=faults)[0]


def trend_and_flights(
    store: str | os.PathLike[str], aircraft: str | None = None, **wanted: Collection[str]
) -> tuple[TrendReport, list[PastFlight]]:
    """Return an aircraft's trends, and the flights that they rest on."""
    kept = Store(store).opened()
    with kept.reading() as connection, no_collection():
        name = _the_only(connection, kept) if aircraft is None else aircraft
        if name == UNKNOWN:
            remedy = "name aircraft with --aircraft"
            raise MavhumsError(f"{kept.place}: an unknown aircraft has no trend", remedy)
        whose = aircraft_id(connection, name, creates=False)
        known = flights_within(connection, whose)
        flown = known.latest(None, shown=True)
        if whose is None or not flown:
            raise MavhumsError(f"{kept.place}: no flight of the aircraft {name!r}", there_are(connection))
        _check_shown(kept, flown, **wanted)
        end = flown[-1].end
        report = trend_report(
            flown,
            **wanted,
            since=installed(connection, whose).since(name, end),
            repaired=known.since(end),
            baselines=known.baselines,
        )
        repairs = sorted(repairs_of(connection, whose), key=lambda repair: repair.at)
    dates = tuple(RepairDate(actuator=one.actuator, at_utc=one.at.isoformat()) for one in repairs)
    return report.model_copy(update={"repairs": dates}), flown


def _the_only(connection: Connection, store: Store) -> str:
    names = {*connection.scalars(FLOWN)}
    if len(names) != 1:
        raise MavhumsError(f"{store.place}: of which aircraft? Name it", there_are(connection))
    return str(names.pop())


def _check_shown(
    store: Store,
    flown: Sequence[PastFlight],
    actuators: Collection[str] = (),
    faults: Collection[str] = (),
) -> None:
    """Refuse misspelt names: those that occur in no flight."""
    if not (actuators or faults):
        return
    verdicts = [verdict for flight in flown for verdict in flight.verdicts]
    shown = {indicator.fault for verdict in verdicts for indicator in verdict.indicators}
    for what, names, there in (
        ("actuator", actuators, {verdict.actuator for verdict in verdicts}),
        ("fault", faults, shown | {"friction", "effectiveness"}),
    ):
        for name in {*names} - there:
            remedy = f"the flights show: {', '.join(sorted(there)) or 'none'}"
            raise MavhumsError(f"{store.place}: no flight has the {what} {name!r}", remedy)


_OF_FLIGHT: Final = (
    *("aircraft", "path", "sha256", "start_utc", "vehicle", "actuator", "condition", "worst", "finding"),
    *("estimate", "low", "high", "unit", "limit", "emergency", "suspect", "reason", "airframe"),
)
_OF_VERDICT: Final = ("vehicle", "actuator", "condition", "worst", "finding", "suspect", "reason")
_LEFT: Final = ("flights_to_{}", "flights_to_{}_low", "flights_to_{}_high", "date_{}")
_OF_LAST: Final = (
    *("state", "state_since_utc", "grows", "growth_per_flight"),
    *(name.format(limit) for limit in ("degraded", "emergency") for name in _LEFT),
)
_NUMBERS: Final = (
    *("estimate", "low", "high", "limit", "emergency", "growth_per_flight"),
    *(name for name in _OF_LAST if name.startswith("flights_to")),
)


def export(store: str | os.PathLike[str], output: str | os.PathLike[str] | None = None) -> pd.DataFrame:
    """Return one row per verdict; also write them to a .csv or .parquet table if one is named.

    ``estimate`` with its 95 % interval ``low`` and ``high``, ``unit``, ``limit`` (degraded) and ``emergency``
    are of ``finding``: the suspected fault's indicator, else the friction, else an axis's effectiveness.

    The columns from ``state`` on hold the actuator's state now, in the row of its last flight; they are
    empty in the others. ``state`` is the condition over its flights, ``grows`` what certainly grows, and
    ``flights_to_degraded`` and ``flights_to_emergency`` are its remaining useful life after that flight, with
    95 % interval; an empty high end means that it need not reach the limit. ``date_…`` is the expected day.

    Raises
    ------
    MavhumsError
        If the store does not exist, or the table cannot be written.
    """
    import pandas as pd

    from mavhums.core.output import writer_for, written_whole

    at = (VERDICT.c.flight_id == INDICATOR.c.flight_id) & (VERDICT.c.place == INDICATOR.c.place)
    asked = (
        select(
            *(AIRCRAFT.c.name.label("aircraft"), FLIGHT.c.path, FLIGHT.c.sha256, FLIGHT.c.airframe),
            *(VERDICT.c[name] for name in _OF_VERDICT),
            VERDICT.c.start_us.label("start_utc"),
            *(INDICATOR.c[name] for name in ("estimate", "low", "high", "unit", "emergency")),
            INDICATOR.c.degraded.label("limit"),
        )
        .select_from(VERDICT)
        .join(FLIGHT, FLIGHT.c.id == VERDICT.c.flight_id)
        .join(AIRCRAFT, AIRCRAFT.c.id == VERDICT.c.aircraft_id)
        .outerjoin(INDICATOR, at & (INDICATOR.c.fault == VERDICT.c.finding))
        .where(VERDICT.c.counts)
        .order_by(AIRCRAFT.c.name, VERDICT.c.start_us.nulls_last(), FLIGHT.c.path)
        .order_by(VERDICT.c.vehicle.nulls_last(), VERDICT.c.actuator)
    )
    with Store(store).opened().reading() as connection:
        now = {
            (aircraft, one.vehicle, one.actuator, one.log): one
            for aircraft, several in standings(connection).items()
            for one in several
        }
        rows: list[dict[str, object]] = []
        for row in connection.execute(asked):
            state = now.get((row.aircraft, row.vehicle or 0, row.actuator, row.path))
            rows.append(dict(row._mapping) | (_of_last(state) if state else {}))
    frame = pd.DataFrame(rows, columns=[*_OF_FLIGHT, *_OF_LAST])
    frame = frame.astype(dict.fromkeys(_NUMBERS, float))
    frame["start_utc"] = pd.to_datetime(frame["start_utc"], unit="us", utc=True)
    if output is not None:
        writer = writer_for(Path(output))
        with written_whole(Path(output)) as temporary, writer(temporary) as table:
            table.write(frame)
    return frame


def _of_last(standing: Standing) -> dict[str, object]:
    growth = standing.growth
    columns: dict[str, object] = {"state": standing.condition, "state_since_utc": standing.since_utc}
    if growth is None:
        return columns
    columns |= {"grows": growth.quantity, "growth_per_flight": growth.per_flight.estimate}
    for limit, left in (("degraded", growth.to_degraded), ("emergency", growth.to_emergency)):
        if left is not None:
            values = (left.estimate, left.low, left.high, left.expected_utc)
            columns |= zip((name.format(limit) for name in _LEFT), values, strict=True)
    return columns
