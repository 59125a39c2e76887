"""Judges a flight alone, and compares it with the aircraft's earlier flights."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from datetime import datetime
from typing import Any, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.core.errors import MavhumsError
from mavhums.health.axis.past import compare_with_earlier_flights
from mavhums.health.decision.baseline import BaselineSource, of_subject
from mavhums.health.decision.records import ActuatorRecord
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.replay import replay
from mavhums.health.self_baseline.past import PastSource
from mavhums.health.self_baseline.verdict import compare_with_own_flights, without_own
from mavhums.report.assessment import Assessment, Verdict

__all__ = ["LoneFlight", "Records", "compared", "packed", "unpacked"]

Records = Mapping[tuple[int, str], ActuatorRecord]
"""What a flight leaves of each actuator, by vehicle and actuator."""

_LARGEST = 256 << 20


class LoneFlight(NamedTuple):
    """A flight judged by itself.

    Attributes
    ----------
    assessment
        The assessment without any baseline.
    records
        Records of the actuators, by vehicle and actuator.
    profiles
        Name of the profile by which each actuator was judged.
    false_alarms
        Accepted number of false alarms in 100 hours of an actuator or an axis.
    """

    assessment: Assessment
    records: Records
    profiles: Mapping[tuple[int, str], str]
    false_alarms: float = FALSE_ALARMS


def compared(flight: LoneFlight, baselines: BaselineSource, past: PastSource | None = None) -> Assessment:
    """Return the assessment of a flight, compared with the actuators' own earlier flights.

    Parameters
    ----------
    flight
        The flight, judged alone.
    baselines
        Baselines from the earlier flights, or a function that returns them for an airframe and a time.
    past
        Function that returns the earlier flights for an airframe and a time; None for none.
    """
    log = flight.assessment.log
    start = None if log.start_utc is None else datetime.fromisoformat(log.start_utc)
    if start is None:
        return flight.assessment
    profiles = set(flight.profiles.values())
    judged_by = flight.assessment.airframe
    known = {
        name: baselines(name, start) if callable(baselines) else baselines for name in {*profiles, judged_by}
    }
    own_scale = any(verdict.own for verdict in flight.assessment.verdicts)
    flown = {name: past(name, start) for name in profiles} if past and own_scale else {}

    def held(verdict: Verdict) -> Verdict:
        key = (verdict.vehicle or 0, verdict.actuator)
        record, profile = flight.records.get(key), flight.profiles.get(key, "")
        if verdict.subject == "axis":
            own = of_subject(known[judged_by], key)
            return compare_with_earlier_flights(
                verdict, own, start_utc=start, end_s=log.duration_s, false_alarms=flight.false_alarms
            )
        if record is None or not verdict.coverage.windows:
            return verdict
        own = of_subject(known.get(profile, {}), key)
        if own:
            alone = without_own(verdict)
            verdict = replay(alone, record, own, start_utc=start, end_s=log.duration_s)
        return compare_with_own_flights(verdict, flown.get(profile, {}).get(key, ()), record.false_alarms)

    return flight.assessment.model_copy(update={"verdicts": tuple(map(held, flight.assessment.verdicts))})


def packed(flight: LoneFlight) -> bytes:
    """Return a flight as bytes that :func:`unpacked` reads; the numbers are preserved exactly.

    Examples
    --------
    >>> import mavhums
    >>> from mavhums.app.analysis import analyse_alone
    >>> flight = analyse_alone("flight.tlog", mavhums.Options().resolved())
    >>> unpacked(packed(flight)) == flight
    True
    """
    content = _Stored(
        flight.assessment,
        tuple((*key, flight.profiles[key], record) for key, record in flight.records.items()),
        flight.false_alarms,
    )
    return zlib.compress(_STORED.dump_json(content, by_alias=True))


def unpacked(data: bytes) -> LoneFlight:
    """Return the flight in the bytes that :func:`packed` returned.

    Raises
    ------
    MavhumsError
        If the bytes are damaged, or from another version.
    """
    try:
        inflate = zlib.decompressobj()
        text = inflate.decompress(data, _LARGEST)
        content: Any = _STORED.validate_json(text)
    except (zlib.error, ValidationError) as error:
        raise MavhumsError(
            "a stored flight is damaged or of another version", "scan its log again"
        ) from error
    records = {(vehicle, actuator): record for vehicle, actuator, _, record in content.records}
    profiles = {(vehicle, actuator): profile for vehicle, actuator, profile, _ in content.records}
    return LoneFlight(content.assessment, records, profiles, content.false_alarms)


class _Stored(NamedTuple):
    assessment: Assessment
    records: tuple[tuple[int, str, str, ActuatorRecord], ...]
    false_alarms: float = FALSE_ALARMS


_STORED = TypeAdapter(_Stored)
