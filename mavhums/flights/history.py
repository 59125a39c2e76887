"""Earlier flights of an aircraft, and what the comparison of the next one takes of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import Since
from mavhums.flights.duplicates import Recording, recordings_of, superseded_recordings
from mavhums.health.decision.baseline import Baseline, Baselines, PastRecord
from mavhums.health.self_baseline.thresholds import REFERENCE_FLIGHTS
from mavhums.results.assessment import Assessment
from mavhums.results.sections import FlightCopy
from mavhums.results.verdict import Indicator, OwnRecord, Verdict

_SOUND = ("normal", "unchanged", "learning")


class UndatedError(MavhumsError):
    """A log has no date, so its flight cannot be ordered in time."""


@dataclass(frozen=True, slots=True)
class PastFlight:
    """A flight with a date.

    Attributes
    ----------
    start, end
        Start and end of its log, UTC.
    recordings
        What the log records: a flight of each vehicle that it identifies.
    """

    assessment: Assessment
    start: datetime
    end: datetime
    recordings: tuple[Recording, ...] = ()

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
            return cls(assessment, start, end, recordings_of(assessment))
        except (ValueError, OverflowError) as error:
            problem = f"{log.path}: log.start_utc {log.start_utc[:60]!r} and the duration give no time"
            raise MavhumsError(problem, "analyse its log again") from error

    @property
    def log(self) -> str:
        """What distinguishes its log from every other: its hash, or its path and start."""
        log = self.assessment.log
        return log.sha256 or f"{log.path} {log.start_utc}"

    @property
    def boots(self) -> tuple[int, tuple[int, str | None, str | None]] | None:
        """The count of boots and whose it is, of a log that only its file dates; None of any other."""
        for flight in self.assessment.log.flight:
            if flight.start_utc is None and flight.boots is not None and flight.board is not None:
                return flight.boots, (flight.vehicle, flight.board, self.assessment.airframe)
        return None

    def order(self) -> tuple[datetime, int, str, str]:
        """Return what orders flights in time."""
        return self.start, self.boots[0] if self.boots else 0, self.log, self.assessment.airframe or ""

    def slim(self) -> PastFlight:
        """Return the flight as a baseline needs it: without usage, evidence, provenance and records."""
        nothing: dict[str, object] = {"evidence": (), "provenance": {}, "own": ()}
        verdicts = tuple(verdict.model_copy(update=nothing) for verdict in self.assessment.verdicts)
        slim = self.assessment.model_copy(update={"verdicts": verdicts, "usage": ()})
        return replace(self, assessment=slim)

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
    reference = references(flights, airframe, before, since)
    return {key: baseline for key, flown in reference.items() if (baseline := Baseline.of(flown))}


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
        for shown in verdict.indicators if is_healthy(verdict) else ():
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
        left = PastRecord(kept_records(verdict), flight.start.isoformat(), is_healthy(verdict))
        records.setdefault((vehicle, verdict.actuator), []).append(left)
    return records


def _counted(
    flights: Iterable[PastFlight], airframe: str | None, before: datetime, since: Since | None
) -> Iterator[tuple[PastFlight, int, Verdict]]:
    """Yield the verdicts that count, with flight and vehicle; of a flight in two logs, those of one."""
    ended = [each for each in in_order(flights) if each.end <= before and _judged_by(each, airframe)]
    left_out = superseded(ended)
    for flight in ended:
        for verdict in flight.assessment.verdicts:
            vehicle = verdict.vehicle
            if vehicle is None or (flight.log, vehicle) in left_out:
                continue
            if flight.counts(verdict.actuator, since):
                yield flight, vehicle, verdict


def _judged_by(flight: PastFlight, airframe: str | None) -> bool:
    """Whether at least one of a flight's vehicles was judged with a profile."""
    judged = flight.assessment.airframe
    return judged == airframe or airframe in (judged or "").split(", ")


def is_healthy(verdict: Verdict) -> bool:
    """Return whether a flight may be a reference of the actuator: normal, and without a suspected fault."""
    found_sound = verdict.condition == verdict.worst and verdict.condition in _SOUND
    return found_sound and not verdict.suspects


def kept_records(verdict: Verdict) -> tuple[OwnRecord, ...]:
    """Return what later flights need of a flight: of an axis only a healthy one is ever compared with."""
    return verdict.own if verdict.subject == "actuator" or is_healthy(verdict) else ()


def superseded(flights: Iterable[PastFlight]) -> dict[tuple[str, int], tuple[str, int]]:
    """Return for each (log, vehicle) that does not count the one that has the same flight and does.

    The flights must be judged by one profile.
    """
    return superseded_recordings(
        {(each.log, record.flight.vehicle): record for each in flights for record in each.recordings}
    )


def superseded_by_profile(flights: Iterable[PastFlight]) -> set[tuple[str | None, str, int]]:
    """Return each (airframe, log, vehicle) that does not count, of flights judged by any profiles."""
    by_airframe: dict[str | None, list[PastFlight]] = defaultdict(list)
    for flight in flights:
        by_airframe[flight.assessment.airframe].append(flight)
    return {
        (airframe, *recording)
        for airframe, several in by_airframe.items()
        for recording in superseded(several)
    }


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
            log=other.assessment.log.path,
            sha256=other.assessment.log.sha256,
            counts=(other.log, vehicle) not in left_out,
        )
        for own in flight.recordings
        for other in near
        for each in other.recordings
        if own.flight.is_same(each.flight) and (vehicle := own.flight.vehicle)
    )
    return assessment.model_copy(update={"log": assessment.log.model_copy(update={"copies": named})})
