"""Makes the verdicts that are due: a flight that is new, late, repaired or moved, and those after it.

All flights of an aircraft from the first one that is due are compared again with those before, in the order
of time and within one transaction. So the order of arrival changes no verdict.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from contextlib import nullcontext
from datetime import datetime
from typing import Final

from pydantic import TypeAdapter
from sqlalchemy import ColumnElement, Connection, and_, delete, false, func, insert, or_, select, update

from mavhums.core.conditions import URGENCY
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.aircraft import UNKNOWN, AircraftTable, Since
from mavhums.flights.compare import compared, unpacked
from mavhums.flights.history import (
    FlightRecording,
    PastFlight,
    kept_records,
    recordings_of,
    superseded_recordings,
)
from mavhums.flights.store.database import (
    AIRCRAFT,
    FLIGHT,
    INDICATOR,
    JUDGEMENT,
    RECORD,
    RECORDING,
    STANDING,
    VERDICT,
    us_of,
)
from mavhums.flights.store.earlier import OWN, QUALITY, StoredFlights
from mavhums.flights.store.logs import in_parts, installed, now_us, since_of
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.sections import CLOCKS_APART_S, FlightIdentity
from mavhums.results.standing import Standing, TrendReport
from mavhums.results.verdict import Indicator, Verdict

STANDINGS: Final = TypeAdapter(tuple[Standing, ...])
_APART_US: Final = round(CLOCKS_APART_S * 1e6)
_FIRST: Final = -(2**62)


def make_verdicts(connection: Connection, touched: Collection[int] = ()) -> None:
    """Make all verdicts that are due, and keep how their aircraft stand; others that were touched, too."""
    due = connection.scalars(
        select(FLIGHT.c.aircraft_id).where(FLIGHT.c.due, FLIGHT.c.aircraft_id.is_not(None))
    )
    for aircraft in sorted({*due, *touched}):
        name = connection.scalar(select(AIRCRAFT.c.name).where(AIRCRAFT.c.id == aircraft)) or UNKNOWN
        if name == UNKNOWN:
            _judge_unknown(connection, aircraft)
        else:
            _judge(connection, aircraft, name)


def _judge_unknown(connection: Connection, aircraft: int) -> None:
    """Take the verdicts on flights that are compared with no other."""
    due = select(FLIGHT.c.id).where(FLIGHT.c.aircraft_id == aircraft, FLIGHT.c.due)
    for flight in connection.scalars(due).all():
        assessment = _alone(connection, flight).assessment
        _write(connection, flight, aircraft, assessment)
        connection.execute(update(VERDICT).where(VERDICT.c.flight_id == flight).values(last=True))


def _judge(connection: Connection, aircraft: int, name: str) -> None:
    own = FLIGHT.c.aircraft_id == aircraft
    first_us = connection.scalar(select(func.min(FLIGHT.c.start_us)).where(own, FLIGHT.c.due))
    after = _FIRST if first_us is None else first_us
    dated = FLIGHT.c.start_us.is_not(None)
    # one without a date is compared with no other
    undated = and_(FLIGHT.c.start_us.is_(None), FLIGHT.c.due)
    again = and_(dated, FLIGHT.c.start_us >= after) if first_us is not None else FLIGHT.c.id.is_(None)
    flights = (
        connection.execute(
            select(FLIGHT.c.id)
            .where(own, or_(again, undated))
            .order_by(FLIGHT.c.start_us.nulls_first(), FLIGHT.c.path, FLIGHT.c.id)
        )
        .scalars()
        .all()
    )
    since = since_of(connection, aircraft)
    earlier = StoredFlights(lambda: nullcontext(connection), aircraft, since, before_us=after)
    for flight in flights:
        assessment = compared(_alone(connection, flight), earlier.baselines, earlier.past)
        _write(connection, flight, aircraft, assessment)
        if assessment.log.start_utc is not None:
            logs = earlier.add(PastFlight.of(assessment))
            connection.execute(update(FLIGHT).where(FLIGHT.c.sha256.in_(logs)).values(reference=True))
    _choose_recordings(connection, flights)
    _mark_last(connection, aircraft, flights)
    recent, table = earlier.recent(), installed(connection, aircraft)
    stands = trend_of(recent, since, table, name).standings if recent else ()
    found = STANDINGS.dump_json(stands).decode()
    connection.execute(insert(STANDING).values(aircraft_id=aircraft, stored_us=now_us(), standings=found))


def trend_of(
    flown: Sequence[PastFlight],
    since: Callable[[datetime], Since],
    table: AircraftTable,
    aircraft: str,
    **wanted: Collection[str],
) -> TrendReport:
    """Return the trends over an aircraft's flights, at least one; ``wanted`` as of :func:`trend_report`."""
    end = flown[-1].end
    return trend_report(flown, **wanted, since=table.since(aircraft, end), repaired=since(end))


def _alone(connection: Connection, flight: int) -> StandaloneAssessment:
    (data,) = connection.scalars(select(JUDGEMENT.c.alone).where(JUDGEMENT.c.flight_id == flight))
    return unpacked(data)


def _write(connection: Connection, flight: int, aircraft: int, assessment: Assessment) -> None:
    """Replace the verdicts on a flight."""
    for table in (VERDICT, RECORDING):
        connection.execute(delete(table).where(table.c.flight_id == flight))
    log = assessment.log
    start_us = None if log.start_utc is None else us_of(datetime.fromisoformat(log.start_utc))
    done = {"airframe": assessment.airframe, "due": False, "reference": False}
    connection.execute(update(FLIGHT).where(FLIGHT.c.id == flight).values(**done))
    recorded = {each.flight.vehicle: each.quality for each in recordings_of(assessment)}
    keys = {"flight_id": flight, "aircraft_id": aircraft, "start_us": start_us}
    verdicts, indicators, records = [], [], []
    for place, verdict in enumerate(assessment.verdicts):
        verdicts.append(keys | {"place": place} | _row_of(verdict))
        at = {"flight_id": flight, "place": place}
        shown = {one.fault: one for one in reversed(verdict.indicators)}
        indicators += [at | _indicator_row(one) for one in shown.values()]
        if kept := kept_records(verdict):
            records.append(at | {"own": OWN.dump_json(kept).decode()})
    recordings = []
    for each in log.flight:
        quality, row = recorded.get(each.vehicle), {"flight_id": flight, "vehicle": each.vehicle}
        known = {
            "boot_us": us_of(datetime.fromisoformat(each.boot_utc or "")) if quality else None,
            "quality": QUALITY.dump_json(quality).decode() if quality else None,
        }
        recordings.append(row | known | {"board": each.board, "identity": each.model_dump_json()})
    for table, rows in (
        (VERDICT, verdicts),
        (INDICATOR, indicators),
        (RECORD, records),
        (RECORDING, recordings),
    ):
        if rows:
            connection.execute(insert(table), rows)


def _row_of(verdict: Verdict) -> dict[str, object]:
    suspects, shown = [one.fault for one in verdict.suspects], {one.fault for one in verdict.indicators}
    return {
        "vehicle": verdict.vehicle,
        "subject": verdict.subject,
        "actuator": verdict.actuator,
        "condition": verdict.condition,
        "worst": verdict.worst,
        "urgency": float(URGENCY[verdict.gravest]),
        "friction_nm": verdict.friction_nm.estimate if verdict.friction_nm else None,
        "reason": verdict.reason,
        "suspect": suspects[0] if suspects else None,
        "finding": next(
            (fault for fault in (*suspects, "friction", "effectiveness") if fault in shown), None
        ),
        "counts": True,
        "last": False,
        "verdict": verdict.model_dump_json(exclude={"own"}),
    }


def _indicator_row(one: Indicator) -> dict[str, object]:
    known = {name: getattr(one, name) for name in ("fault", "quantity", "unit", "emergency")}
    return known | one.value.model_dump() | {"degraded": one.limit}


def _choose_recordings(connection: Connection, flights: Sequence[int]) -> None:
    """Let one recording count of each flight that several logs record: the best one."""
    window: ColumnElement[bool] = false()
    for part in in_parts(flights):
        columns = (RECORDING.c.board, func.min(RECORDING.c.boot_us), func.max(RECORDING.c.boot_us))
        known = and_(RECORDING.c.flight_id.in_(part), RECORDING.c.boot_us.is_not(None))
        for board, low, high in connection.execute(select(*columns).where(known).group_by(RECORDING.c.board)):
            window = or_(window, _booted_near(connection, board, low, high))
    asked = select(RECORDING, FLIGHT.c.airframe, FLIGHT.c.aircraft_id).join(
        FLIGHT, FLIGHT.c.id == RECORDING.c.flight_id
    )
    by_airframe: dict[object, dict[tuple[int, int], FlightRecording]] = defaultdict(dict)
    for row in connection.execute(asked.where(window)):
        recording = FlightRecording(
            FlightIdentity.model_validate_json(row.identity), QUALITY.validate_json(row.quality)
        )
        by_airframe[row.airframe, row.aircraft_id][row.flight_id, row.vehicle] = recording
    for several in by_airframe.values():
        superseded = superseded_recordings(several) if len(several) > 1 else {}
        for key in several:
            flight, vehicle = key
            better = superseded[key][0] if key in superseded else None
            for table, value in ((RECORDING, {"counted_id": better}), (VERDICT, {"counts": better is None})):
                of = (table.c.flight_id == flight, table.c.vehicle == vehicle)
                connection.execute(update(table).where(*of).values(**value))


def _booted_near(connection: Connection, board: str, low: int, high: int) -> ColumnElement[bool]:
    """Return the condition of the recordings that follow each other closely from some boots on."""
    while True:
        of_board = RECORDING.c.board == board
        near = and_(of_board, RECORDING.c.boot_us.between(low - _APART_US, high + _APART_US))
        ends = select(func.min(RECORDING.c.boot_us), func.max(RECORDING.c.boot_us)).where(near)
        found = connection.execute(ends).one()
        if (low, high) == tuple(found):
            return near
        low, high = found


def _mark_last(connection: Connection, aircraft: int, flights: Sequence[int]) -> None:
    """Mark each actuator's verdicts in its last flight, which may be one of those that are judged again."""
    later = VERDICT.alias()
    newer = (
        select(later.c.flight_id)
        .where(
            later.c.aircraft_id == VERDICT.c.aircraft_id,
            later.c.actuator == VERDICT.c.actuator,
            later.c.vehicle.is_not_distinct_from(VERDICT.c.vehicle),
            later.c.counts,
            later.c.start_us > func.coalesce(VERDICT.c.start_us, _FIRST),
        )
        .exists()
    )
    last = and_(VERDICT.c.counts, ~newer)
    before = and_(VERDICT.c.aircraft_id == aircraft, VERDICT.c.last)
    for changed in (before, *(VERDICT.c.flight_id.in_(part) for part in in_parts(flights))):
        connection.execute(update(VERDICT).where(changed).values(last=last))
