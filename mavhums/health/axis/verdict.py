"""Converts an axis's findings to a verdict, or to a reason and a remedy if there are none."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from types import MappingProxyType
from typing import Final

from mavhums.health.axis.indicators import indicators
from mavhums.health.axis.monitor import AxisFindings
from mavhums.health.obstacles import NO_WINGS
from mavhums.report.assessment import Interval, Since, Suspect, Verdict
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.order import Received
from mavhums.vehicle.surfaces import Surfaces

__all__ = ["judged_axis", "unjudged_axes", "why_not_at_all"]

_REFERENCE_S: Final = 45
_DOUBTED_S: Final = 10
_KINDS: Final = {
    2: "a quadrotor",
    3: "a coaxial helicopter",
    4: "a helicopter",
    10: "a ground rover",
    11: "a boat",
    12: "a submarine",
    13: "a hexarotor",
    14: "an octorotor",
    15: "a tricopter",
    29: "a dodecarotor",
}
_WINGED: Final = ("fixed wing", "VTOL")
_FIXED_WINGS_ONLY: Final = "control effectiveness is judged for fixed-wing aircraft in forward flight only"
_NEEDED: Final = {"outputs": "the servo outputs", "attitude": "the attitude"}
_RECORD_STREAMS: Final = (
    "record at 3 Hz or more: over MAVLink SERVO_OUTPUT_RAW and ATTITUDE, in a .BIN RCOU and ATT, "
    "in a .ulg actuator_outputs and vehicle_attitude"
)
_IN_ORDER: Final = "record on board, or over a link that keeps the order of the messages"
_MUCH: Final = 0.2  # of a stream: below, its verdicts hardly change
_BEGINS_IN_FLIGHT: Final = (
    "the log begins in flight: normal is what it was then, and nothing tells whether that was healthy",
    "record from before take-off, or compare with earlier flights (--history)",
)
PROFILE_LINE: Final = (
    "let the ground station download the parameters while it records, or name the outputs in an airframe "
    'file: [[actuators]] with name = "aileron_left", servo = 1, pwm_us = [1100, 1500, 1900], and so on'
)
_CORRECT: Final = (
    "correct these outputs in the profile, draft one from the log's parameters "
    "(`mavhums profile new LOG -o mine.toml`), or leave out --airframe"
)


def why_not_at_all(
    flight: Flight, kind: str | None = None, received: Mapping[str, Received] = MappingProxyType({})
) -> tuple[str, str] | None:
    """Return the reason why no axis of a vehicle can be judged, and the remedy; None if some may be.

    ``kind`` is the type of vehicle in words, if something other than its flight tells it; ``received`` the
    numbers of samples by message.

    Examples
    --------
    >>> from mavhums.vehicle.flight import Flight
    >>> why_not_at_all(Flight(None))[0]
    'nothing in the log tells what kind of vehicle this is'
    >>> why_not_at_all(Flight(None), "multirotor")[0].partition(":")[0]
    'multirotor'
    """
    kinds = flight.kinds
    if not kinds and kind and not kind.startswith(_WINGED):
        return f"{kind}: {_FIXED_WINGS_ONLY}", NO_WINGS
    if not kinds:
        reason = "nothing in the log tells what kind of vehicle this is"
        return reason, "record the autopilot's heartbeats as well; a .BIN or .ulg from its start"
    if not kinds & {1, *range(19, 26)}:
        what = " and ".join(_KINDS.get(kind, f"a vehicle of MAV_TYPE {kind}") for kind in sorted(kinds))
        return f"{what}: {_FIXED_WINGS_ONLY}", NO_WINGS
    missing = [text for name, text in _NEEDED.items() if name not in flight.heard]
    if missing and (disorder := _disorder(received)):
        return f"{' and '.join(missing)} came too late to be used: {disorder}", _IN_ORDER
    if missing:
        return f"the log lacks {' and '.join(missing)}", _RECORD_STREAMS
    if flight.flown_s == 0:
        speed = f", fastest {flight.fastest:.0f} m/s" if flight.fastest else ""
        reason = f"it never flew forward: not armed, not fast enough, or hovering{speed}"
        return reason, "analyse a flight"
    return None


def _disorder(received: Mapping[str, Received]) -> str:
    """Return which messages lost much of their samples because they came too late; empty if none did.

    Examples
    --------
    >>> _disorder({"ATTITUDE": Received(2, 500, 0), "RAW_IMU": Received(500, 2, 0)})
    'of ATTITUDE 2 of 502 samples came in time'
    """
    return ", ".join(
        f"of {message} {kept} of {kept + late} samples came in time"
        for message, (kept, late, _) in received.items()
        if late > _MUCH * (kept + late)
    )


def unjudged_axes(vehicle: int, reason: str, remedy: str) -> Verdict:
    """Return the single verdict on all axes of a vehicle if none can be judged."""
    return Verdict(
        subject="axis",
        vehicle=vehicle,
        actuator="axes",
        condition="undecided",
        worst="undecided",
        reason=reason,
        remedy=remedy,
    )


def judged_axis(
    vehicle: int,
    findings: AxisFindings,
    surfaces: Surfaces | None,
    flight: Flight,
    start_utc: datetime,
    received: Mapping[str, Received] = MappingProxyType({}),
) -> Verdict:
    """Return the verdict on one axis of a vehicle that flew, with the numbers of samples by message."""
    reason, remedy = None, None
    if findings.condition == "undecided":
        reason, remedy = _why_undecided(findings, surfaces, flight)
        if disorder := _disorder(received):
            reason = f"{reason}; {disorder}"
    elif findings.condition == "normal" and not findings.from_take_off:
        reason, remedy = _BEGINS_IN_FLIGHT
    axis = findings.axis
    refused = surfaces is not None and axis in surfaces.contradicted
    origin = {} if surfaces is None else {"V1": f"servo outputs, by {_origin(surfaces, axis)}"}
    coverage = findings.coverage
    late = sum(counts.late for counts in received.values())
    rounded = coverage.model_copy(
        update={"moving_fraction": round(coverage.moving_fraction, 4), "late": late}
    )
    return Verdict(
        subject="axis",
        vehicle=vehicle,
        actuator=findings.axis,
        surfaces=surfaces.names(findings.axis) if surfaces else (),
        condition=findings.condition,
        worst=findings.worst,
        since=_since(findings.since_s, start_utc),
        coverage=rounded,
        suspects=tuple(Suspect(fault=s.fault, confidence=round(s.confidence, 4)) for s in findings.suspects),
        evidence=tuple(e.model_copy(update={"value": round(e.value, 4)}) for e in findings.evidence),
        effectiveness=_rounded(findings.effectiveness),
        limits=findings.limits,
        # Inferred outputs, and those instead of a profile's, have another scale than in other flights.
        indicators=tuple(indicators(findings))
        if surfaces and surfaces.origin != "inferred" and not refused
        else (),
        provenance=origin,
        reason=reason,
        remedy=remedy,
    )


def _origin(surfaces: Surfaces, axis: str) -> str:
    words = {"parameters": "the log's parameters", "profile": "the airframe profile"}
    if axis in surfaces.by_log:
        contradicts = axis in surfaces.contradicted
        return f"{words['parameters']}{', which contradict the airframe profile' if contradicts else ''}"
    return words.get(surfaces.origin, "inference from the flight's beginning")


def _why_undecided(findings: AxisFindings, surfaces: Surfaces | None, flight: Flight) -> tuple[str, str]:
    axis = findings.axis
    if surfaces is None:
        reason = "which outputs move the surfaces is told neither by parameters nor by a profile"
        return f"{reason}, and the flight's beginning does not tell it clearly", PROFILE_LINE
    late = findings.reference is None and findings.usable_s < _REFERENCE_S
    against = surfaces.contradicted.get(axis) or (axis == "yaw" and surfaces.contradicted.get("roll"))
    if against and (late or not surfaces.of_axis(axis)):
        return against, _CORRECT
    if not surfaces.of_axis(axis):
        return f"no output of this vehicle is known to move it in {axis}", PROFILE_LINE
    if flight.doubted_s >= _DOUBTED_S:
        reason = f"for {flight.doubted_s} s the airspeed sensor contradicts ground speed and wind"
        return f"{reason}, so that the rest is too little", "inspect the pitot tube, then fly again"
    if findings.reference is None:
        return _no_reference(findings, flight)
    coverage = findings.coverage
    return (
        f"{coverage.decidable} of {coverage.windows} seconds since the reference were excited enough, "
        "30 are needed",
        "analyse a longer flight, or one with more turns and climbs",
    )


def _no_reference(findings: AxisFindings, flight: Flight) -> tuple[str, str]:
    axis, best = findings.axis, findings.best
    if findings.usable_s < _REFERENCE_S:
        reason = f"{findings.usable_s} s of forward flight with known outputs, {_REFERENCE_S} are needed"
        return reason, "analyse a longer flight"
    if findings.spacing_s > findings.slowest_s:
        needed = 10 if axis == "pitch" else 3
        reason = f"the servo outputs or the rates come {1 / findings.spacing_s:.1f} times a second"
        return (
            f"{reason}, {needed} are needed to judge {axis}",
            "record the servo outputs, the gyro and the attitude at 10 Hz or more",
        )
    missing = {"pitch": "force", "yaw": "force"}.get(axis)
    if missing and missing not in flight.heard:
        return f"the log lacks the accelerometer, which {axis} needs", "record RAW_IMU or SCALED_IMU"
    share = 0.0 if best is None else best.explained
    if axis == "yaw":
        reason = (
            f"rudder and aileron cannot be told apart: the rudder explains {100 * share:.0f} % of the side "
            "force that the ailerons leave, 50 % are needed"
        )
        return reason, "pulse the rudder alone for a few seconds early in the flight"
    reason = (
        f"the first minutes excite it too little, or the streams are too slow: its surfaces explain "
        f"{100 * share:.0f} % of how it moves"
    )
    return reason, "record the servo outputs, the gyro and the attitude at 10 Hz or more"


def _since(since_s: float | None, start_utc: datetime) -> Since | None:
    if since_s is None:
        return None
    utc = start_utc + timedelta(seconds=since_s)
    return Since(flight_time_s=round(since_s, 3), utc=utc.astimezone(UTC).isoformat())


def _rounded(interval: Interval | None) -> Interval | None:
    if interval is None:
        return None
    return Interval(**{name: round(number, 3) for name, number in interval})
