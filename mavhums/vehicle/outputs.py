"""The servo outputs that move control surfaces, according to an autopilot's parameters.

Motors, throttle and gimbals, for example, are not control surfaces. Functions: ArduPilot SERVOn_FUNCTION;
PX4 PWM_MAIN_FUNCn, PWM_AUX_FUNCn or UAVCAN_SV_FUNCn = 201 + k, with the type of surface k in CA_SV_CSk_TYPE.
Functions that pass a channel through, or leave the output to a script, tell nothing of what it moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from mavhums.vehicle.parameters import Parameters

__all__ = ["OUTPUT_PARAMETERS", "Output", "assigned_outputs", "control_surfaces"]

_ARDUPILOT = {
    2: "flap",
    3: "flap",
    4: "aileron",
    16: "left split elevon 1",  # differential spoilers: a pair on each side, roll and pitch as their mean
    17: "right split elevon 1",
    19: "elevator",
    21: "rudder",
    24: "left flaperon",
    25: "right flaperon",
    77: "left elevon",
    78: "right elevon",
    79: "left v-tail",
    80: "right v-tail",
    86: "left split elevon 2",
    87: "right split elevon 2",
    110: "airbrake",
}
_NO_SURFACES = {
    26: "ground steering",
    27: "parachute",
    28: "gripper",
    29: "landing gear",
    **{33 + k: f"motor {k + 1}" for k in range(8)},
    70: "throttle",
    73: "left throttle",
    74: "right throttle",
    **{82 + k: f"motor {k + 9}" for k in range(4)},
}
_OLD_CHANNELS = (("ROLL", 1, 4), ("PITCH", 2, 19), ("THROTTLE", 3, 70), ("YAW", 4, 21))
"""Channels of ArduPlane before 3.8: name in RCMAP_*, usual channel, and the function that it has since."""
_OLD_MIXERS = ("ELEVON_MIXING", "ELEVON_OUTPUT", "VTAIL_OUTPUT")
OUTPUT_PARAMETERS = ("SERVO", "PWM_", "HIL_ACT", "RC", "KFF_RDDRMIX", "CRUISE_THROTTLE", *_OLD_MIXERS)
"""Beginnings of the names of parameters that tell what an output moves."""
_PX4 = {
    1: "left aileron",
    2: "right aileron",
    3: "elevator",
    4: "rudder",
    5: "left elevon",
    6: "right elevon",
    7: "left v-tail",
    8: "right v-tail",
    9: "left flap",
    10: "right flap",
    11: "airbrake",
    13: "left a-tail",
    14: "right a-tail",
    15: "aileron",
    17: "left spoiler",
    18: "right spoiler",
}
_PX4_UNKNOWN = (0, 12)  # not set, custom
_PX4_FIRST_SERVO = 201
_PX4_MOTORS = range(101, 113)
_CHANNELS = 32


class _Bus(NamedTuple):
    """A group of PX4 outputs: the prefix of their parameters, their first channel, and their usual range."""

    prefix: str
    first: int
    usual: tuple[int, int, int]


_PER_BUS = 16
_LEAST_RANGE_US = 2  # a zero needs a pulse between the ends
_UAVCAN_FIRST = 32
_BUSES = (
    _Bus("PWM_MAIN", 0, (1000, 1500, 2000)),
    _Bus("PWM_AUX", 16, (1000, 1500, 2000)),
    _Bus("UAVCAN_SV", _UAVCAN_FIRST, (0, 500, 1000)),
)


@dataclass(frozen=True, slots=True)
class Output:
    """A servo output and what it moves.

    Attributes
    ----------
    servo
        Output channel, from 1. For PX4, MAIN n is n, AUX n is 16 + n, UAVCAN n is 32 + n.
    surface
        Name of the surface; several outputs may have the same one.
    because
        The parameter that defines the surface.
    pwm_us
        Smallest, zero and largest pulse.
    calibrated_by
        Source of these pulses.
    is_reversed
        Whether the autopilot reverses the direction; the pulses in the log already include the reversal.
    is_surface
        Whether ``surface`` is a control surface; a motor or a throttle is not.
    ends_by, direction_by
        The parameters that give the smallest and the largest pulse, an empty text if the log lacks one; and
        those that give the direction.
    """

    servo: int
    surface: str
    because: str
    pwm_us: tuple[int, int, int]
    calibrated_by: str
    is_reversed: bool
    is_surface: bool = True
    ends_by: str = ""
    direction_by: str = ""


def assigned_outputs(parameters: Parameters) -> list[Output]:
    """Return the outputs whose parameters tell what they move, in the order of their channels.

    Examples
    --------
    >>> [output] = assigned_outputs(Parameters(1, False, {"SERVO3_FUNCTION": 70.0}))
    >>> output.surface, output.is_surface
    ('throttle', False)
    """
    return list(_px4(parameters.values) if parameters.is_px4 else _ardupilot(parameters.values))


def control_surfaces(parameters: Parameters) -> list[Output]:
    """Return the outputs that move control surfaces, in the order of their channels.

    Examples
    --------
    >>> values = {"SERVO2_FUNCTION": 19.0, "SERVO2_MIN": 1000.0, "SERVO2_TRIM": 1480.0, "SERVO2_MAX": 2000.0}
    >>> [output] = control_surfaces(Parameters(1, False, values))
    >>> output.servo, output.surface, output.pwm_us
    (2, 'elevator', (1000, 1480, 2000))
    """
    return [output for output in assigned_outputs(parameters) if output.is_surface]


def _ardupilot(values: Mapping[str, float]) -> Iterator[Output]:
    # ArduPlane before 3.8: the first four channels go through, and RCn_* holds what SERVOn_* holds since.
    old = "RC1_REV" in values and "KFF_RDDRMIX" in values
    if old and any(values.get(name) for name in _OLD_MIXERS):
        return  # which of two mixed outputs is which, and its direction, is told otherwise
    stem, reverse_by, reversed_is = ("RC", "REV", -1) if old else ("SERVO", "REVERSED", 1)
    through = {round(values.get(f"RCMAP_{name}", n)): one for name, n, one in _OLD_CHANNELS} if old else {}
    for n in range(1, _CHANNELS + 1):
        function = through.get(n, values.get(f"{stem}{n}_FUNCTION"))
        if function not in _ARDUPILOT and function not in _NO_SURFACES:
            continue
        names = (f"{stem}{n}_MIN", f"{stem}{n}_TRIM", f"{stem}{n}_MAX")
        pwm_us, by, ends_by = _pulses(values, names, (1100, 1500, 1900))
        direction = values.get(f"{stem}{n}_{reverse_by}", -reversed_is if old else 0)
        yield Output(
            n,
            (_ARDUPILOT | _NO_SURFACES)[int(function)],
            f"channel {n} of ArduPlane before 3.8" if n in through else f"{stem}{n}_FUNCTION = {function:g}",
            pwm_us,
            by,
            direction == reversed_is,
            is_surface=function in _ARDUPILOT,
            ends_by=ends_by,
            direction_by=f"{stem}{n}_{reverse_by} = {direction:g}",
        )


def _px4(values: Mapping[str, float]) -> Iterator[Output]:
    for prefix, first, usual in _BUSES:
        for n in range(1, _PER_BUS + 1):
            function = values.get(f"{prefix}_FUNC{n}", 0.0)
            because, surface, k = f"{prefix}_FUNC{n} = {function:g}", None, int(function) - _PX4_FIRST_SERVO
            if function in _PX4_MOTORS:
                surface = f"motor {int(function) - _PX4_MOTORS.start + 1}"
            elif 0 <= k < _CHANNELS:
                kind = values.get(f"CA_SV_CS{k}_TYPE", 0.0)
                because = f"{because}, CA_SV_CS{k}_TYPE = {kind:g}"
                surface = f"servo {k + 1}" if kind in _PX4_UNKNOWN else _PX4.get(int(kind))
            if surface is None:
                continue
            names = (f"{prefix}_MIN{n}", f"{prefix}_CENT{n}", f"{prefix}_MAX{n}")
            pwm_us, by, ends_by = _pulses(values, names, usual)
            if first == _UAVCAN_FIRST:
                by = f"CHECK: which instance of the outputs is UAVCAN's; {by}"
            reverse = int(values.get(f"{prefix}_REV", 0.0)) >> (n - 1) & 1 == 1
            yield Output(
                first + n,
                surface,
                because,
                pwm_us,
                by,
                reverse,
                is_surface=function not in _PX4_MOTORS,
                ends_by=ends_by,
                direction_by=f"bit {n - 1} of {prefix}_REV = {int(reverse)}, torque of CA_SV_CS{k}",
            )


def _pulses(
    values: Mapping[str, float], names: tuple[str, str, str], defaults: tuple[int, int, int]
) -> tuple[tuple[int, int, int], str, str]:
    """Return the pulses, their source, and the parameters of both ends if the log has them.

    A zero outside the range is replaced by the middle.
    """
    low, zero, high = (round(values.get(name, d)) for name, d in zip(names, defaults, strict=True))
    known = [name for name in (names[0], names[2]) if name in values]
    if high - low < _LEAST_RANGE_US:
        return defaults, f"CHECK: {names[0]} = {low} is not below {names[2]} = {high}", ""
    if len(known) < 2:
        by = "CHECK: the autopilot's usual pulses, the log does not tell them"
    else:
        by = ", ".join(name for name in names if name in values)
    if names[1] not in values or not low < zero < high:
        zero, by = (low + high) // 2, f"{by}; zero in the middle"
    return (low, zero, high), by, ", ".join(known) if len(known) == 2 else ""
