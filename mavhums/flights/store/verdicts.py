"""Makes the verdicts that are due: a flight that is new, late, repaired or moved, and those after it.

A flight that is due is compared with those before it. So are all flights after it from the first one on that
changes what they are compared with, in the order of time and within one transaction. So the order of arrival
changes no verdict.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from datetime import datetime
from typing import Any, Final

from pydantic import TypeAdapter
from sqlalchemy import (
    ColumnElement,
    Connection,
    and_,
    bindparam,
    delete,
    false,
    func,
    insert,
    or_,
    select,
    update,
)

from mavhums.core.conditions import URGENCY
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.compare import compared, unpacked
from mavhums.flights.history import PastFlight, PastIndicator, PastVerdict
from mavhums.flights.recordings import FlightRecording, recordings_of, superseded_recordings
from mavhums.flights.store.earlier import OF_VERDICT, OWN, QUALITY, flights_within
from mavhums.flights.store.logs import in_parts, installed, now_us
from mavhums.flights.store.tables import (
    AIRCRAFT,
    FLIGHT,
    INDICATOR,
    JUDGEMENT,
    RECORD,
    RECORDING,
    STANDING,
    VERDICT,
    time_of,
    us_of,
)
from mavhums.flights.trends import standings_over
from mavhums.results.assessment import Assessment
from mavhums.results.sections import CLOCKS_APART_S, FlightIdentity
from mavhums.results.standing import Standing
from mavhums.results.verdict import Verdict

STANDINGS: Final = TypeAdapter(tuple[Standing, ...])
_APART_US: Final = round(CLOCKS_APART_S * 1e6)
_FIRST: Final = -(2**62)

# Those that are executed for each of thousands of flights: to make them takes longer than to execute them.
_FLIGHT: Final[Any] = bindparam("flight")
_ALONE: Final = select(JUDGEMENT.c.alone).where(JUDGEMENT.c.flight_id == _FLIGHT)
_CLEARING: Final = [delete(table).where(table.c.flight_id == _FLIGHT) for table in (VERDICT, RECORDING)]
_JUDGED: Final = (
    update(FLIGHT)
    .where(FLIGHT.c.id == _FLIGHT)
    .values(airframe=bindparam("profile"), due=False, reference=False)
)
_INSERTING: Final = {table.name: insert(table) for table in (VERDICT, INDICATOR, RECORD, RECORDING)}


def make_verdicts(connection: Connection, touched: Collection[int] = ()) -> None:
    """Make all verdicts that are due, and keep their aircraft's states; others that were touched, too."""
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
    # one without a date is compared with no other
    undated = and_(FLIGHT.c.start_us.is_(None), FLIGHT.c.due)
    again = false() if first_us is None else FLIGHT.c.start_us >= after
    rows = select(FLIGHT.c.id, FLIGHT.c.due, FLIGHT.c.reference).where(own, or_(again, undated))
    flights = connection.execute(
        rows.order_by(FLIGHT.c.start_us.nulls_first(), FLIGHT.c.path, FLIGHT.c.id)
    ).all()
    earlier = flights_within(connection, aircraft, before_us=after)
    judged: list[int] = []
    differs = first_us is not None and _have_records(connection, aircraft, after)
    if differs:
        earlier.forget_after(time_of(after))
    for flight, due, was_reference in flights:
        if not (due or differs):  # the earlier flights are those with which it was compared
            continue
        assessment = compared(_alone(connection, flight), earlier.baselines, earlier.past)
        _write(connection, flight, aircraft, assessment)
        judged.append(flight)
        if assessment.log.start_utc is None:
            continue
        flown = PastFlight.of(assessment)
        near = earlier.near(flown)
        logs = earlier.add(flown, near)
        if logs:
            connection.execute(update(FLIGHT).where(FLIGHT.c.sha256.in_(logs)).values(reference=True))
        records = any(verdict.own for verdict in assessment.verdicts)
        if not differs and (was_reference or logs or near or records):
            differs = True
            earlier.forget_after(flown.start, flown.path or "")
    _choose_recordings(connection, judged)
    _mark_last(connection, aircraft, judged)
    recent = earlier.recent()
    end = recent[-1].end if recent else time_of(0)
    swapped, repaired = installed(connection, aircraft).since(name, end), earlier.since(end)
    states = standings_over(recent, since=swapped, repaired=repaired, baselines=earlier.baselines)
    found = STANDINGS.dump_json(states).decode()
    connection.execute(insert(STANDING).values(aircraft_id=aircraft, stored_us=now_us(), standings=found))


def _have_records(connection: Connection, aircraft: int, after_us: int) -> bool:
    """Return whether a flight from a time on is compared by records: these number all flights before it."""
    asked = select(RECORD.c.place).join(VERDICT, OF_VERDICT)
    own = (VERDICT.c.aircraft_id == aircraft, VERDICT.c.start_us >= after_us, RECORD.c.own.is_not(None))
    return connection.scalar(asked.where(*own).limit(1)) is not None


def _alone(connection: Connection, flight: int) -> StandaloneAssessment:
    (data,) = connection.scalars(_ALONE, {"flight": flight})
    return unpacked(data)


def _write(connection: Connection, flight: int, aircraft: int, assessment: Assessment) -> None:
    """Replace the verdicts on a flight."""
    for clearing in _CLEARING:
        connection.execute(clearing, {"flight": flight})
    connection.execute(_JUDGED, {"flight": flight, "profile": assessment.airframe})
    log = assessment.log
    start_us = None if log.start_utc is None else us_of(datetime.fromisoformat(log.start_utc))
    recorded = {each.flight.vehicle: each.quality for each in recordings_of(assessment)}
    keys = {"flight_id": flight, "aircraft_id": aircraft, "start_us": start_us}
    verdicts, indicators, records = [], [], []
    for place, verdict in enumerate(assessment.verdicts):
        past, at = PastVerdict.of(verdict), {"flight_id": flight, "place": place}
        verdicts.append(keys | at | _row_of(verdict, past))
        indicators += [at | _indicator_row(one) for one in past.indicators]
        own = OWN.dump_json(verdict.own).decode() if verdict.own else None
        records.append(at | {"own": own, "verdict": verdict.model_dump_json(exclude={"own"})})
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
            connection.execute(_INSERTING[table.name], rows)


def _row_of(verdict: Verdict, past: PastVerdict) -> dict[str, object]:
    shown = {one.fault for one in past.indicators}
    finding = (*(one.fault for one in verdict.suspects), "friction", "effectiveness")
    row: dict[str, object] = dict(zip(PastVerdict._fields[:7], past, strict=False))
    return row | {
        "urgency": float(URGENCY[verdict.gravest]),
        "reason": verdict.reason,
        "finding": next((fault for fault in finding if fault in shown), None),
        "counts": True,
        "last": False,
    }


def _indicator_row(one: PastIndicator) -> dict[str, object]:
    row = one._asdict()
    return row | {"degraded": row.pop("limit")}


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
