"""Why a verdict is what it is, and what to do about it: one table of messages, a code for each.

A row has the reason and the remedy, with the names of the data that they contain. A remedy is empty where
another reason beside it has one, or where all is well. The codes do not change with the words. Several
reasons are joined by "; "; a short answer has the first one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

FILL_IN: Final = "fill in the constants from the EMA's data sheet and the friction limits from its maker"
# for a vehicle that no control surface turns in flight
NO_WINGS: Final = "its servos can be judged if they report current or speed: name a profile with --airframe"
# for a vehicle that flies by its propellers alone
PROPELLERS_ONLY: Final = "if it moves a surface by a servo after all, name its profile with --airframe"

_BY_NAME = "download the parameters while recording, or name the outputs in an airframe file: {name}"
_CHECK = "check torque_constant and gear_ratio of the profile, and the units and signs of V4, V5, V7 and V11"
_DRAFT = "`mavhums profile new LOG -o mine.toml`"
_IN_ORDER = "record on board, or over a link that keeps the order of the messages"
_KEY = "on a link, accept only signed frames (--key)"
_LONGER = "choose a log with {judged_s} s or more of {longer}"
_MOVE_IT = "analyse a flight in which the surface moves, or sweep it before take-off"
_NO_LIMIT = "; no absolute limit known"
_NO_PROFILE = "{who}no airframe profile: one actuator's limits say nothing about another's"
_PARAMETERS = "record the parameters, too (refresh the ground station's list, or use the on-board log)"
_PROFILE = f"name one with --airframe: {_DRAFT} drafts it from the log's parameters"

MESSAGES: Final[dict[str, tuple[str, str]]] = {
    # of a log or a vehicle
    "no_vehicle": ("no vehicle found in this log", "record the link between vehicle and ground station"),
    "nothing_received": ("nothing was received on {where}", "send the vehicle's telemetry there"),
    "no_frame": ("no MAVLink frame in the {bytes:,} bytes that were received on {where}",
        "check the sender and, on a serial link, its baud rate"),
    "no_signed_frame": (
        "no new frame signed with the key in the {bytes:,} bytes that were received on {where}",
        "sign with this key"),
    "crowded_out": ("more than {most} vehicles transmit, and this one came after them",
        f"record each vehicle's link on its own; {_KEY}"),
    "several_senders": (
        "more than one sender transmits as vehicle {vehicle}: the time stamps of {message} are of more than "
        "one clock",
        "give each aircraft a system id of its own (SYSID_THISMAV, MAV_SYSID or MAV_SYS_ID), and record "
        f"again; {_KEY}"),
    "unknown_kind": ("the log does not record what kind of vehicle this is",
        "record the autopilot's heartbeats as well; a .BIN or .ulg from its start"),
    "no_wings": ("{who}: control effectiveness is judged for fixed-wing aircraft in forward flight only",
        NO_WINGS),
    "lacks": ("the log lacks {signals}", "{record}"),
    "too_rare": ("{signal} come {rate_hz:.2g} times a second, {needed_hz} are needed", "{record}"),
    "out_of_order": ("{samples}", _IN_ORDER),
    "no_sample_in_time": ("{signals} came too late to be used: {samples}", _IN_ORDER),
    "no_pulses": (
        "the servo outputs are recorded ({kept:,} {message}) and carry no pulses: the safety switch is on, "
        "or another device drives the servos",
        "release the safety switch and arm; nothing more needs to be recorded"),

    # of an actuator without findings
    "multirotor": ("{who}a multirotor has no control surfaces whose servos could be judged", PROPELLERS_ONLY),
    "propeller_escs": ("its ESC telemetry is that of the propellers", ""),
    "nothing_of_actuators": ("{who}the log contains no data of the actuators", "{record}"),
    "wear_unseen": ("{who}no servo current or speed in the log, so wear cannot be seen", "{record}"),
    "no_angle": ("the profile has no travel_deg, so its command is not an angle", ""),
    "no_profile": (_NO_PROFILE, _PROFILE),
    "no_profile_of_esc": (
        f"{_NO_PROFILE}, and an ESC may drive a propeller: only a profile names the one that drives a servo",
        _PROFILE),
    "blanks": ("the profile has no {blanks}", FILL_IN),
    "contradicts": ("the profile contradicts the log: {statements}",
        f"correct {{lines}} in the profile, or draft one from the log's parameters: {_DRAFT}"),
    "esc_unnamed": ("the profile names no ESC of servo {servo}: those that report drive propellers",
        "{record}"),
    "left_out": ("the log's {tier} telemetry leaves out servo {servo}", "{record}"),
    "shared_id": ("several servos report under its id: the angle leaps faster than any servo turns",
        "give each servo an id of its own"),
    "never_follows": (
        "its angle does not follow its pulse from the beginning: it does not move, or its id is another "
        "servo's",
        "check on the ground that the surface moves with its output, and that the servo has the output's "
        "number"),
    "refused": ("{why}", "record {quantities} as sampled at the motor, with sign"),
    "implausible": (
        "up to {percent:.0f} % of the values of {quantities} are beyond what the profile's actuator can do",
        "check the unit and scale of these fields, and the profile's constants, travel and voltage"),
    "silent": ("its telemetry ends at {last_s:.0f} s of {end_s:.0f} s, when it was {condition}",
        "check why it is silent: sensor, wiring or link"),

    # of an actuator whose friction is not known
    "bus_power": (
        "its ESC measures at the supply bus, where driving and braking currents of the motor look alike",
        "measure at the motor's terminals, or {record}"),
    "not_measured": ("{quantities} not measured, so the torque balance cannot be formed", "{record}"),
    "telemetry_too_short": ("less than {needed_s:g} s of telemetry", "record the whole flight"),
    "telemetry_too_slow": (
        "its telemetry comes at {rate_hz:.1f} Hz, less than the profile's min_rate_hz of {needed_hz:g}",
        "record its telemetry faster"),
    "unsigned_current": (
        "it moves in {percent:.0f} % of the samples, but only {usable} of these have a current of known sign",
        "record current and speed together, with their signs"),
    "still": ("the actuator moves in {percent:.0f} % of the samples, too little to show friction", _MOVE_IT),
    "slow_motion": (
        "the actuator moves in {percent:.0f} % of the samples, too slowly to show friction: in slow motion "
        "the magnitudes that the ESC sends do not separate a driving current from a braking one",
        "analyse a flight in which the surface moves faster, or {record}"),
    "other_constant": (
        "the back-EMF shows {percent:.0f} % of the profile's torque constant, so the current does not show "
        "the torque",
        _CHECK),
    "negative_friction": ("the torque balance gives a friction of {friction:.3g} N·m, below zero", _CHECK),
    "no_friction": (
        "the torque balance gives no friction at all: the current does not follow the motion", _CHECK),
    "load_friction": (
        "its friction of {friction:.2g} N·m may be that of the load: the profile has no load_friction",
        "fill in load_friction of [actuators.ema]"),
    "one_way": ("the actuator moves one way only, which does not separate friction from load", _MOVE_IT),
    "friction_uncertain": (
        "it moves too little both ways: its friction is known to ± {error:.2g} N·m, and its limits are "
        "{apart:.2g} N·m apart",
        _MOVE_IT),
    "none_clear": ("{decidable} of {windows} windows are decidable, and none is clear enough",
        "analyse a longer flight"),
    "network_unfed": ("the network decides, and no window has enough samples in motion that carry its inputs",
        "analyse a flight in which the surface moves, with its telemetry at 10 Hz or more, or {physics}"),
    "network_outside": (
        "the network decides, and {outside} of {windows} windows are outside its training range",
        "train a network on flights of such aircraft (mavhums train), or {physics}"),
    "network_unsure": (
        "the network decides: it is sure of {sure} of {windows} windows, and of no condition in two separate "
        "ones",
        "analyse a longer flight, or {physics}"),

    # of an actuator beside its own flights
    "own_too_slow": ("the {quantity} needs {needed_hz:g} Hz, and the log has less",
        "record its telemetry faster"),
    "own_still": ("the servo moved too little both ways to show its {quantity}",
        "analyse a flight in which the surface works"),
    "own_learning": (f"flight {{flight}} of the {{needed}} that its baseline takes{{why}}{_NO_LIMIT}",
        "keep its flights: mavhums analyse LOG --keep"),
    "own_unchanged": (
        "{quantity} within ±{half:.0%} of its first {flights} flights (a rise of {rise:.0%} would have been "
        f"found){_NO_LIMIT}",
        ""),
    "own_changed": (f"{{quantity}} {{change}}: {{cause}}{_NO_LIMIT}", "inspect {inspect}"),
    "own_constant": (f"torque constant {{lost:+.0%}}; the {{quantity}} follows from it{_NO_LIMIT}",
        "inspect the motor's magnets, which age and suffer from heat"),

    # of all axes of a vehicle
    "steering_unknown": ("{who}: the log does not show which output steers it", _PARAMETERS),
    "skid_steering": (
        "{who}: it steers by the difference of its motors (skid steering), which is not judged", NO_WINGS),
    "steering_unnamed": (
        "{who}: its parameters name no output that steers it (SERVOn_FUNCTION 26)",
        "if an output steers it, set its function, and record the parameters, too"),
    "never_armed": ("{still}: it was never armed", _LONGER),
    "no_speed": ("whether it flew forward is not known: the log records no speed",
        "record airspeed or GPS as well"),
    "too_slow": (
        "{still}: its highest speed while armed was {fastest} m/s, more than {least:g} are needed", _LONGER),
    "stopped": ("{still}: of {fast_s:.3g} s above {least:g} m/s (fastest {fastest} m/s), {rest}", _LONGER),

    # of an axis
    "stream_too_slow": ("{streams} times a second, {needed_hz} are needed to judge {axis}", "{record}"),
    "too_short": (
        "{usable_s} s of {motion}{known}, {reference_s} are needed for a reference and {normal_s} to judge",
        _LONGER),
    "outputs_contradicted": ("{why}",
        f"correct these outputs in the profile, draft one from the log's parameters ({_DRAFT}), or leave out "
        "--airframe"),
    "moved_by_none": ("its parameters name no output that moves it in {axis}",
        "if an output moves it in {axis}, name that output in an airframe file: {name}"),
    "moved_by_unknown": ("no output of this vehicle is known to move it in {axis}", _BY_NAME),
    "outputs_unknown": (
        "neither parameters nor a profile name the outputs that move the surfaces, and {why}",
        _BY_NAME),
    "airspeed_doubted": (
        "for {doubted_s} s the airspeed sensor contradicts ground speed and wind, so that the rest is too "
        "little",
        "inspect the pitot tube, then fly again"),
    "uncertain_loss": (
        "control left {kept:.0f} % ({low}–{high:.0f}) is neither certainly above {least:.0f} % nor "
        "certainly a loss",
        "choose a longer log, or one with more {manoeuvres}"),
    "unexcited": (
        "{since}a loss of {loss:.0f} % or more is excluded over {decidable} of the {windows} s since the "
        "reference, {normal_s} are needed",
        "choose a longer log, or one with more {manoeuvres}"),
    "steering_still": ("two minutes of driving contain no {reference_s} s with its steering in motion",
        "drive turns in the first two minutes"),
    "no_reference": (
        "two minutes contain no {reference_s} s with bank and pitch within {bank_deg}°, {speeds} % of the "
        "usual speed, and the surfaces of {axis} in motion",
        "fly straight legs and gentle turns in the first two minutes"),
    "wind_unknown": (
        "without an airspeed sensor the wind is estimated in turns: the airspeed was known for "
        "{settled_s} s, {reference_s} s are needed",
        "record the airspeed, or fly turns of 90° in the first minutes"),
    "effect_uncertain": (
        "the effect of its surfaces is uncertain by {error} %, {allowed:.0f} % is allowed", "{again}"),
    "steering_uncertain": (
        "the effect of the commands to its steering is uncertain by {error} %, {allowed:.0f} % is allowed",
        "check on the ground that the steering follows its commands, then {again}"),
    "rudder_uncertain": (
        "the effect of the rudder is uncertain by {error} %, {allowed:.0f} % is allowed",
        "pulse the rudder alone for a few seconds early in the flight"),
    "rudder_inseparable": (
        "rudder and aileron move together: the effect of the rudder alone is uncertain by {error} %, "
        "{allowed:.0f} % is allowed",
        "pulse the rudder alone for a few seconds early in the flight"),
    "inseparable": (
        "{axis} control moves together with the rest of the motion: its own effect is uncertain by "
        "{error} %, {allowed:.0f} % is allowed",
        "fly short pulses in {axis} alone, early in the flight"),
    "begins_in_flight": (
        "the log begins in flight, and does not show whether control was healthy then",
        "record from before take-off, or compare with earlier flights (--keep)"),
    "late_reference": (
        "its reference ends {judged_from_s:.0f} s into the log: a loss before that does not show",
        "compare with earlier flights (--keep)"),

    # of motors
    "motors_unknown": ("the log does not show where each motor is", _PARAMETERS),
    "no_parameter": ("the log lacks the parameter {name}, so what each motor does is not known", _PARAMETERS),
    "motor_unassigned": ("the parameters assign no output to some of its motors ({names})", _PARAMETERS),
    "pulses_implausible": (
        "the range of its motors' outputs ({motors}PWM_MIN, {motors}PWM_MAX) is not plausible", _PARAMETERS),
    "unjudged_frame": ("{frames} are not judged", "only quad, hexa and octa frames are judged"),
    "leaned": (
        "it leaned more than {most_deg:.0f}° before any motor showed a loss, and nothing is judged then",
        "read the log by hand: a fall, a flip and a fault look alike there"),
    "hover_too_short": ("{judged_s} s of {motion} could be judged, {needed_s:.0f} are needed",
        "choose a log with a hover of a minute or more, from take-off on"),
    "motors_normal": (
        "{frame}: no motor lost {bound} % or more of its thrust for over 2 s, with 95 % confidence in "
        "{share:.0f} % of the seconds, turns and the last seconds before a landing left out",
        "keep the log: a slower loss shows against later flights only"),
    "motors_uncertain": ("no motor shows a loss, but a loss of {loss:.0f} % would not have been certain",
        "choose a calmer flight, or record the outputs at 25 Hz or more"),
}  # fmt: skip


@dataclass(frozen=True, init=False)
class Reason:
    """A row of the table with its data.

    Examples
    --------
    >>> Reason("steering_unknown", who="a rover").text
    'a rover: the log does not show which output steers it'
    """

    code: str
    text: str
    remedy: str

    def __init__(self, code: str, **data: object) -> None:
        text, remedy = (template.format(**data) for template in MESSAGES[code])
        vars(self).update(code=code, text=text, remedy=remedy)


def said(*reasons: Reason) -> dict[str, Any]:
    """Return the fields of a verdict for its reasons, the binding one first; without any, they are empty."""
    return {
        "reason": "; ".join(dict.fromkeys(one.text for one in reasons)) or None,
        "remedy": "; ".join(dict.fromkeys(one.remedy for one in reasons if one.remedy)) or None,
        "reason_codes": tuple(dict.fromkeys(one.code for one in reasons)),
    }
