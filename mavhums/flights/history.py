"""Earlier flights of an aircraft, and what the comparison of the next one takes of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from math import sqrt
from typing import Literal, NamedTuple

from mavhums.core.conditions import URGENCY, Condition
from mavhums.core.errors import MavhumsError
from mavhums.core.statistics import NORMAL_95
from mavhums.flights.aircraft import Since
from mavhums.flights.recordings import FlightRecording, recordings_of, superseded_recordings
from mavhums.health.decision.baseline import LOSSES, Baseline, Baselines, PastRecord
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums.results.assessment import Assessment
from mavhums.results.sections import FlightCopy, FlightIdentity
from mavhums.results.verdict import Evidence, Indicator, Interval, OwnRecord, Verdict

_SOUND = ("normal", "unchanged", "learning")


class UndatedError(MavhumsError):
    """A log has no date, so its flight cannot be ordered in time."""


class PastIndicator(NamedTuple):
    """An indicator of an earlier flight, as a trend needs it.

    Attributes
    ----------
    estimate, low, high
        The value with its 95 % interval.
    error
        Standard error of the flight-to-flight part, which excludes the torque scale.
    highest
        The highest estimate that decided a condition: the mean over a flight may lie below a limit that was
        passed. None where there is none.
    limit, emergency
        As of :class:`mavhums.results.verdict.Indicator`.
    """

    fault: str
    quantity: str
    unit: str
    estimate: float
    low: float
    high: float
    error: float
    highest: float | None
    limit: float | None
    emergency: float | None

    @classmethod
    def of(cls, one: Indicator, evidence: Iterable[Evidence]) -> PastIndicator:
        """Return an indicator of a verdict with this evidence."""
        error = (one.value.high - one.value.low) / (2 * NORMAL_95)
        if one.scatter is not None:
            error = one.scatter / sqrt(one.windows)
        passed = () if one.fault in LOSSES else (each.value for each in evidence if each.kind == one.fault)
        value, highest = one.value, max(passed, default=None)
        kind = one.fault, one.quantity, one.unit
        return cls(*kind, value.estimate, value.low, value.high, error, highest, one.limit, one.emergency)

    @property
    def value(self) -> Interval:
        """The value with its 95 % interval."""
        return Interval(estimate=self.estimate, low=self.low, high=self.high)

    @property
    def is_beyond(self) -> bool:
        """Whether the whole interval lies beyond the limit; over flights that is enough."""
        return self.limit is not None and self.low > self.limit and self.fault not in LOSSES


class PastVerdict(NamedTuple):
    """A verdict on an earlier flight, as comparisons and trends need it: thousands of whole ones are slow.

    Attributes
    ----------
    suspect
        The first suspected fault; None without one.
    friction_nm
        At the end of the flight; None where it is not known.
    indicators
        One for each fault.
    own
        What later flights need of a flight.
    whole
        Returns the verdict itself.
    """

    vehicle: int | None
    subject: Literal["actuator", "axis", "motor"]
    actuator: str
    condition: Condition
    worst: Condition
    suspect: str | None
    friction_nm: float | None
    indicators: Sequence[PastIndicator]
    own: Sequence[OwnRecord]
    whole: Callable[[], Verdict]

    @classmethod
    def of(cls, verdict: Verdict) -> PastVerdict:
        """Return a verdict as the next flights need it."""
        shown: dict[str, PastIndicator] = {}
        for one in verdict.indicators:
            shown.setdefault(one.fault, PastIndicator.of(one, verdict.evidence))
        return cls(
            verdict.vehicle,
            verdict.subject,
            verdict.actuator,
            verdict.condition,
            verdict.worst,
            verdict.suspects[0].fault if verdict.suspects else None,
            verdict.friction_nm.estimate if verdict.friction_nm else None,
            tuple(shown.values()),
            verdict.own,
            lambda: verdict,
        )

    @property
    def gravest(self) -> Condition:
        """As of :class:`mavhums.results.verdict.Verdict`."""
        return max(self.worst, self.condition, key=URGENCY.__getitem__)

    @property
    def is_healthy(self) -> bool:
        """Whether the flight may be a reference of the actuator: normal, and without a suspected fault."""
        return self.condition == self.worst and self.condition in _SOUND and self.suspect is None


@dataclass(frozen=True, slots=True)
class PastFlight:
    """A flight with a date.

    Attributes
    ----------
    path, sha256
        Of its log.
    airframe
        Names of the profiles by which it was judged.
    start, end
        Start and end of its log, UTC.
    verdicts
        Those on its actuators and axes.
    flights
        What the log records: a flight of each vehicle.
    recordings
        Those of them whose board and time are known.
    """

    path: str | None
    sha256: str | None
    airframe: str | None
    start: datetime
    end: datetime
    verdicts: tuple[PastVerdict, ...] = ()
    flights: tuple[FlightIdentity, ...] = ()
    recordings: tuple[FlightRecording, ...] = ()

    @classmethod
    def of(cls, assessment: Assessment) -> PastFlight:
        """Create the past flight of an assessment, with the times of its log.

        Raises
        ------
        UndatedError
            If the log has no date.
        MavhumsError
            If the date or the duration is invalid.
        """
        log = assessment.log
        if log.start_utc is None:
            remedy = "record with a ground station that knows the time"
            raise UndatedError(
                f"{log.path}: its log has no date, so it cannot be ordered among the flights", remedy
            )
        try:
            start = datetime.fromisoformat(log.start_utc)
            start = (start if start.tzinfo else start.replace(tzinfo=UTC)).astimezone(UTC)
            end = start + timedelta(seconds=log.duration_s)
            verdicts = tuple(map(PastVerdict.of, assessment.verdicts))
            of = log.path, log.sha256, assessment.airframe
            return cls(*of, start, end, verdicts, log.flight, recordings_of(assessment))
        except (ValueError, OverflowError) as error:
            problem = f"{log.path}: log.start_utc {log.start_utc[:60]!r} and the duration give no time"
            raise MavhumsError(problem, "analyse its log again") from error

    @property
    def log(self) -> str:
        """What distinguishes its log from every other: its hash, or its path and start."""
        return self.sha256 or f"{self.path} {self.start.isoformat()}"

    @property
    def boots(self) -> tuple[int, tuple[int, str | None, str | None]] | None:
        """The count of boots and whose it is, of a log that only its file dates; None of any other."""
        for flight in self.flights:
            if flight.start_utc is None and flight.boots is not None and flight.board is not None:
                return flight.boots, (flight.vehicle, flight.board, self.airframe)
        return None

    def order(self) -> tuple[datetime, int, str, str]:
        """Return what orders flights in time."""
        return self.start, self.boots[0] if self.boots else 0, self.log, self.airframe or ""

    def slim(self) -> PastFlight:
        """Return the flight as own-scale equations need it; the whole verdicts of many take memory."""
        verdicts = tuple(one._replace(indicators=(), whole=_unknown) for one in self.verdicts)
        return replace(self, verdicts=verdicts)

    def counts(self, actuator: str, since: Since | None) -> bool:
        """Whether the flight began on or after the date from which the actuator's flights count."""
        dates = since or {}
        date = dates.get(actuator, dates.get(None))
        return date is None or self.start >= date


def baselines_of(
    flights: Iterable[PastFlight], airframe: str | None, before: datetime, since: Since | None = None
) -> Baselines:
    """Return the baseline of each actuator's indicators, from its reference flights.

    Reference flights are the first 20 with the indicator in which the actuator was normal and no
    fault was suspected. They never change: a moving baseline would absorb the wear.

    Parameters
    ----------
    flights
        The earlier flights.
    airframe
        Name of the profile; flights judged with another profile do not count, because their aircraft
        or limits differ.
    before
        Start of the flight under evaluation. Only flights that ended by then count: neither an earlier
        assessment of that flight, nor later flights.
    since
        Dates from which flights count.
    """
    return baselines_on(references(flights, airframe, before, since))


def baselines_on(known: Mapping[tuple[int, str, str], Sequence[Indicator]]) -> Baselines:
    """Return the baselines that rest on the first of these indicators."""
    first = ((key, Baseline.of(flown[:REFERENCE_FLIGHTS])) for key, flown in known.items())
    return {key: baseline for key, baseline in first if baseline}


def references(
    flights: Iterable[PastFlight],
    airframe: str | None,
    before: datetime,
    since: Since | None = None,
    most: int = REFERENCE_FLIGHTS,
) -> dict[tuple[int, str, str], list[Indicator]]:
    """Return the indicators on which each baseline rests, of at most so many flights."""
    reference: dict[tuple[int, str, str], list[Indicator]] = {}
    for _, vehicle, verdict in _counted(flights, airframe, before, since):
        for shown in verdict.whole().indicators if verdict.is_healthy else ():
            flown = reference.setdefault((vehicle, verdict.actuator, shown.fault), [])
            if len(flown) < most:
                flown.append(shown)
    return reference


def records_of(
    flights: Iterable[PastFlight], airframe: str | None, before: datetime, since: Since | None = None
) -> dict[tuple[int, str], list[PastRecord]]:
    """Return the data of earlier flights for own-scale equations, by vehicle and actuator.

    The parameters are those of :func:`baselines_of`.
    """
    records: dict[tuple[int, str], list[PastRecord]] = {}
    for flight, vehicle, verdict in _counted(flights, airframe, before, since):
        left = PastRecord(verdict.own, flight.start.isoformat(), verdict.is_healthy)
        records.setdefault((vehicle, verdict.actuator), []).append(left)
    return records


def _counted(
    flights: Iterable[PastFlight], airframe: str | None, before: datetime, since: Since | None
) -> Iterator[tuple[PastFlight, int, PastVerdict]]:
    """Yield the verdicts that count, with flight and vehicle; of a flight in two logs, those of one."""
    ended = [each for each in in_order(flights) if each.end <= before and _judged_by(each, airframe)]
    left_out = superseded(ended)
    for flight in ended:
        for verdict in flight.verdicts:
            vehicle = verdict.vehicle
            if vehicle is None or (flight.log, vehicle) in left_out:
                continue
            if flight.counts(verdict.actuator, since):
                yield flight, vehicle, verdict


def _judged_by(flight: PastFlight, airframe: str | None) -> bool:
    """Whether at least one of a flight's vehicles was judged with a profile."""
    return flight.airframe == airframe or airframe in (flight.airframe or "").split(", ")


def _unknown() -> Verdict:
    raise LookupError("a flight that is kept for its records alone has no whole verdicts")


def superseded(flights: Iterable[PastFlight]) -> dict[tuple[str, int], tuple[str, int]]:
    """Return for each (log, vehicle) that does not count the one that has the same flight and does.

    The flights must be judged by one profile.
    """
    return superseded_recordings(
        {(each.log, record.flight.vehicle): record for each in flights for record in each.recordings}
    )


def counting(flights: Iterable[PastFlight]) -> list[PastFlight]:
    """Return flights in time order with what no better log records of them, by whatever profiles judged."""
    ordered = in_order(flights)
    by_airframe: dict[str | None, list[PastFlight]] = defaultdict(list)
    for flight in ordered:
        by_airframe[flight.airframe].append(flight)
    worse: dict[tuple[str | None, str], set[int | None]] = defaultdict(set)
    for airframe, several in by_airframe.items():
        for log, vehicle in superseded(several):
            worse[airframe, log] |= {vehicle, None}
    found = []
    for flight in ordered:
        left_out = worse.get((flight.airframe, flight.log))
        if left_out is None:
            found.append(flight)
        elif verdicts := tuple(one for one in flight.verdicts if one.vehicle not in left_out):
            found.append(replace(flight, verdicts=verdicts))
    return found


def in_order(flights: Iterable[PastFlight]) -> list[PastFlight]:
    """Return flights in time order; those of a board that only files date in the order of its boots.

    They get each other's dates: copying a log may change the time of its file, and does not change the count
    of boots in it.
    """
    several: dict[object, list[PastFlight]] = defaultdict(list)
    for flight in sorted(flights, key=PastFlight.order):
        several[flight.boots and flight.boots[1]].append(flight)
    ordered = several.pop(None, [])
    for own in several.values():
        booted = sorted(own, key=lambda flight: flight.boots or ())
        for flight, dated in zip(booted, own, strict=True):
            ordered.append(replace(flight, start=dated.start, end=dated.start + (flight.end - flight.start)))
    return sorted(ordered, key=PastFlight.order)


def with_copies(assessment: Assessment, near: Sequence[PastFlight]) -> Assessment:
    """Return the assessment with the names of the other logs of the same flight.

    Parameters
    ----------
    assessment
        Of the log.
    near
        Flights in other logs, judged by the same profile, that may be the same flight.
    """
    if not near:
        return assessment
    flight = PastFlight.of(assessment)
    left_out = superseded([*near, flight])
    named = tuple(
        FlightCopy(
            vehicle=vehicle,
            log=other.path,
            sha256=other.sha256,
            counts=(other.log, vehicle) not in left_out,
        )
        for own in flight.recordings
        for other in near
        for each in other.recordings
        if own.flight.is_same(each.flight) and (vehicle := own.flight.vehicle)
    )
    return assessment.model_copy(update={"log": assessment.log.model_copy(update={"copies": named})})
