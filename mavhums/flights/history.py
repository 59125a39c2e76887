"""Earlier flights of an aircraft, and each actuator's baseline from them.

They are in memory, or in a place that answers alike.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import KnownAircraft, owners_of
from mavhums.flights.aircraft_table import Since
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
    """One assessment of the history.

    Attributes
    ----------
    start, end
        Start and end of its log, UTC.
    file, written
        Path of the assessment, and its time of modification, seconds since 1970.
    recordings
        What the log records: a flight of each vehicle that it identifies.
    """

    assessment: Assessment
    start: datetime
    end: datetime
    file: Path | None = None
    written: float = float("inf")
    recordings: tuple[Recording, ...] = ()

    @classmethod
    def of(
        cls, assessment: Assessment, file: Path | None = None, written: float = float("inf")
    ) -> PastFlight:
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
                f"{file or log.path}: its log has no date, so it cannot be ordered among the flights", remedy
            )
        try:
            start = datetime.fromisoformat(log.start_utc)
            start = (start if start.tzinfo else start.replace(tzinfo=UTC)).astimezone(UTC)
            end = start + timedelta(seconds=log.duration_s)
            return cls(assessment, start, end, file, written, recordings_of(assessment))
        except (ValueError, OverflowError) as error:
            problem = (
                f"{file or log.path}: log.start_utc {log.start_utc[:60]!r} and the duration give no time"
            )
            raise MavhumsError(problem, "analyse its log again") from error

    @property
    def log(self) -> str:
        """What distinguishes its log from every other: its hash, or its path and start."""
        log = self.assessment.log
        return log.sha256 or f"{log.path} {log.start_utc}"

    @property
    def boots(self) -> tuple[int, tuple[int, str | None, str | None]] | None:
        """The count of boots and whose it is, of a log that only its file dates; None of any other."""
        for one in self.assessment.log.flight:
            if one.start_utc is None and one.boots is not None and one.board is not None:
                return one.boots, (one.vehicle, one.board, self.assessment.airframe)
        return None

    def order(self) -> tuple[datetime, int, str, str]:
        """Return what orders flights in time."""
        return self.start, self.boots[0] if self.boots else 0, self.log, self.assessment.airframe or ""

    def without(self, *fields: str) -> PastFlight:
        """Return the flight without its usage, and without some fields of its verdicts."""
        nothing: dict[str, object] = {name: {} if name == "provenance" else () for name in fields}
        verdicts = tuple(verdict.model_copy(update=nothing) for verdict in self.assessment.verdicts)
        slim = self.assessment.model_copy(update={"verdicts": verdicts, "usage": ()})
        return replace(self, assessment=slim)

    def counts(self, actuator: str, since: Since | None) -> bool:
        """Whether the flight began on or after the date from which the actuator's flights count."""
        dates = since or {}
        date = dates.get(actuator, dates.get(None))
        return date is None or self.start >= date


@dataclass(frozen=True, slots=True)
class FlightHistory:
    """The flights of one aircraft, or of a fleet whose aircraft have different system ids.

    Attributes
    ----------
    flights
        Flights in time order; each log appears once per airframe profile.
    errors
        Files of the folder that could not be read.
    notices
        Files that were ignored without loss of data.
    name
        What it is called in messages.
    """

    flights: tuple[PastFlight, ...] = ()
    errors: tuple[MavhumsError, ...] = ()
    notices: tuple[str, ...] = ()
    name: str = "the history"

    def __post_init__(self) -> None:
        object.__setattr__(self, "flights", _once(self.flights))

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the baseline of each actuator's indicators, from its reference flights.

        Reference flights are the first 20 with the indicator in which the actuator was normal and no
        fault was suspected. They never change: a moving baseline would absorb the wear.

        Parameters
        ----------
        airframe
            Name of the profile; flights judged with another profile do not count, because their aircraft
            or limits differ.
        before
            Start of the flight under evaluation. Only flights that ended by then count: neither an earlier
            assessment of that flight, nor later flights. None (unknown start) gives no baseline.
        since
            Dates from which flights count.
        """
        reference = self.references(airframe, before, since)
        return {key: baseline for key, flown in reference.items() if (baseline := Baseline.of(flown))}

    def references(
        self,
        airframe: str | None,
        before: datetime | None,
        since: Since | None = None,
        most: int = REFERENCE_FLIGHTS,
    ) -> dict[tuple[int, str, str], list[Indicator]]:
        """Return the indicators on which each baseline rests, of at most so many flights."""
        reference: dict[tuple[int, str, str], list[Indicator]] = {}
        for _, vehicle, verdict in self._counted(airframe, before, since):
            for shown in verdict.indicators if is_healthy(verdict) else ():
                flown = reference.setdefault((vehicle, verdict.actuator, shown.fault), [])
                if len(flown) < most:
                    flown.append(shown)
        return reference

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> dict[tuple[int, str], list[PastRecord]]:
        """Return the data of earlier flights for own-scale equations, by vehicle and actuator.

        The parameters are those of :meth:`baselines`.
        """
        records: dict[tuple[int, str], list[PastRecord]] = {}
        for flight, vehicle, verdict in self._counted(airframe, before, since):
            left = PastRecord(kept_records(verdict), flight.start.isoformat(), is_healthy(verdict))
            records.setdefault((vehicle, verdict.actuator), []).append(left)
        return records

    def _counted(
        self, airframe: str | None, before: datetime | None, since: Since | None
    ) -> Iterator[tuple[PastFlight, int, Verdict]]:
        """Yield the verdicts that count, with flight and vehicle; of a flight in two logs, those of one."""
        if before is None:
            return
        flights = [each for each in self.flights if each.end <= before and _judged_by(each, airframe)]
        left_out = superseded(flights)
        for flight in flights:
            for verdict in flight.assessment.verdicts:
                vehicle = verdict.vehicle
                if vehicle is None or (flight.log, vehicle) in left_out:
                    continue
                if flight.counts(verdict.actuator, since):
                    yield flight, vehicle, verdict

    def superseded_recordings(self) -> dict[tuple[str | None, str, int], str]:
        """Return for each (airframe, log, vehicle) that does not count the log that is taken instead."""
        by_airframe: dict[str | None, list[PastFlight]] = defaultdict(list)
        for flight in self.flights:
            by_airframe[flight.assessment.airframe].append(flight)
        return {
            (airframe, log, vehicle): taken
            for airframe, flights in by_airframe.items()
            for (log, vehicle), (taken, _) in superseded(flights).items()
        }

    def recent(self) -> tuple[PastFlight, ...]:
        """Return all flights: they are in memory."""
        return self.flights

    def owners(self) -> list[KnownAircraft]:
        """Return what is known of the aircraft of the flights."""
        known: dict[tuple[int, str | None, str | None], KnownAircraft] = {}
        for flight in self.flights:
            for owner in owners_of(flight.assessment, flight.start):
                first = known.get(owner[:3], owner)
                known[owner[:3]] = owner._replace(starts=(first.starts[0], flight.start))
        return [*known.values()]

    def count(self) -> int:
        """Return the number of flights; one that several logs record is one."""
        left_out = self.superseded_recordings()

        def counts(flight: PastFlight) -> bool:
            where = flight.assessment.airframe, flight.log
            told = [(*where, each.flight.vehicle) in left_out for each in flight.recordings]
            return not (told and all(told))

        return sum(map(counts, self.flights))

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs, judged by the same profile, that may be the same flight."""
        boards = {(each.flight.vehicle, each.flight.board) for each in flight.recordings}
        return [
            other
            for other in self.flights
            if other.assessment.airframe == flight.assessment.airframe
            and other.log != flight.log
            and not boards.isdisjoint((each.flight.vehicle, each.flight.board) for each in other.recordings)
        ]

    def with_flight(self, assessment: Assessment) -> FlightHistory:
        """Return the history with one more flight, if its log has a date."""
        try:
            return replace(self, flights=(*self.flights, PastFlight.of(assessment)))
        except UndatedError:
            return self


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


def _once(flights: Iterable[PastFlight]) -> tuple[PastFlight, ...]:
    """Keep the newest assessment of each log and airframe, in time order."""
    once: dict[tuple[str | None, ...], PastFlight] = {}
    for flight in sorted(flights, key=lambda flight: (flight.written, str(flight.file))):
        once[flight.log, flight.assessment.airframe] = flight
    return tuple(sorted(_by_boots(once.values()), key=PastFlight.order))


def _by_boots(flights: Iterable[PastFlight]) -> Iterator[PastFlight]:
    """Yield the flights; those of a board that only files date get each other's dates in the order of boots.

    Copying a log may change the time of its file, and does not change the count of boots in it.
    """
    several: dict[object, list[PastFlight]] = defaultdict(list)
    for flight in sorted(flights, key=PastFlight.order):
        several[flight.boots and flight.boots[1]].append(flight)
    yield from several.pop(None, ())
    for own in several.values():
        booted = sorted(own, key=lambda flight: flight.boots or ())
        for flight, dated in zip(booted, own, strict=True):
            yield replace(flight, start=dated.start, end=dated.start + (flight.end - flight.start))


class EarlierFlights(Protocol):
    """An aircraft's flights, in memory (:class:`mavhums.flights.history.FlightHistory`) or in a folder.

    Each place answers alike; what it reads to do so differs.
    """

    @property
    def name(self) -> str:
        """What the history is called in messages."""

    @property
    def flights(self) -> tuple[PastFlight, ...]:
        """All flights in time order."""

    @property
    def errors(self) -> tuple[MavhumsError, ...]:
        """Files that could not be read."""

    @property
    def notices(self) -> tuple[str, ...]:
        """Files that were ignored without loss of data."""

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the baseline of each actuator's indicators from the flights that ended before a time."""

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the data of those flights for own-scale equations, by vehicle and actuator."""

    def recent(self) -> Sequence[PastFlight]:
        """Return the flights that tell how the aircraft stands: the latest ones, where there are many."""

    def owners(self) -> list[KnownAircraft]:
        """Return what is known of the aircraft of the flights."""

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs that may be the same flight."""

    def with_flight(self, assessment: Assessment) -> EarlierFlights:
        """Return the flights with one more."""


def is_store(place: str | os.PathLike[str]) -> bool:
    """Return whether a place is a store: a file, or the address of a database.

    Examples
    --------
    >>> is_store("postgresql://fleet@host/fleet"), is_store("flights")
    (True, False)
    """
    return "://" in os.fspath(place) or Path(place).is_file()


def with_duplicate_flights(assessment: Assessment, history: EarlierFlights) -> Assessment:
    """Return the assessment with the names of the history's other logs of the same flight.

    Parameters
    ----------
    assessment
        Of the log.
    history
        The earlier flights; assessments of this log among them do not matter.
    """
    try:
        flight = PastFlight.of(assessment)
    except UndatedError:
        return assessment
    near = history.near(flight) if flight.recordings else []
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
    if not named:
        return assessment
    return assessment.model_copy(update={"log": assessment.log.model_copy(update={"copies": named})})
