"""Earlier flights of an aircraft, and each actuator's baseline from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from mavhums.core.errors import MavhumsError
from mavhums.health.baseline import Baseline, Baselines
from mavhums.health.own.past import REFERENCE_FLIGHTS, PastRecord
from mavhums.report.assessment import Assessment, Indicator, Verdict

__all__ = ["REFERENCE_FLIGHTS", "FlightHistory", "PastFlight", "Since", "UndatedError", "is_healthy"]

_SOUND = ("normal", "unchanged", "learning")

Since = Mapping[str | None, datetime]
"""Dates from which flights count, by actuator, for example after a repair; None applies to all others."""


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
    """

    assessment: Assessment
    start: datetime
    end: datetime
    file: Path | None = None
    written: float = float("inf")

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
            return cls(assessment, start, start + timedelta(seconds=log.duration_s), file, written)
        except (ValueError, OverflowError) as error:
            problem = (
                f"{file or log.path}: log.start_utc: {log.start_utc[:60]!r} and the duration are no time"
            )
            raise MavhumsError(problem, "analyse its log again") from error

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
    """

    flights: tuple[PastFlight, ...] = ()
    errors: tuple[MavhumsError, ...] = ()
    notices: tuple[str, ...] = ()

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
        reference: dict[tuple[int, str, str], list[Indicator]] = {}
        for flight in self.flights:
            if before is None or flight.end > before or not _judged_by(flight, airframe):
                continue
            for verdict in flight.assessment.verdicts:
                if (
                    verdict.vehicle is None
                    or not is_healthy(verdict)
                    or not flight.counts(verdict.actuator, since)
                ):
                    continue
                for shown in verdict.indicators:
                    flown = reference.setdefault((verdict.vehicle, verdict.actuator, shown.fault), [])
                    if len(flown) < REFERENCE_FLIGHTS:
                        flown.append(shown)
        return {key: baseline for key, flown in reference.items() if (baseline := Baseline.of(flown))}

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> dict[tuple[int, str], list[PastRecord]]:
        """Return the data of earlier flights for own-scale equations, by vehicle and actuator.

        The parameters are those of :meth:`baselines`.
        """
        records: dict[tuple[int, str], list[PastRecord]] = {}
        for flight in self.flights:
            if before is None or flight.end > before or not _judged_by(flight, airframe):
                continue
            for verdict in flight.assessment.verdicts:
                if verdict.vehicle is None or not flight.counts(verdict.actuator, since):
                    continue
                left = PastRecord(verdict.own, flight.start.isoformat(), is_healthy(verdict))
                records.setdefault((verdict.vehicle, verdict.actuator), []).append(left)
        return records

    def with_flight(self, assessment: Assessment) -> FlightHistory:
        """Return the history with one more flight, if its log has a date."""
        try:
            return FlightHistory((*self.flights, PastFlight.of(assessment)), self.errors, self.notices)
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


def _once(flights: Iterable[PastFlight]) -> tuple[PastFlight, ...]:
    """Keep the newest assessment of each log and airframe, in time order."""
    once: dict[tuple[str | None, ...], PastFlight] = {}
    for flight in sorted(flights, key=lambda flight: (flight.written, str(flight.file))):
        log = flight.assessment.log
        same = (log.sha256,) if log.sha256 else (log.path, log.start_utc)
        once[*same, flight.assessment.airframe] = flight
    return tuple(sorted(once.values(), key=lambda flight: (flight.start, str(flight.file))))
