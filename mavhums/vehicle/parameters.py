"""The autopilot parameters in a log, as numbers, and the servo outputs that they assign to control surfaces.

ArduPilot sends an integer as a float of the same value; PX4 sends the integer's bits in place of the float.
Which of the two it is follows from the autopilot. On-board logs contain numbers.

Motors, throttle and gimbals, for example, are not control surfaces. Functions: ArduPilot SERVOn_FUNCTION;
PX4 PWM_MAIN_FUNCn, PWM_AUX_FUNCn or UAVCAN_SV_FUNCn = 201 + k, with the type of surface k in CA_SV_CSk_TYPE.
Functions that pass a channel through, or leave the output to a script, do not say what it moves.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mavhums.core.errors import MavhumsError
from mavhums.log import Decoder, Table, decode_blocks
from mavhums.log.base.decoder import text_of
from mavhums.vehicle.facts import PX4, RANGES
from mavhums.vehicle.formats import messages_of, reports
from mavhums.vehicle.formats.base import FactReport

PARAMETER_MESSAGES = messages_of("autopilot", "parameter")
"""What :class:`ReceivedParameters` reads."""

_GREATEST = RANGES["parameter"][1]
_INTEGERS = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4"}  # MAV_PARAM_TYPE


@dataclass(frozen=True, slots=True)
class Parameters:
    """The parameters of one vehicle, by name, each with its last value."""

    vehicle: int
    is_px4: bool
    values: Mapping[str, float]


@dataclass(slots=True)
class ReceivedParameters:
    """The parameters of all vehicles, as (bits of the float, type) by name, and the vehicles with PX4."""

    values: dict[int, dict[str, tuple[int, int]]] = field(default_factory=dict)
    px4: set[int] = field(default_factory=set)

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take the parameters, and the autopilots, of these tables."""
        self.add_autopilots(tables)
        for report in reports(tables, "parameter"):
            self.add_parameters(report)

    def add_autopilots(self, tables: Mapping[str, Table], before: int | None = None) -> None:
        """Take the autopilots of these tables, up to a place in the log if one is given.

        What the bits of an integer parameter mean depends on the autopilot that was known when they came.
        """
        for report in reports(tables, "autopilot"):
            chosen = report.values[:, 1] == PX4
            if before is not None:
                chosen &= report.table.frame < before
            self.px4.update(report.table.system[chosen].tolist())

    def add_parameters(self, report: FactReport) -> None:
        """Take the rows of a report of the fact ``parameter``."""
        if report.format.AUTOPILOT == PX4:
            self.px4.update(report.table.system.tolist())
        for system, (name, bits, kind) in zip(
            report.table.system.tolist(), report.values.tolist(), strict=True
        ):
            self.values.setdefault(system, {})[text_of(name)] = bits, kind

    def of(self, vehicle: int) -> Parameters:
        """Return the parameters that a vehicle sent so far."""
        is_px4 = vehicle in self.px4
        sent = self.values.get(vehicle, {})
        values = {name: _number(*value, is_px4=is_px4) for name, value in sent.items()}
        return Parameters(
            vehicle, is_px4, {name: value for name, value in values.items() if abs(value) <= _GREATEST}
        )


def read_parameters(
    path: str | os.PathLike[str],
    *,
    vehicle: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Parameters:
    """Read a vehicle's parameters from a log.

    Parameters
    ----------
    path
        A log.
    vehicle
        System id; may be None if the log contains the parameters of only one vehicle.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a log.
    MavhumsError
        If the log contains no parameters, none of the vehicle, or those of several vehicles.
    """
    received = ReceivedParameters()
    for tables, _, _ in decode_blocks(path, Decoder(PARAMETER_MESSAGES), progress=progress):
        received.feed(tables)
    path, vehicles = Path(path), sorted(received.values)
    if not vehicles:
        remedy = "let the ground station download them while it records (a refresh of its parameter list)"
        raise MavhumsError(f"{path}: contains no parameters", remedy)
    listed = ", ".join(map(str, vehicles))
    if vehicle is None and len(vehicles) > 1:
        raise MavhumsError(
            f"{path}: contains the parameters of vehicles {listed}", "choose one with --vehicle"
        )
    if vehicle is not None and vehicle not in vehicles:
        raise MavhumsError(
            f"{path}: contains no parameters of vehicle {vehicle}", f"it contains those of {listed}"
        )
    return received.of(vehicles[0] if vehicle is None else vehicle)


def _number(bits: int, kind: int, *, is_px4: bool) -> float:
    """Return a parameter's value from the bits of its float.

    Examples
    --------
    >>> _number(1000, 6, is_px4=True)
    1000.0
    """
    word = np.array(bits, dtype="<u4")
    integer = _INTEGERS.get(kind) if is_px4 else None
    return float(word.view("<f4") if integer is None else word.astype(integer))


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
MOTORS = {33 + k: k for k in range(8)} | {82 + k: k + 8 for k in range(4)}
"""The number of a motor, from 0, by SERVOn_FUNCTION."""
_NO_SURFACES = {function: f"motor {k + 1}" for function, k in MOTORS.items()} | {
    26: "ground steering",
    27: "parachute",
    28: "gripper",
    29: "landing gear",
    70: "throttle",
    73: "left throttle",
    74: "right throttle",
}
_OLD_CHANNELS = (("ROLL", 1, 4), ("PITCH", 2, 19), ("THROTTLE", 3, 70), ("YAW", 4, 21))
"""Channels of ArduPlane before 3.8: name in RCMAP_*, usual channel, and the function that it has since."""
_OLD_MIXERS = ("ELEVON_MIXING", "ELEVON_OUTPUT", "VTAIL_OUTPUT")
OUTPUT_PARAMETERS = ("SERVO", "PWM_", "HIL_ACT", "RC", "KFF_RDDRMIX", "CRUISE_THROTTLE", *_OLD_MIXERS)
"""Beginnings of the names of parameters that say what an output moves."""
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


_PER_BUS = 16
_LEAST_RANGE_US = 2  # a zero needs a pulse between the ends
_UAVCAN_FIRST = 32
_BUSES = (
    ("PWM_MAIN", 0, (1000, 1500, 2000)),
    ("PWM_AUX", 16, (1000, 1500, 2000)),
    ("UAVCAN_SV", _UAVCAN_FIRST, (0, 500, 1000)),
)
"""PX4's groups of outputs: prefix of their parameters, channel before the first, and usual pulses."""


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
    lacks
        The parameters of its pulses and its direction that the log lacks although it has others of their
        kind: what they say is not known.
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
    lacks: tuple[str, ...] = ()


def functions_of(values: Mapping[str, float]) -> dict[int, int]:
    """Return the SERVOn_FUNCTION of each of ArduPilot's outputs, from 1; 0 where the log has none."""
    return {n: int(values.get(f"SERVO{n}_FUNCTION", 0.0)) for n in range(1, _CHANNELS + 1)}


def assigned_outputs(parameters: Parameters) -> list[Output]:
    """Return the outputs whose parameters say what they move, in the order of their channels.

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
        return  # other parameters say which of two mixed outputs is which, and its direction
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
            lacks=lacking(values, stem, n, ("MIN", "TRIM", "MAX", reverse_by)),
        )


def _px4(values: Mapping[str, float]) -> Iterator[Output]:
    beginnings = ("CA_SV_CS", *(prefix for prefix, _, _ in _BUSES))
    kinds = {name.rstrip("0123456789").rpartition("_")[2] for name in values if name.startswith(beginnings)}
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
                lacks=tuple(
                    name
                    for name in (
                        f"{prefix}_REV",
                        *(f"{prefix}_{end}{n}" for end in ("MIN", "MAX")),
                        *(f"CA_SV_CS{k}_TRQ_{letter}" for letter in "RPY"),
                    )
                    if name not in values and name.rstrip("0123456789").rpartition("_")[2] in kinds
                ),
            )


def lacking(values: Mapping[str, float], stem: str, n: int, parts: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters of output ``n`` that a log lacks although it has those of other outputs.

    Autopilots send all or none of a kind: where others are, a missing one was lost, and no default is known
    to be its value.

    Examples
    --------
    >>> lacking({"SERVO1_MIN": 1000.0, "SERVO2_MAX": 2000.0}, "SERVO", 2, ("MIN", "TRIM", "MAX"))
    ('SERVO2_MIN',)
    """
    own = (part for part in parts if f"{stem}{n}_{part}" not in values)
    others = range(1, _CHANNELS + 1)
    return tuple(f"{stem}{n}_{part}" for part in own if any(f"{stem}{k}_{part}" in values for k in others))


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
        by = "CHECK: the autopilot's usual pulses, the log does not contain them"
    else:
        by = ", ".join(name for name in names if name in values)
    if names[1] not in values or not low < zero < high:
        zero, by = (low + high) // 2, f"{by}; zero in the middle"
    return (low, zero, high), by, ", ".join(known) if len(known) == 2 else ""
