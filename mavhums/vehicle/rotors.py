"""The motors of a multirotor, by the log's parameters: output, place, direction and thrust curve of each.

ArduPilot: FRAME_CLASS, FRAME_TYPE (FRAME before 3.5), SERVOn_FUNCTION, MOT_*. PX4: CA_ROTORn_*, else the
frames of SYS_AUTOSTART. Rovers and boats have FRAME_CLASS, too; MOT_SPIN_MIN belongs to copters alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.results.reasons import Reason
from mavhums.vehicle.formats.px4_buses import Bus, buses_of, uses_dshot
from mavhums.vehicle.parameters import MOTORS, Parameters, functions_of
from mavhums.vehicle.vtol import turns_its_motors

ROTOR_PARAMETERS: Final = (
    "FRAME",
    "MOT_",
    "RCMAP_THROTTLE",
    "CA_",
    "SYS_",
    "DSHOT_",
    "UAVCAN_",
    "SIM_GZ_",
    "MAV_TYPE",
    "THR_MDL_FAC",
)
"""Beginnings of the names of parameters that describe motors."""

_QUAD, _HEXA, _OCTA = 1, 2, 3  # FRAME_CLASS
_SIZES: Final = {_QUAD: "quad", _HEXA: "hexa", _OCTA: "octa"}
_TYPES: Final = {0: "+", 1: "X", 3: "H", 12: "X (Betaflight order)", 13: "X (DJI order)", 14: "X (clockwise)"}
_CCW, _CW = 1, -1
_FRAMES: Final[Mapping[tuple[int, int], tuple[tuple[float, int], ...]]] = {
    (_QUAD, 0): ((90, _CCW), (-90, _CCW), (0, _CW), (180, _CW)),
    (_QUAD, 1): ((45, _CCW), (-135, _CCW), (-45, _CW), (135, _CW)),
    (_QUAD, 3): ((45, _CW), (-135, _CW), (-45, _CCW), (135, _CCW)),
    (_QUAD, 12): ((135, _CW), (45, _CCW), (-135, _CCW), (-45, _CW)),
    (_QUAD, 13): ((45, _CCW), (-45, _CW), (-135, _CCW), (135, _CW)),
    (_QUAD, 14): ((45, _CCW), (135, _CW), (-135, _CCW), (-45, _CW)),
    (_HEXA, 0): ((0, _CW), (180, _CCW), (-120, _CW), (60, _CCW), (-60, _CCW), (120, _CW)),
    (_HEXA, 1): ((90, _CW), (-90, _CCW), (-30, _CW), (150, _CCW), (30, _CCW), (-150, _CW)),
    (_HEXA, 13): ((30, _CCW), (-30, _CW), (-90, _CCW), (-150, _CW), (150, _CCW), (90, _CW)),
    (_HEXA, 14): ((30, _CCW), (90, _CW), (150, _CCW), (-150, _CW), (-90, _CCW), (-30, _CW)),
    (_OCTA, 0): (
        (0, _CW), (180, _CW), (45, _CCW), (135, _CCW), (-45, _CCW), (-135, _CCW), (-90, _CW), (90, _CW),
    ),
    (_OCTA, 1): (
        (22.5, _CW), (-157.5, _CW), (67.5, _CCW), (157.5, _CCW),
        (-22.5, _CCW), (-112.5, _CCW), (-67.5, _CW), (112.5, _CW),
    ),
}  # fmt: skip
"""Place, degrees clockwise from the nose, and direction of each motor, by FRAME_CLASS and FRAME_TYPE."""


TURNED: Final = Reason(
    "unjudged_frame", frames="lift motors that also drive forward flight (tiltrotor, tailsitter)"
)
_PAIRED: Final = "motors in pairs, one above the other, so which of a pair failed is not certain: they"
_UNJUDGED: Final = {
    4: f"an octa-quad has {_PAIRED}",
    5: f"a Y6 has {_PAIRED}",
    7: "a tricopter turns by a servo, so its yaw shows no motor: its motors",
    12: f"a dodeca-hexa has {_PAIRED}",
}
"""Why frames are not judged, by FRAME_CLASS."""

_PX4_FIRST_MOTOR: Final = 101  # PWM_MAIN_FUNCn
_PX4_KINDS: Final = {2: _QUAD, 13: _HEXA, 14: _OCTA}  # MAV_TYPE
_PX4_STANDARD_VTOL: Final = 2  # CA_AIRFRAME
_PX4_PLUS: Final = (5, 7, 9)  # thousands of SYS_AUTOSTART
_ROUNDING: Final = 1e-9  # a share below comes from sin 180°, which is not exactly 0
_LEAST_RANGE_US: Final = 100.0  # between idle and full thrust: less is a damaged or a missing calibration
_PULSES_US: Final = (1000.0, 2000.0)  # of PX4
_SPINS: Final = (0.15, 0.95)  # idle and full output of Copter before 3.4, shares of the range
_EXPO: Final = 0.65  # usual MOT_THST_EXPO
_OVERRIDDEN: Final = 0.15
"""Share of full thrust by which an output differs from what the mixer asks of it: less is the sampling."""
_WOUND_UP: Final = 0.5
"""What is asked for by what is sent: of a copter that flies they differ by their curves."""
_PX4_EXPONENT: Final = 1.5
"""Exponent of thrust by output where THR_MDL_FAC is not given: between the propeller's 2 and the ESC's 1."""


@dataclass(frozen=True, slots=True)
class Rotors:
    """The motors of one multirotor.

    Attributes
    ----------
    frame
        In words, for example ``quad X``.
    servos
        Output of each motor, from 1.
    shares
        Of each motor: what a unit of its thrust adds to the effort about roll, pitch and yaw. These are the
        mixer's factors, scaled to at most 1, each by the sum of their squares.
    bearings_deg
        Where each motor sits, clockwise from the nose, -180 to 180.
    idle, full
        Pulses at no thrust and at full thrust, µs.
    curve
        Of the thrust (1 − e)·x + e·x², by ArduPilot's MOT_THST_EXPO or PX4's THR_MDL_FAC; None for x^1.5.
    lift
        Whether they only lift a quadplane: what they do counts where it hovers.
    assumed
        What no parameter of such a log says and is taken as usual; an empty text for nothing.
    """

    frame: str
    servos: tuple[int, ...]
    shares: tuple[tuple[float, ...], ...]
    bearings_deg: tuple[float, ...] = field(compare=False)
    idle: float
    full: float
    curve: float | None
    lift: bool = False
    assumed: str = ""

    @property
    def columns(self) -> Array:
        """The shares, shape (motors, 3)."""
        return np.array(self.shares)

    def thrusts(self, pulses: Array, mixer: Array) -> Array:
        """Return the thrust asked of each motor, a share of its full thrust, shape (…, n, motors).

        Parameters
        ----------
        pulses
            Pulses of the outputs over one second or less, µs, shape (…, n, outputs), NaN where an output is
            off.
        mixer
            What the mixer was asked for: roll, pitch, yaw and thrust, shape (…, n, 4), NaN where unknown.
        """
        sent = self._sent(pulses)
        # ArduPilot's mixer adds half of what is asked about an axis to each motor's thrust.
        factors = self.columns / np.abs(self.columns).max(axis=0)
        asked = np.clip(mixer[..., 3:] + 0.5 * mixer[..., :3] @ factors.T, 0.0, 1.0)
        # An output that is overridden or passed through no longer shows what is asked of its motor. Where all
        # outputs but one or two follow the mixer, those are replaced; at the limits more of them differ. An
        # override lasts: what differs in a few rows was asked for between two samples.
        apart = sent - asked
        apart -= np.median(apart, axis=-1, keepdims=True)
        odd = np.abs(np.median(apart, axis=-2, keepdims=True)) > _OVERRIDDEN
        replaced = odd & (odd.sum(axis=-1, keepdims=True) <= len(self.servos) // 3)
        return np.where(replaced, sent - apart, sent)

    def _sent(self, pulses: Array) -> Array:
        x = (pulses[..., [servo - 1 for servo in self.servos]] - self.idle) / (self.full - self.idle)
        x = np.clip(x, 0.0, 1.0)
        e = self.curve
        return np.asarray(x**_PX4_EXPONENT if e is None else (1 - e) * x + e * x**2)


def mean_thrust(thrusts: Array, mixer: Array) -> Array:
    """Return the thrust asked of all motors, a share of all they have, shape (n,).

    Parameters
    ----------
    thrusts
        Of each motor, as :meth:`Rotors.thrusts` returns it, shape (n, motors).
    mixer
        What the mixer was asked for: roll, pitch, yaw and thrust, shape (n, 4), NaN where unknown.
    """
    # The outputs of a copter at rest wind up without throttle: what is asked for does not.
    sent, asked = thrusts.mean(axis=1), mixer[:, 3]
    return np.where(asked < _WOUND_UP * sent, asked, sent)


def rotors_of(parameters: Parameters) -> Rotors | Reason | None:
    """Return the motors of a multirotor; why they are not known; or None if it is not known to be one.

    Examples
    --------
    >>> rotors_of(Parameters(1, False, {"FRAME_CLASS": 1.0, "MOT_SPIN_MIN": 0.15})).text
    'the log lacks the parameter FRAME_TYPE, so what each motor does is not known'
    """
    values = parameters.values
    try:
        return _of_px4(values) if parameters.is_px4 else _of_ardupilot(values)
    except KeyError as missing:
        # No default takes its place: a log that lost a few records hides any value.
        return Reason("no_parameter", name=missing.args[0])


def _of_ardupilot(values: Mapping[str, float]) -> Rotors | Reason | None:
    lift = values.get("Q_ENABLE", 0.0) > 0.0
    if lift:
        # A quadplane has Q_TILT_MASK unless Q_TILT_ENABLE hides it; Q_TAILSIT_ENABLE is as old as this.
        needed = {"Q_TAILSIT_ENABLE": "Q_TILT_ENABLE" in values}
        needed |= {"Q_TILT_MASK": values.get("Q_TILT_ENABLE") != 0.0}
        if turns_its_motors(values):
            return TURNED
        if missing := [name for name, is_needed in needed.items() if is_needed and name not in values]:
            raise KeyError(*missing)
    # A quadplane's lift motors have a copter's parameters under other names.
    motors, frame = ("Q_M_", "Q_FRAME_") if lift else ("MOT_", "FRAME_")
    if not any(name.startswith(f"{motors}SPIN") for name in values):
        return None
    # Copter before 3.5 has a fixed output for each motor, and does not say how many there are.
    fixed = not lift and "FRAME" in values
    kind, type_ = (_QUAD, values["FRAME"]) if fixed else (values[f"{frame}CLASS"], values[f"{frame}TYPE"])
    places = _FRAMES.get((int(kind), int(type_)))
    if places is None:
        why = _UNJUDGED.get(int(kind), f"frames of FRAME_CLASS {kind:.0f} and FRAME_TYPE {type_:.0f}")
        return Reason("unjudged_frame", frames=why)
    found = {MOTORS[function]: n for n, function in functions_of(values).items() if function in MOTORS}
    if fixed:
        found = {k: k + 1 for k in range(len(places))}
    if set(range(len(places))) - found.keys():
        return Reason("motor_unassigned", names="SERVOn_FUNCTION")
    # Before 3.4 a curve is not always given, and the range by other parameters: it is the usual one.
    old = fixed and "MOT_SPIN_ARMED" in values
    least, most, curve = (
        (*_SPINS, values.get("MOT_THST_EXPO", _EXPO))
        if old
        else (values[f"{motors}{name}"] for name in ("SPIN_MIN", "SPIN_MAX", "THST_EXPO"))
    )
    low, high = (_end(values, motors, end, old=old) for end in ("MIN", "MAX"))
    idle, full = low + least * (high - low), low + most * (high - low)
    if not full > idle + _LEAST_RANGE_US:
        return Reason("pulses_implausible", motors=motors)
    name = f"{'lift ' * lift}{_SIZES[int(kind)]} {_TYPES[int(type_)]}"
    servos, bearings = tuple(found[k] for k in range(len(places))), tuple(float(angle) for angle, _ in places)
    assumed = "the number of motors" * fixed + " and their idle and full output" * old
    return Rotors(name, servos, _shares(_factors(places)), bearings, idle, full, curve, lift, assumed)


def _end(values: Mapping[str, float], motors: str, end: str, *, old: bool) -> float:
    """Return the pulse at an end of the motors' range; where it is 0, the throttle channel gives it."""
    own = 0.0 if old else values[f"{motors}PWM_{end}"]
    if own > 0.0:
        return own
    if motors == "MOT_":
        return values[f"RC{values['RCMAP_THROTTLE']:.0f}_{end}"]
    return values[f"Q_THR_{end}_PWM"]


def _of_px4(values: Mapping[str, float]) -> Rotors | Reason | None:
    # The old mixers are in use where SYS_CTRL_ALLOC is 0, and before there were functions of outputs.
    allocates = any(name.startswith("CA_") or "_FUNC" in name for name in values)
    airframe = values["CA_AIRFRAME"] if allocates and values.get("SYS_CTRL_ALLOC") != 0.0 else None
    if airframe is not None:
        if airframe not in (0.0, _PX4_STANDARD_VTOL):
            return None
        count = int(values["CA_ROTOR_COUNT"])
        if airframe == _PX4_STANDARD_VTOL:  # the last ones push
            count = next((k for k in range(count) if values[f"CA_ROTOR{k}_AX"] != 0.0), count)
        parts = ("PX", "PY", "KM")
        placed = np.array([[values[f"CA_ROTOR{k}_{part}"] for part in parts] for k in range(count)])
        placed = placed.reshape(-1, 3)
        factors = np.stack([-placed[:, 1], placed[:, 0], placed[:, 2]], axis=1)
        servos, ends = _px4_outputs(values, count)
        size = next((name for name, n in (("quad", 4), ("hexa", 6), ("octa", 8)) if n == count), None)
    else:
        kind = _PX4_KINDS.get(int(values.get("MAV_TYPE", 0.0)))
        if kind is None or "SYS_AUTOSTART" not in values:
            return None
        type_ = 0 if int(values["SYS_AUTOSTART"]) // 1000 in _PX4_PLUS else 1
        factors = _factors(_FRAMES[kind, type_])
        dshot = values["DSHOT_MIN"] if uses_dshot(values, "PWM_MAIN") else 0.0
        ends = (1000.0 + 1000.0 * dshot, 2000.0)
        servos, size = tuple(range(1, len(factors) + 1)), f"{_SIZES[kind]} {_TYPES[type_]}"
    if size is None or np.linalg.matrix_rank(factors) < 3 or (np.abs(factors).max(axis=0) <= 0).any():
        return Reason("unjudged_frame", frames="frames with such an arrangement of rotors")
    if len(servos) < len(factors):
        return Reason("motor_unassigned", names="PWM_MAIN_FUNCn")
    bearings = tuple(np.degrees(np.arctan2(-factors[:, 0], factors[:, 1])).round(1).tolist())
    assumed = "" if airframe is not None else "the order of the motors on the outputs"
    curve = (values["THR_MDL_FAC"] if airframe is not None else values.get("THR_MDL_FAC", 0.0)) or None
    lift = airframe == _PX4_STANDARD_VTOL
    size = f"lift {size}" if lift else size
    return Rotors(size, servos, _shares(factors), bearings, *ends, curve, lift, assumed)


def _px4_outputs(values: Mapping[str, float], count: int) -> tuple[tuple[int, ...], tuple[float, float]]:
    """Return the outputs of PX4's motors, none if some has none, and their idle and full pulses."""
    for bus, functions in buses_of(values).items():
        found = {function - _PX4_FIRST_MOTOR: n for n, function in functions.items()}
        if all(k in found for k in range(count)):
            servos = tuple(16 * bus.place + found[k] for k in range(count))
            return servos, _px4_range(values, bus, [found[k] for k in range(count)])
    return (), _PULSES_US


def _px4_range(values: Mapping[str, float], bus: Bus, outputs: Sequence[int]) -> tuple[float, float]:
    """Return the idle and the full pulse of PX4's motors on some outputs of a driver."""
    if not bus.full and uses_dshot(values, bus.prefix):
        return 1000.0 + 1000.0 * values["DSHOT_MIN"], 2000.0
    names = [f"{bus.prefix}_{end}{n}" for end in ("MIN", "MAX") for n in outputs]
    # Simulators have no such parameters, and their motors the usual range.
    if not any(name.startswith((f"{bus.prefix}_MIN", f"{bus.prefix}_MAX")) for name in values):
        return _PULSES_US
    ends = np.array([values[name] for name in names]).reshape(2, -1)
    if bus.full:
        ends = 1000.0 + 1000.0 * ends / bus.full
    low, high = np.median(ends, axis=1).tolist()
    return low, high


def _factors(places: tuple[tuple[float, int], ...]) -> Array:
    angles = np.radians([angle for angle, _ in places])
    return np.stack([-np.sin(angles), np.cos(angles), [float(spin) for _, spin in places]], axis=1)


def _shares(factors: Array) -> tuple[tuple[float, ...], ...]:
    factors = factors / np.abs(factors).max(axis=0)
    shares = factors / (factors**2).sum(axis=0)
    shares[np.abs(shares) < _ROUNDING] = 0.0
    return tuple(map(tuple, shares.tolist()))
