"""Earlier flights of an aircraft, and what the comparison of the next one takes of them.

Two ground stations record one flight, or a ground station and the aircraft's own logger do: the best
recording counts. Which one it is depends on the recordings alone, not on the order of their arrival.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from math import inf
from operator import itemgetter
from typing import NamedTuple, TypeVar

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import Since
from mavhums.health.decision.baseline import Baseline, Baselines, PastRecord
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums.results.assessment import Assessment
from mavhums.results.sections import CLOCKS_APART_S, FlightCopy, FlightIdentity
from mavhums.results.verdict import ALL, Indicator, OwnRecord, Verdict

Key = TypeVar("Key", bound=Hashable)

_SOUND = ("normal", "unchanged", "learning")


class UndatedError(MavhumsError):
    """A log has no date, so its flight cannot be ordered in time."""


class Quality(NamedTuple):
    """How good a recording of a flight is; of two recordings the one with the greater tuple is taken.

    Attributes
    ----------
    judged
        Number of actuators and axes with a verdict other than ``undecided`` and ``unmonitored``.
    decidable
        Number of windows, over all of them, on which a verdict can rest.
    quantities
        Number of measured quantities, over all of them.
    intact
        Whether nothing was lost of the log, nor on its link.
    log
        Hash of the log, so that no two are equal.
    """

    judged: int
    decidable: int
    quantities: int
    intact: bool
    log: str


class FlightRecording(NamedTuple):
    """A vehicle's flight as one log contains it."""

    flight: FlightIdentity
    quality: Quality

    @property
    def boot_s(self) -> float:
        """Boot time of the vehicle, seconds since 1970."""
        return datetime.fromisoformat(self.flight.boot_utc or "").timestamp()


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


def recordings_of(assessment: Assessment) -> tuple[FlightRecording, ...]:
    """Return a recording for each vehicle whose flight the log identifies."""
    log = assessment.log
    return tuple(
        FlightRecording(flight, _quality(assessment, flight.vehicle))
        for flight in log.flight
        if flight.board is not None and _is_dated(flight)
    )


def superseded_recordings(recordings: Mapping[Key, FlightRecording]) -> dict[Key, Key]:
    """Return for each recording that does not count the one of the same flight that is taken.

    The recordings are considered from the best to the worst; a recording counts unless it is of the same
    flight as one that counts already. So the result does not depend on the order of ``recordings``, even
    where one long recording covers two flights that others recorded separately.

    Parameters
    ----------
    recordings
        Recordings by a key of the caller's.

    Examples
    --------
    >>> flight = FlightIdentity(vehicle=1, board="0A", boot_utc="2026-01-01T09:00:00+00:00")
    >>> poor, good = Quality(0, 0, 4, True, "b"), Quality(4, 300, 48, False, "a")
    >>> sent, logged = FlightRecording(flight, poor), FlightRecording(flight, good)
    >>> superseded_recordings({"sent": sent, "logged": logged})
    {'sent': 'logged'}
    """
    found: dict[Key, Key] = {}
    for several in _candidates(recordings):
        taken: list[Key] = []
        for key in sorted(several, key=lambda key: recordings[key].quality, reverse=True):
            flight = recordings[key].flight
            same = next((best for best in taken if flight.is_same(recordings[best].flight)), None)
            if same is None:
                taken.append(key)
            else:
                found[key] = same
    return found


def _candidates(recordings: Mapping[Key, FlightRecording]) -> Iterator[list[Key]]:
    """Yield groups of several recordings whose boot times follow each other closely enough."""
    by_board: dict[tuple[int, str | None], list[tuple[float, Key]]] = defaultdict(list)
    for key, recording in recordings.items():
        by_board[recording.flight.vehicle, recording.flight.board].append((recording.boot_s, key))
    for booted in by_board.values():
        booted.sort(key=itemgetter(0))
        group: list[Key] = []
        last_s = -inf
        for boot_s, key in booted:
            if boot_s - last_s > CLOCKS_APART_S:
                yield from [group] if len(group) > 1 else []
                group = []
            group.append(key)
            last_s = boot_s
        yield from [group] if len(group) > 1 else []


def _quality(assessment: Assessment, vehicle: int) -> Quality:
    log = assessment.log
    own = [each for each in assessment.verdicts if each.vehicle == vehicle and each.actuator != ALL]
    return Quality(
        judged=sum(each.gravest not in ("undecided", "unmonitored") for each in own),
        decidable=sum(each.coverage.decidable for each in own),
        quantities=sum(len(each.provenance) for each in own),
        intact=not log.losses.any and not any(each.missing for each in log.losses.sequence),
        log=log.sha256 or log.path or "",
    )


def _is_dated(flight: FlightIdentity) -> bool:
    """Return whether the boot time is known, and every time is one."""
    times = [time for time in (flight.boot_utc, flight.start_utc, flight.end_utc) if time is not None]
    try:
        return flight.boot_utc is not None and all(datetime.fromisoformat(time).tzinfo for time in times)
    except ValueError:
        return False
