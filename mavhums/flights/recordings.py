"""Recordings of one flight: two ground stations, or a ground station and the aircraft's own logger, make two.

The best recording counts. Which one it is depends on the recordings alone, not on the order of their arrival.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping
from datetime import datetime
from math import inf
from operator import itemgetter
from typing import NamedTuple, TypeVar

from mavhums.results.assessment import Assessment
from mavhums.results.sections import CLOCKS_APART_S, FlightIdentity
from mavhums.results.verdict import ALL

Key = TypeVar("Key", bound=Hashable)


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
