"""The first reason why a vehicle without a profile has no verdict, and its remedy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from mavhums.actuator.telemetry import TO_BE_JUDGED, Tier
from mavhums.health.axis.findings import AxisFindings
from mavhums.health.axis.thresholds import (
    DOUBTED_AIRSPEED_S,
    LEAST_SPEED_SHARE,
    MOST_BANK_DEG,
    MOST_LATE_SHARE,
    MOST_PITCH_DEG,
    NEEDED_HZ,
    NEEDED_PITCH_HZ,
    NORMAL_EFFECTIVENESS,
    NORMAL_S,
    REFERENCE_S,
)
from mavhums.vehicle.flight import GROUND, LEAST_DRIVEN, Flight
from mavhums.vehicle.formats import messages_of, remedy
from mavhums.vehicle.grid import GAP_S, Received
from mavhums.vehicle.identity import PERIPHERALS, Identity, in_words
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import STEERING, Surfaces, steers_by_wheels
from mavhums.vehicle.vtol import LEAST_SPEED

NO_WINGS = "its servos can be judged if they report current or speed: name a profile with --airframe"
"""Remedy for a vehicle that no control surface turns in flight."""
PROPELLERS_ONLY = "if it moves a surface by a servo after all, name its profile with --airframe"
"""Remedy for a vehicle that flies by its propellers alone."""
WEAR_UNSEEN = "no servo current or speed in the log, so wear cannot be seen"
"""Reason for a servo without telemetry."""
_DRAFT = (
    "name one with --airframe: `mavhums profile new LOG -o mine.toml` drafts it from the log's parameters"
)
_JUDGED_S: Final = REFERENCE_S + NORMAL_S
_WINGED: Final = ("fixed wing", "VTOL", "quadplane", "tiltrotor", "tailsitter")
_WINGED_TYPES: Final = {1, *range(19, 26)}
_FIXED_WINGS_ONLY: Final = "control effectiveness is judged for fixed-wing aircraft in forward flight only"
_LONGER: Final = f"choose a log with {_JUDGED_S} s or more of forward flight"
_LONGER_DRIVE: Final = f"choose a log with {_JUDGED_S} s or more of driving forward, with turns"
_IN_ORDER: Final = "record on board, or over a link that keeps the order of the messages"
_OUTPUTS: Final = messages_of("outputs")
_MOST_DECIMALS: Final = 6  # what is closer is equal
_NEEDED: Final = {"outputs": "the servo outputs", "attitude": "the attitude"}
_ACCELEROMETER: Final = ("pitch", "yaw")
_NAMES: Final = {"roll": "aileron_left", "pitch": "elevator", "yaw": "rudder"}
_STOPPED: Final = {
    "vtol": "its VTOL state was not forward flight",
    "mode": "it was in a hovering mode",
    "ground": "it reported to be on the ground",
    "slow": "its ground speed was below 5 m/s",
    "lift": "the lift motors carried it",
}
_CORRECT: Final = (
    "correct these outputs in the profile, draft one from the log's parameters "
    "(`mavhums profile new LOG -o mine.toml`), or leave out --airframe"
)


def obstacle(tier: Tier | None, identity: Identity | None = None) -> tuple[str, str]:
    """Return reason and remedy for a vehicle without a profile.

    The remedy asks for a profile only if the log carries telemetry that could be judged with one, and never
    for a packaged one: those are of other aircraft, and a log that is of one names it.

    Examples
    --------
    >>> obstacle(None, Identity(1, "quadrotor", multirotor=True))[0]
    'quadrotor: a multirotor has no control surfaces whose servos could be judged'
    """
    who = f"{identity}: " if identity is not None and str(identity) else ""
    if identity is not None and identity.multirotor:
        reason = "a multirotor has no control surfaces whose servos could be judged"
        if tier is not None and tier.from_esc:
            reason += "; its ESC telemetry is that of the propellers"
        return who + reason, PROPELLERS_ONLY
    if tier is None:
        return f"{who}the log carries nothing of the actuators", TO_BE_JUDGED
    if not tier.judged:
        return f"{who}{WEAR_UNSEEN}", TO_BE_JUDGED
    reason = "no airframe profile: one actuator's limits say nothing about another's"
    if tier.from_esc:
        reason += ", and an ESC may drive a propeller: only a profile tells which drives a servo"
    return who + reason, _DRAFT


class Obstacle(NamedTuple):
    """A requirement that is not met, and what to do about it."""

    reason: str
    remedy: str


def why_not_at_all(
    flight: Flight,
    kind: str | None = None,
    received: Mapping[str, Received] = MappingProxyType({}),
    parameters: Parameters | None = None,
) -> Obstacle | None:
    """Return the reason why no axis of a vehicle can be judged, and the remedy; None if some may be.

    ``kind`` is the type of vehicle in words, if something other than its flight tells it; ``received`` the
    numbers of samples by message; ``parameters`` those of the vehicle, which tell how a rover steers.

    Examples
    --------
    >>> from mavhums.vehicle.flight import Flight
    >>> why_not_at_all(Flight(None))[0]
    'nothing in the log tells what kind of vehicle this is'
    >>> why_not_at_all(Flight(None), "multirotor")[0].partition(":")[0]
    'multirotor'
    """
    kinds = flight.kinds - PERIPHERALS.keys() or flight.kinds
    if flight.on_ground:
        if not flight.steers:
            return _unsteered(" and ".join(map(in_words, sorted(kinds))), parameters)
    elif kind and not kind.startswith(_WINGED) and not kinds & _WINGED_TYPES:
        kinds = set() if not kinds or kind == "helicopter" else kinds
        if not kinds:
            return Obstacle(f"{kind}: {_FIXED_WINGS_ONLY}", NO_WINGS)
    if not kinds and not flight.on_ground:
        reason = "nothing in the log tells what kind of vehicle this is"
        return Obstacle(reason, "record the autopilot's heartbeats as well; a .BIN or .ulg from its start")
    if not kinds & _WINGED_TYPES and not flight.on_ground:
        return Obstacle(f"{' and '.join(map(in_words, sorted(kinds)))}: {_FIXED_WINGS_ONLY}", NO_WINGS)
    # Of a receiver that drives the servos, each axis tells.
    heard = flight.heard | ({"outputs"} if flight.by_receiver else set())
    missing = {name: words for name, words in _NEEDED.items() if name not in heard}
    told = " and ".join(missing.values())
    # The messages are there: recording more of them would not help.
    if missing and (late := disorder(received)):
        return Obstacle(f"{told} came too late to be used: {late}", _IN_ORDER)
    # Outputs without pulses: ArduPilot writes 0 while the safety switch is on.
    silent = next((name for name in received if name in _OUTPUTS and received[name].kept), None)
    if [*missing] == ["outputs"] and silent and received[silent].kept * GAP_S > flight.lasted_s("recorded"):
        reason = f"the servo outputs are recorded ({received[silent].kept:,} {silent}) and carry no pulses"
        return Obstacle(
            f"{reason}: the safety switch is on, or another device drives the servos",
            "release the safety switch and arm; nothing more needs to be recorded",
        )
    if missing:
        return Obstacle(without(missing, flight, received), to_record("motion", flight, received))
    if flight.flown_s == 0:
        return _stood(flight)
    return None


def without(missing: Mapping[str, str], flight: Flight, received: Mapping[str, Received]) -> str:
    """Return which signals a log lacks; of those that come too rarely to be followed, how often they come."""
    recorded_s, lacking, rare = flight.lasted_s("recorded"), [], []
    for name, words in missing.items():
        kept = max((received[one].kept for one in messages_of(name) & received.keys()), default=0)
        if 0 < kept < NEEDED_HZ * recorded_s:
            rare.append(f"{words} come {kept / recorded_s:.2g} times a second, {NEEDED_HZ} are needed")
        else:
            lacking.append(words)
    return "; ".join([*([f"the log lacks {' and '.join(lacking)}"] if lacking else []), *rare])


def _unsteered(who: str, parameters: Parameters | None) -> Obstacle:
    """Return why the steering of a rover or a boat is not known."""
    if parameters is None:
        return Obstacle(
            f"{who}: which output steers it is told by nothing in the log",
            "record the parameters, too (refresh the ground station's list, or use the on-board log)",
        )
    if steers_by_wheels(parameters):
        reason = f"{who}: it steers by the difference of its motors (skid steering), which is not judged"
        return Obstacle(reason, NO_WINGS)
    reason = f"{who}: its parameters name no output that steers it (SERVOn_FUNCTION 26)"
    return Obstacle(reason, "if one does, set its function, and record the parameters, too")


def _stood(flight: Flight) -> Obstacle:
    """Return why a flight has no second of forward flight."""
    least, said, longer = LEAST_SPEED, "it never flew forward", _LONGER
    if flight.on_ground:
        least = max(LEAST_DRIVEN[kind] for kind in flight.kinds & GROUND or GROUND)
        said, longer = "it did not drive forward for 3 s", _LONGER_DRIVE
    elif not flight.lasted_s("armed"):
        return Obstacle(f"{said}: it was never armed", longer)
    elif not flight.heard & {"airspeed", "groundspeed", "velocity"}:
        return Obstacle(
            "whether it flew forward is not known: the log tells no speed", "record airspeed or GPS as well"
        )
    fast_s, fastest = flight.lasted_s("fast"), beside(flight.fastest, least)
    if flight.fastest <= least:
        reason = f"its highest speed while armed was {fastest} m/s, more than {least:g} are needed"
        return Obstacle(f"{said}: {reason}", longer)
    stops = sorted(_STOPPED, key=flight.lasted_s, reverse=True)
    lasted = [
        f"in {flight.lasted_s(why):.0f} s {_STOPPED[why]}" for why in stops if flight.lasted_s(why) >= 1
    ]
    above = f"of {fast_s:.3g} s above {least:g} m/s (fastest {fastest} m/s)"
    rest = ", ".join(lasted or ["no stretch of the rest lasted 3 s"])
    return Obstacle(f"{said}: {above}, {rest}", longer)


def beside(value: float, limit: float) -> str:
    """Return a number with as few decimals as show on which side of a limit it lies.

    Examples
    --------
    >>> beside(6.4, 8.0), beside(7.96, 8.0), beside(0.42, 0.5)
    ('6', '7.96', '0.4')
    """
    shown = [f"{value:.{decimals}f}" for decimals in range(round(limit, 6) % 1 > 0, _MOST_DECIMALS + 1)]
    side = np.sign(round(value - limit, _MOST_DECIMALS))
    return next((one for one in shown if np.sign(float(one) - limit) == side), shown[0])


def disorder(received: Mapping[str, Received]) -> str:
    """Return which messages lost much of their samples because they came too late; empty if none did.

    Examples
    --------
    >>> disorder({"ATTITUDE": Received(2, 500, 0), "RAW_IMU": Received(500, 2, 0)})
    'of ATTITUDE 2 of 502 samples came in time'
    """
    return ", ".join(
        f"of {message} {kept} of {kept + late} samples came in time"
        for message, (kept, late, _) in received.items()
        if late > MOST_LATE_SHARE * (kept + late)
    )


def why_undecided(
    findings: AxisFindings, surfaces: Surfaces | None, flight: Flight, received: Mapping[str, Received]
) -> Obstacle:
    """Return all requirements on an axis that are not met as one reason, the binding one first.

    Parameters
    ----------
    findings
        About an axis that is undecided.
    surfaces
        The outputs in use; None if they are not known.
    flight
        The flight, with at least one second of forward flight.
    received
        Numbers of samples by message.
    """
    found = [*_obstacles(findings, surfaces, flight, received)]
    if late := disorder(received):
        found.append(Obstacle(late, _IN_ORDER))
    reasons = "; ".join(dict.fromkeys(one.reason for one in found))
    return Obstacle(reasons, "; ".join(dict.fromkeys(one.remedy for one in found)))


def _obstacles(
    findings: AxisFindings, surfaces: Surfaces | None, flight: Flight, received: Mapping[str, Received]
) -> Iterator[Obstacle]:
    axis = findings.axis
    outputs = surfaces.of_axis(axis) if surfaces else ()
    if flight.by_receiver and not (surfaces and surfaces.by_receiver and outputs):
        yield _by_receiver(flight)
        return
    if findings.reference is None:
        yield from _unmeasured(findings, flight, received)
    motion, longer = ("driving forward", _LONGER_DRIVE) if axis == STEERING else ("forward flight", _LONGER)
    usable_s = findings.usable_s if outputs else flight.flown_s
    # More of a flight whose streams are too slow, or whose airspeed is doubted, would not help.
    doubted = flight.doubted_s >= DOUBTED_AIRSPEED_S
    if findings.reference is None and usable_s < REFERENCE_S and not doubted and not _slow(findings, flight):
        which = " with known outputs" if outputs and usable_s < flight.flown_s else ""
        reason = f"{usable_s} s of {motion}{which}, {REFERENCE_S} are needed for a reference"
        yield Obstacle(f"{reason} and {NORMAL_S} to judge", longer)
    against = (
        surfaces.contradicted.get(axis) or (axis == "yaw" and surfaces.contradicted.get("roll"))
        if surfaces
        else None
    )
    # A contradiction matters where it kept the outputs from being known in time.
    late = findings.reference is None and findings.usable_s < REFERENCE_S
    if against and (late or not outputs):
        yield Obstacle(against, _CORRECT)
    elif not outputs:
        yield _unnamed(axis, surfaces, flight)
    if doubted:
        reason = f"for {flight.doubted_s} s the airspeed sensor contradicts ground speed and wind"
        yield Obstacle(f"{reason}, so that the rest is too little", "inspect the pitot tube, then fly again")
    if findings.reference is not None:
        yield _unclear(findings)
    elif outputs and usable_s >= REFERENCE_S and not _slow(findings, flight):
        yield from _no_reference(findings)


def _by_receiver(flight: Flight) -> Obstacle:
    """Return why an axis without a command is not judged, where the receiver's channels are all there is."""
    only = f"only the receiver's channels ({', '.join(map(str, flight.by_receiver))})"
    if flight.has_pulses:
        reason = f"the receiver drives the servos: no output in the log moves, {only} do"
        return Obstacle(reason, "choose a flight in which the autopilot's outputs drive the servos")
    reason = f"the receiver drives the servos: the log has no output, {only}"
    return Obstacle(
        reason, "record the parameters, too, or name servos by their channels in an airframe file"
    )


def _unmeasured(
    findings: AxisFindings, flight: Flight, received: Mapping[str, Received]
) -> Iterator[Obstacle]:
    """Yield what no flight as it was recorded can tell: streams that are too slow or absent."""
    axis, needed_hz = findings.axis, NEEDED_PITCH_HZ if findings.axis == "pitch" else NEEDED_HZ
    slow = _slow(findings, flight)
    if slow:
        yield Obstacle(
            f"{' and '.join(slow)} times a second, {needed_hz} are needed to judge {axis}",
            to_record("motion", flight, received),
        )
    if axis in _ACCELEROMETER and "force" not in flight.heard:
        yield Obstacle(
            f"the log lacks the accelerometer, which {axis} needs",
            to_record("force", flight, received),
        )


def _slow(findings: AxisFindings, flight: Flight) -> list[str]:
    """Return which streams come too rarely for an axis, and how often a second."""
    rates = {"the servo outputs": flight.rate_hz("outputs"), "the rates": flight.rate_hz("rates")}
    longest_s = findings.needs.spacing_s
    slow = [
        f"{stream} come {hz:.1f}" for stream, hz in rates.items() if hz is not None and 1.0 / hz > longest_s
    ]
    if not slow and findings.spacing_s > longest_s:
        return [f"the servo outputs or the rates come {1 / findings.spacing_s:.1f}"]
    return slow


def _unnamed(axis: str, surfaces: Surfaces | None, flight: Flight) -> Obstacle:
    name = f'[[actuators]] with name = "{_NAMES[axis]}", its servo and its pwm_us'
    remedy = f"download the parameters while recording, or name the outputs in an airframe file: {name}"
    if surfaces is not None and surfaces.origin == "parameters":
        reason = f"by its parameters no output of this vehicle moves it in {axis}"
        return Obstacle(reason, f"if one does, name it in an airframe file: {name}")
    if surfaces is not None:
        return Obstacle(f"no output of this vehicle is known to move it in {axis}", remedy)
    why = "the flight's beginning does not tell it clearly"
    if flight.flown_s < REFERENCE_S:
        why = f"{flight.flown_s} s of forward flight are too short to learn it"
    reason = "which outputs move the surfaces is told neither by parameters nor by a profile"
    return Obstacle(f"{reason}, and {why}", remedy)


def _unclear(findings: AxisFindings) -> Obstacle:
    """Return why an axis with a reference is neither normal nor faulty."""
    coverage, found = findings.coverage, findings.doubt or findings.effectiveness
    if coverage.decidable >= NORMAL_S and found is not None:
        low = beside(100 * found.low, 100 * NORMAL_EFFECTIVENESS)
        kept = f"{100 * found.estimate:.0f} % ({low}–{100 * found.high:.0f})"
        least = f"{100 * NORMAL_EFFECTIVENESS:.0f} %"
        reason = f"control left {kept} is neither certainly above {least} nor certainly a loss"
    else:
        reason = (
            f"{coverage.decidable} of {coverage.windows} seconds since the reference were excited enough, "
            f"{NORMAL_S} are needed"
        )
        if coverage.judged_from_s is not None:
            reason = f"its reference ends {coverage.judged_from_s:.0f} s into the log, and {reason}"
    if coverage.excluded:
        loss = f"a loss of {100 * (1 - NORMAL_EFFECTIVENESS):.0f} % or more"
        motion = "driving forward" if findings.axis == STEERING else "forward flight"
        reason = f"{loss} is excluded over {coverage.excluded} s of {motion}, but {reason}"
    return Obstacle(reason, f"choose a longer log, or one with more {_manoeuvres(findings.axis)}")


def _manoeuvres(axis: str) -> str:
    return "turns" if axis == STEERING else "turns and climbs"


def _no_reference(findings: AxisFindings) -> Iterator[Obstacle]:
    """Yield why enough seconds with known outputs make no reference."""
    axis, best, needs = findings.axis, findings.best, findings.needs
    if best is None and axis == STEERING:
        reason = f"in no {REFERENCE_S} s of two minutes of driving forward its steering moved"
        yield Obstacle(reason, "drive turns in the first three minutes")
        return
    if best is None:
        least = 100 * LEAST_SPEED_SHARE
        speeds = f"{least:.0f} to {1e4 / least:.0f}" if axis == "pitch" else f"{least:.0f}"
        reason = (
            f"no {REFERENCE_S} s within two minutes were flown within {MOST_BANK_DEG}° of bank, "
            f"{MOST_PITCH_DEG}° of pitch and {speeds} % of the usual speed, with the "
            f"surfaces of {axis} in motion"
        )
        yield Obstacle(reason, "fly straight legs and gentle turns in the first three minutes")
        return
    verb = "drive" if axis == STEERING else "fly"
    remedy = f"{verb} more {_manoeuvres(axis)} in the first three minutes"
    if best.explained < needs.explained:
        share = beside(100 * best.explained, 100 * needs.explained)
        what = f"its surfaces explain {share} % of how it moves in {axis}"
        if axis == STEERING:
            # Whether the steering is dead or too little was driven, the log does not show.
            what = f"the commands to its steering explain {share} % of how it turns"
            remedy = f"check on the ground that the steering follows its commands, then {remedy}"
        if axis == "yaw":
            what = (
                "rudder and aileron cannot be told apart: the rudder explains "
                f"{share} % of the side force that the ailerons leave"
            )
            remedy = "pulse the rudder alone for a few seconds early in the flight"
        yield Obstacle(f"{what}, {100 * needs.explained:.0f} % are needed", remedy)
    if best.error > needs.error:
        reason = f"the effect of its surfaces is known to {beside(100 * best.error, 100 * needs.error)} %"
        yield Obstacle(f"{reason}, {100 * needs.error:.0f} % are needed", remedy)


def to_record(fact: str, flight: Flight, received: Mapping[str, Received]) -> str:
    """Return how the log's own format records a fact, by the parameters of this autopilot."""
    return remedy(fact, received.keys(), flight.autopilots, flight.parameters)
