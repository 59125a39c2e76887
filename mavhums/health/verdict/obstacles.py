"""Why a vehicle, or one of its axes, has no verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import ceil
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from mavhums.actuator.telemetry import TO_BE_JUDGED, Tier
from mavhums.core.conditions import Condition
from mavhums.health.axis.findings import AxisFindings
from mavhums.health.axis.thresholds import (
    GAIN_ERROR,
    JUDGED_ERROR,
    LEAST_SPEED_SHARE,
    NORMAL_EFFECTIVENESS,
    REFERENCE_S,
    SLOW_STREAM_S,
)
from mavhums.health.decision.thresholds import MOST_BANK_DEG, NAMED_SHARE, NORMAL_S
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.reasons import Reason, said
from mavhums.results.verdict import Verdict
from mavhums.vehicle.arrivals import GAP_S, Received
from mavhums.vehicle.flight import LEAST_DRIVEN, Flight
from mavhums.vehicle.formats import messages_of, remedy
from mavhums.vehicle.identity import PERIPHERALS, Identity, in_words
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import STEERING, Surfaces, steers_by_wheels
from mavhums.vehicle.vtol import LEAST_SPEED

_WINGED: Final = ("fixed wing", "VTOL", "quadplane", "tiltrotor", "tailsitter")
_WINGED_TYPES: Final = {1, *range(19, 26)}
_OUTPUTS: Final = messages_of("outputs")
_NEEDED_HZ: Final = ceil(1.0 / SLOW_STREAM_S)
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
_SECONDS: Final = {
    "reference_s": REFERENCE_S,
    "normal_s": NORMAL_S,
    "judged_s": REFERENCE_S + NORMAL_S,
}
_MOTIONS: Final[tuple[Mapping[str, Any], ...]] = (
    {
        **_SECONDS,
        "still": "it never flew forward",
        "motion": "forward flight",
        "longer": "forward flight",
        "manoeuvres": "turns and climbs",
        "again": "fly more turns and climbs in the first two minutes",
    },
    {
        **_SECONDS,
        "still": "it did not drive forward for 3 s",
        "motion": "driving forward",
        "longer": "driving forward, with turns",
        "manoeuvres": "turns",
        "again": "drive more turns in the first two minutes",
    },
)
"""Words for the motion in which an axis, or else the steering, is judged."""


def unjudged(
    vehicle: int | None,
    name: str,
    *reasons: Reason,
    condition: Condition = "undecided",
    tier: Tier | None = None,
    **more: Any,
) -> Verdict:
    """Return a verdict without findings; ``more`` are other fields of it."""
    more |= {"vehicle": vehicle, "actuator": name, "tier": tier.name if tier else None}
    return Verdict(condition=condition, worst=condition, **said(*reasons), **more)


def obstacle(tier: Tier | None, identity: Identity | None = None) -> tuple[Reason, ...]:
    """Return why a vehicle without a profile has no verdict.

    The remedy asks for a profile only if the log carries telemetry that could be judged with one, and never
    for a packaged one: those are of other aircraft, and a log that is of one names it.

    Examples
    --------
    >>> obstacle(None, Identity(1, "quadrotor", multirotor=True))[0].text
    'quadrotor: a multirotor has no control surfaces whose servos could be judged'
    """
    who = f"{identity}: " if identity is not None and str(identity) else ""
    from_esc = tier is not None and tier.from_esc
    if identity is not None and identity.multirotor:
        return Reason("multirotor", who=who), *([Reason("propeller_escs")] if from_esc else [])
    if tier is None:
        return (Reason("nothing_of_actuators", who=who, record=TO_BE_JUDGED),)
    if not tier.judged:
        return (Reason("wear_unseen", who=who, record=TO_BE_JUDGED),)
    return (Reason("no_profile_of_esc" if from_esc else "no_profile", who=who),)


def why_not_at_all(
    flight: Flight,
    kind: str | None = None,
    received: Mapping[str, Received] = MappingProxyType({}),
    parameters: Parameters | None = None,
) -> tuple[Reason, ...]:
    """Return why no axis of a vehicle can be judged; nothing if some may be.

    ``kind`` is the type of vehicle in words, if something other than its flight shows it; ``received`` the
    numbers of samples by message; ``parameters`` those of the vehicle, which show how a rover steers.

    Examples
    --------
    >>> from mavhums.vehicle.flight import Flight
    >>> why_not_at_all(Flight(None))[0].text
    'the log does not record what kind of vehicle this is'
    >>> why_not_at_all(Flight(None), "multirotor")[0].code
    'no_wings'
    """
    kinds = flight.kinds - PERIPHERALS.keys() or flight.kinds
    if flight.on_ground:
        if not flight.steers:
            return (_unsteered(" and ".join(map(in_words, sorted(kinds))), parameters),)
    elif kind and not kind.startswith(_WINGED) and not kinds & _WINGED_TYPES:
        kinds = set() if not kinds or kind == "helicopter" else kinds
        if not kinds:
            return (Reason("no_wings", who=kind),)
    if not kinds and not flight.on_ground:
        return (Reason("unknown_kind"),)
    if not kinds & _WINGED_TYPES and not flight.on_ground:
        return (Reason("no_wings", who=" and ".join(map(in_words, sorted(kinds)))),)
    missing = {name: words for name, words in _NEEDED.items() if name not in flight.heard}
    # The messages are there: recording more of them would not help.
    if missing and (late := disorder(received)):
        return (Reason("no_sample_in_time", signals=" and ".join(missing.values()), samples=late),)
    # Outputs without pulses: ArduPilot writes 0 while the safety switch is on.
    silent = next((name for name in received if name in _OUTPUTS and received[name].kept), None)
    if [*missing] == ["outputs"] and silent and received[silent].kept * GAP_S > flight.lasted_s("recorded"):
        return (Reason("no_pulses", kept=received[silent].kept, message=silent),)
    if missing:
        return without(missing, flight, received)
    return (_stood(flight),) if flight.flown_s == 0 else ()


def without(
    missing: Mapping[str, str], flight: Flight, received: Mapping[str, Received]
) -> tuple[Reason, ...]:
    """Return which signals a log lacks; of those that come too rarely to be followed, how often they come."""
    recorded_s, lacking, rare = flight.lasted_s("recorded"), list[str](), list[Reason]()
    record = to_record("motion", flight, received)
    for name, words in missing.items():
        kept = max((received[one].kept for one in messages_of(name) & received.keys()), default=0)
        if 0 < kept < _NEEDED_HZ * recorded_s:
            rates = {"rate_hz": kept / recorded_s, "needed_hz": _NEEDED_HZ}
            rare.append(Reason("too_rare", signal=words, record=record, **rates))
        else:
            lacking.append(words)
    lacks = (Reason("lacks", signals=" and ".join(lacking), record=record),) if lacking else ()
    return *lacks, *rare


def _unsteered(who: str, parameters: Parameters | None) -> Reason:
    """Return why the steering of a rover or a boat is not known."""
    if parameters is None:
        return Reason("steering_unknown", who=who)
    return Reason("skid_steering" if steers_by_wheels(parameters) else "steering_unnamed", who=who)


def _stood(flight: Flight) -> Reason:
    """Return why a flight has no second of forward flight."""
    least = LEAST_DRIVEN if flight.on_ground else LEAST_SPEED
    words = {**_MOTIONS[flight.on_ground]}
    if not flight.on_ground and not flight.lasted_s("armed"):
        return Reason("never_armed", **words)
    if not flight.on_ground and not flight.heard & {"airspeed", "groundspeed", "velocity"}:
        return Reason("no_speed")
    words |= {"fastest": beside(flight.fastest, least), "least": least}
    if flight.fastest <= least:
        return Reason("too_slow", **words)
    stops = sorted(_STOPPED, key=flight.lasted_s, reverse=True)
    lasted = [
        f"in {flight.lasted_s(why):.0f} s {_STOPPED[why]}" for why in stops if flight.lasted_s(why) >= 1
    ]
    rest = ", ".join(lasted or ["no stretch of the rest lasted 3 s"])
    return Reason("stopped", fast_s=flight.lasted_s("fast"), rest=rest, **words)


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
        if late > NAMED_SHARE * (kept + late)
    )


def why_undecided(
    findings: AxisFindings, surfaces: Surfaces | None, flight: Flight, received: Mapping[str, Received]
) -> Iterator[Reason]:
    """Yield the requirements on an axis that are not met, the binding one first.

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
    yield from _obstacles(findings, surfaces, flight, received)
    if late := disorder(received):
        yield Reason("out_of_order", samples=late)


def _obstacles(
    findings: AxisFindings, surfaces: Surfaces | None, flight: Flight, received: Mapping[str, Received]
) -> Iterator[Reason]:
    axis = findings.axis
    outputs = surfaces.of_axis(axis) if surfaces else ()
    if findings.reference is None:
        yield from _unmeasured(findings, flight, received)
    usable_s = findings.usable_s if outputs else flight.flown_s
    # More of a flight whose streams are too slow, or whose airspeed is doubted, would not help.
    doubted = flight.doubted_s >= WINDOW_S
    if findings.reference is None and usable_s < REFERENCE_S and not doubted and not _slow(findings, flight):
        known = " with known outputs" if outputs and usable_s < flight.flown_s else ""
        yield Reason("too_short", usable_s=usable_s, known=known, **_MOTIONS[axis == STEERING])
    against = (
        surfaces.contradicted.get(axis) or (axis == "yaw" and surfaces.contradicted.get("roll"))
        if surfaces
        else None
    )
    # A contradiction matters where it kept the outputs from being known in time.
    late = findings.reference is None and findings.usable_s < REFERENCE_S
    if against and (late or not outputs):
        yield Reason("outputs_contradicted", why=against)
    elif not outputs:
        yield _unnamed(axis, surfaces, flight)
    if doubted:
        yield Reason("airspeed_doubted", doubted_s=flight.doubted_s)
    if findings.reference is not None:
        yield _unclear(findings)
    elif outputs and usable_s >= REFERENCE_S and not _slow(findings, flight):
        yield from _no_reference(findings, flight)


def _unmeasured(findings: AxisFindings, flight: Flight, received: Mapping[str, Received]) -> Iterator[Reason]:
    """Yield the streams without which no flight shows the axis: those that are too slow or absent."""
    axis = findings.axis
    slow = _slow(findings, flight)
    if slow:
        record, streams = to_record("motion", flight, received), " and ".join(slow)
        yield Reason("stream_too_slow", streams=streams, needed_hz=_NEEDED_HZ, axis=axis, record=record)
    if axis in _ACCELEROMETER and "force" not in flight.heard:
        signals = f"the accelerometer (needed for {axis})"
        yield Reason("lacks", signals=signals, record=to_record("force", flight, received))


def _slow(findings: AxisFindings, flight: Flight) -> list[str]:
    """Return which streams come too rarely for an axis, and how often a second."""
    rates = {"the servo outputs": flight.rate_hz("outputs"), "the rates": flight.rate_hz("rates")}
    if findings.axis == "yaw":
        rates["the accelerations"] = flight.rate_hz("force")
    slow = [
        f"{stream} come {hz:.1f}"
        for stream, hz in rates.items()
        if hz is not None and 1.0 / hz > SLOW_STREAM_S
    ]
    if not slow and findings.spacing_s > SLOW_STREAM_S:
        return [f"the servo outputs or the rates come {1 / findings.spacing_s:.1f}"]
    return slow


def _unnamed(axis: str, surfaces: Surfaces | None, flight: Flight) -> Reason:
    words = {"axis": axis, "name": f'[[actuators]] with name = "{_NAMES[axis]}", its servo and its pwm_us'}
    if surfaces is not None:
        return Reason("moved_by_none" if surfaces.origin == "parameters" else "moved_by_unknown", **words)
    why = "the flight's beginning does not show them clearly"
    if flight.flown_s < REFERENCE_S:
        why = f"{flight.flown_s} s of forward flight are too short to learn it"
    return Reason("outputs_unknown", why=why, **words)


def _unclear(findings: AxisFindings) -> Reason:
    """Return why an axis with a reference is neither normal nor faulty."""
    coverage, found = findings.coverage, findings.doubt or findings.effectiveness
    words, least = _MOTIONS[findings.axis == STEERING], 100 * NORMAL_EFFECTIVENESS
    if coverage.decidable >= NORMAL_S and found is not None:
        kept, low, high = 100 * found.estimate, beside(100 * found.low, least), 100 * found.high
        return Reason("uncertain_loss", kept=kept, low=low, high=high, least=least, **words)
    late = coverage.judged_from_s
    since = "" if late is None else f"its reference ends {late:.0f} s into the log, and "
    seconds = {"decidable": coverage.decidable, "windows": coverage.windows}
    return Reason("unexcited", since=since, loss=100 - least, **seconds, **words)


def _no_reference(findings: AxisFindings, flight: Flight) -> Iterator[Reason]:
    """Yield why enough seconds with known outputs make no reference."""
    axis, best = findings.axis, findings.best
    if best is None and axis == STEERING:
        yield Reason("steering_still", reference_s=REFERENCE_S)
        return
    if best is None and axis == "pitch" and flight.settled_s < REFERENCE_S:
        yield Reason("wind_unknown", settled_s=flight.settled_s, reference_s=REFERENCE_S)
        return
    if best is None:
        least = 100 * LEAST_SPEED_SHARE
        speeds = f"{least:.0f} to {1e4 / least:.0f}" if axis == "pitch" else f"at least {least:.0f}"
        known = {"reference_s": REFERENCE_S, "bank_deg": MOST_BANK_DEG, "speeds": speeds}
        yield Reason("no_reference", axis=axis, **known)
        return
    again = _MOTIONS[axis == STEERING]["again"]
    by_axis = {STEERING: "steering_uncertain", "yaw": "rudder_uncertain"}
    uncertain = by_axis.get(axis, "effect_uncertain")
    inseparable = "rudder_inseparable" if axis == "yaw" else "inseparable"
    for code, error, allowed in (
        (uncertain, best.error, GAIN_ERROR),
        (inseparable, best.apart, JUDGED_ERROR),
    ):
        if error > allowed:
            shown = beside(100 * min(error, 1.0), 100 * allowed)
            yield Reason(code, axis=axis, error=shown, allowed=100 * allowed, again=again)
            return


def to_record(fact: str, flight: Flight, received: Mapping[str, Received]) -> str:
    """Return how the log's own format records a fact, by the parameters of this autopilot."""
    return remedy(fact, received.keys(), flight.autopilots, flight.parameters)
