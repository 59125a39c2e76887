"""Compares a flight that was judged alone with the aircraft's earlier flights.

The comparison is a pure function of the flight's verdicts and of what the earlier flights have left: a link,
one command after each landing, a fleet, and a flight that arrives late give the same result.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from pydantic import TypeAdapter, ValidationError

from mavhums.core.errors import MavhumsError
from mavhums.engine.events import StandaloneAssessment
from mavhums.health.actuator import past as actuator_past
from mavhums.health.axis import past as axis_past
from mavhums.health.decision.baseline import Baseline, BaselineSource, PastSource, of_subject
from mavhums.health.self_baseline.verdict import compare_with_own_flights, without_own
from mavhums.health.verdict import with_advice
from mavhums.health.verdict.actuator import with_refused
from mavhums.health.verdict.motor import compare_motors
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED
from mavhums.results.verdict import Verdict

_LARGEST = 256 << 20


def compared(
    flight: StandaloneAssessment, baselines: BaselineSource, past: PastSource | None = None
) -> Assessment:
    """Return the assessment of a flight, compared with the actuators' own earlier flights.

    Parameters
    ----------
    flight
        The flight, judged alone.
    baselines
        Function that returns the baselines from the earlier flights for an airframe and a time.
    past
        Function that returns the earlier flights for an airframe and a time; None for none.
    """
    started = flight.assessment.log.start_utc
    if started is None:
        said = f"{NOT_COMPARED}: the log has no date (no satellite fix, no clock that was set, no file)"
        return flight.assessment.with_notice(said)
    start, end_s = datetime.fromisoformat(started), flight.assessment.log.duration_s
    judged_by, alone = flight.assessment.airframe, flight.assessment.verdicts
    known = {name: baselines(name, start) for name in {judged_by, *flight.profiles.values()}}
    own_scale = any(verdict.own for verdict in alone)
    flown = {name: past(name, start) for name in {*flight.profiles.values()}} if past and own_scale else {}

    def own(verdict: Verdict, profile: str | None = judged_by) -> Mapping[str, Baseline]:
        return of_subject(known.get(profile, {}), (verdict.vehicle or 0, verdict.actuator))

    def found(verdict: Verdict) -> Verdict:
        if verdict.vehicle is None:
            return verdict
        key = verdict.vehicle, verdict.actuator
        if verdict.subject == "axis":
            return axis_past.compare_with_earlier_flights(
                verdict, own(verdict), start_utc=start, end_s=end_s, false_alarms=flight.false_alarms
            )
        if verdict.subject == "motor" or not verdict.coverage.windows:
            return verdict
        profile = flight.profiles.get(key, "")
        if usual := own(verdict, profile):
            verdict = actuator_past.compare_with_earlier_flights(
                without_own(verdict), usual, start_utc=start, end_s=end_s, false_alarms=flight.false_alarms
            )
        flights = flown.get(profile, {}).get(key, ())
        return with_refused(compare_with_own_flights(verdict, flights, flight.false_alarms))

    verdicts = compare_motors([*map(found, alone)], own, start_utc=start, end_s=end_s)
    both = zip(alone, verdicts, strict=True)
    advised = tuple(one if now is one else with_advice(now) for one, now in both)
    return flight.assessment.model_copy(update={"verdicts": advised})


def packed(flight: StandaloneAssessment) -> bytes:
    """Return a flight as bytes that :func:`unpacked` reads; the numbers are preserved exactly.

    Examples
    --------
    >>> import mavhums
    >>> from mavhums.app.analysis import analyse_alone
    >>> flight = analyse_alone("flight.tlog", mavhums.Options().resolved())
    >>> unpacked(packed(flight)) == flight
    True
    """
    profiles = tuple((*key, profile) for key, profile in flight.profiles.items())
    return zlib.compress(_STORED.dump_json((flight.assessment, profiles, flight.false_alarms), by_alias=True))


def unpacked(data: bytes) -> StandaloneAssessment:
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
    assessment, profiles, false_alarms = content
    named = {(vehicle, actuator): profile for vehicle, actuator, profile in profiles}
    return StandaloneAssessment(assessment, named, false_alarms)


_STORED: TypeAdapter[tuple[Assessment, tuple[tuple[int, str, str], ...], float]] = TypeAdapter(
    tuple[Assessment, tuple[tuple[int, str, str], ...], float]
)
