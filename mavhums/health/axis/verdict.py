"""Converts an axis's findings to a verdict, or to a reason and a remedy if there are none."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Final

from mavhums.health.axis.indicators import indicators
from mavhums.health.axis.monitor import AxisFindings
from mavhums.report.assessment import Interval, Since, Suspect, Verdict
from mavhums.vehicle.flight import Flight
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
_BY_TELEMETRY: Final = "judge its actuators by telemetry of their own"
_NEEDED: Final = {"outputs": "the servo outputs", "attitude": "the attitude"}
_RECORD_STREAMS: Final = (
    "record at 3 Hz or more: over MAVLink SERVO_OUTPUT_RAW and ATTITUDE, in a .BIN RCOU and ATT, "
    "in a .ulg actuator_outputs and vehicle_attitude"
)
_BEGINS_IN_FLIGHT: Final = (
    "the log begins in flight: normal is what it was then, and nothing tells whether that was healthy",
    "record from before take-off, or compare with earlier flights (--history)",
)
PROFILE_LINE: Final = (
    "let the ground station download the parameters while it records, or name the outputs in an airframe "
    'file: [[actuators]] with name = "aileron_left", servo = 1, pwm_us = [1100, 1500, 1900], and so on'
)


def why_not_at_all(flight: Flight, kind: str | None = None) -> tuple[str, str] | None:
    """Return the reason why no axis of a vehicle can be judged, and the remedy; None if some may be.

    ``kind`` is the type of vehicle in words, if something other than its flight tells it.

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
        return f"{kind}: {_FIXED_WINGS_ONLY}", _BY_TELEMETRY
    if not kinds:
        reason = "nothing in the log tells what kind of vehicle this is"
        return reason, "record the autopilot's heartbeats as well; a .BIN or .ulg from its start"
    if not kinds & {1, *range(19, 26)}:
        what = " and ".join(_KINDS.get(kind, f"a vehicle of MAV_TYPE {kind}") for kind in sorted(kinds))
        return f"{what}: {_FIXED_WINGS_ONLY}", _BY_TELEMETRY
    missing = [text for name, text in _NEEDED.items() if name not in flight.heard]
    if missing:
        return f"the log lacks {' and '.join(missing)}", _RECORD_STREAMS
    if flight.flown_s == 0:
        speed = f", fastest {flight.fastest:.0f} m/s" if flight.fastest else ""
        reason = f"it never flew forward: not armed, not fast enough, or hovering{speed}"
        return reason, "analyse a flight"
    return None


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
    vehicle: int, findings: AxisFindings, surfaces: Surfaces | None, flight: Flight, start_utc: datetime
) -> Verdict:
    """Return the verdict on one axis of a vehicle that flew."""
    reason, remedy = None, None
    if findings.condition == "undecided":
        reason, remedy = _why_undecided(findings, surfaces, flight)
    elif findings.condition == "normal" and not findings.from_take_off:
        reason, remedy = _BEGINS_IN_FLIGHT
    origin = {} if surfaces is None else {"V1": f"servo outputs, by {_origin(surfaces)}"}
    coverage = findings.coverage
    rounded = coverage.model_copy(update={"moving_fraction": round(coverage.moving_fraction, 4)})
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
        indicators=tuple(indicators(findings)) if surfaces and surfaces.origin != "inferred" else (),
        provenance=origin,
        reason=reason,
        remedy=remedy,
    )


def _origin(surfaces: Surfaces) -> str:
    words = {"parameters": "the log's parameters", "profile": "the airframe profile"}
    return words.get(surfaces.origin, "inference from the flight's beginning")


def _why_undecided(findings: AxisFindings, surfaces: Surfaces | None, flight: Flight) -> tuple[str, str]:
    axis = findings.axis
    if surfaces is None:
        reason = "which outputs move the surfaces is told neither by parameters nor by a profile"
        return f"{reason}, and the flight's beginning does not tell it clearly", PROFILE_LINE
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
