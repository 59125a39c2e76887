"""Airframe profiles: servos and their surfaces, EMA constants, and limits."""

from __future__ import annotations

import tomllib
from importlib import resources
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from mavhums.actuator.profile_checks import Place, explain_syntax, explain_values, field_mistake
from mavhums.actuator.servo_types import with_servo_types
from mavhums.core.errors import MavhumsError
from mavhums.core.models import Contract, Frozen
from mavhums.core.quantities import KEYS
from mavhums.results.reasons import FILL_IN
from mavhums.results.sections import AxisLimits

_LARGEST = 1e9  # squares and products of such numbers stay finite
_SMALLEST = 1e-12  # and their quotients, too
_Finite = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
_Positive = Annotated[float, Field(ge=_SMALLEST, le=_LARGEST, allow_inf_nan=False)]
_Pulse = Annotated[int, Field(ge=0, le=65_535)]
_NotNegative = Annotated[float, Field(ge=0, le=_LARGEST, allow_inf_nan=False)]

_BEYOND = 0.05  # share of the range: an end that is trimmed is still the same calibration


class ProfileError(MavhumsError):
    """An airframe profile is missing, incomplete or invalid."""


class Ema(Contract):
    """The actuator's constants, from its data sheet or identified; torques at the output shaft.

    Attributes
    ----------
    gear_ratio
        Rotor turns per output shaft turn.
    torque_constant
        Torque constant of the motor, N·m/A; equals the back-EMF constant in V·s/rad.
    resistance
        Resistance of the stator winding, Ω.
    inertia
        Inertia of rotor and gear, referred to the rotor, kg·m².
    torque_uncertainty
        Relative 95 % uncertainty of the torque scale; it widens every friction interval.
    inertia_uncertainty
        Relative 95 % uncertainty of the inertia; it must cover the inertia of the surface.
    viscous, viscous_uncertainty
        Viscous drag at the output shaft and its 95 % uncertainty, N·m·s/rad.
    load_friction
        Friction per load, both torques at the output shaft: T_f = T_c + load_friction·|load|. None if
        unknown: between 0 and 0.5, and no emergency rests on it being small.
    load_friction_uncertainty
        Its 95 % uncertainty; without effect where load_friction is 0 or unknown.
    stiffness
        Stiffness of the gear, at the output shaft, N·m/rad; None if unknown.
    supply_voltage
        Voltage of the healthy supply, V; None disables the detection of supply sag.
    """

    gear_ratio: _Positive
    torque_constant: _Positive
    resistance: _Positive
    inertia: _Positive
    torque_uncertainty: Annotated[float, Field(ge=0, lt=1)] = 0.02
    inertia_uncertainty: Annotated[float, Field(gt=0, le=10)] = 0.5
    viscous: _NotNegative = 0.0
    viscous_uncertainty: _Positive = 0.05
    load_friction: Annotated[float, Field(ge=0, le=1)] | None = None
    load_friction_uncertainty: Annotated[float, Field(ge=0, le=1)] = 0.1
    stiffness: _Positive | None = None
    supply_voltage: _Positive | None = None


class Limits(Contract):
    """Limits of the fault indicators: degraded and emergency.

    Attributes
    ----------
    normal, emergency
        Coulomb friction at the output shaft, N·m: normal up to one value, an emergency from another.
    resistance_gain, torque_constant_loss
        Changes relative to the data sheet, as fractions. Copper gains 0.39 % of resistance per kelvin.
    backlash_deg, sensor_bias_deg
        Values at the output shaft, °; None if the type's own value is not known.
    supply_sag_v
        Voltage lost on the actuator's supply.
    following_deg, following_emergency_deg
        Angle by which the shaft misses what slew rate and stroke allow, root mean square over a second.
    """

    normal: _Positive
    emergency: _Positive
    # 0.1 is 26 K of warming of copper: less would call a warm winding degraded.
    resistance_gain: _Positive = 0.1
    # The defaults below are a judgement of what is worth a repair; no benchmark sets them.
    torque_constant_loss: _Positive = 0.1
    backlash_deg: _Positive | None = None
    sensor_bias_deg: _Positive | None = None
    supply_sag_v: _Positive = 3.0
    following_deg: _Positive = 2.0
    following_emergency_deg: _Positive = 5.0

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.emergency <= self.normal:
            raise ValueError("the emergency limit must lie above the normal limit")
        if self.following_emergency_deg <= self.following_deg:
            raise ValueError("following_emergency_deg must lie above following_deg")
        return self


class IdentifiedMotor(Frozen):
    """Motor constants from ``mavhums profile identify``, each with its 95 % interval.

    Attributes
    ----------
    resistance, back_emf, drop
        Estimate, low and high: of the winding, Ω; per rad/s of the rotor, V; of brushes or dead time, V.
    convention
        Convention of current and voltage. The back-EMF constant equals the torque constant only for ``dc``.
    flights
        Logs that were used.
    """

    resistance: tuple[_Positive, _Positive, _Positive]
    back_emf: tuple[_Positive, _Positive, _Positive]
    drop: tuple[_Finite, _Finite, _Finite]
    convention: Literal["unknown", "dc"] = "unknown"
    flights: tuple[str, ...]


class FieldMapping(Contract):
    """Mapping of a message field to a quantity: value = field · scale + offset, in the quantity's unit.

    Attributes
    ----------
    message
        MAVLink message, DataFlash record or ULog topic, for example NAMED_VALUE_FLOAT, CSRV or esc_status.
    field
        Field of the message; ``rpm[2]`` is an element of an array, ``esc[0].esc_rpm`` a nested field.
    where
        Values that other fields must have, for example ``{ name = "S1Pos" }``; ``multi_id`` is the instance
        of a ULog topic.
    """

    message: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
    field: Annotated[str, Field(pattern=r"^[A-Za-z_]\w*(\[\d{1,3}\])?(\.[A-Za-z_]\w*(\[\d{1,3}\])?)*$")]
    where: dict[str, str | int] = {}
    scale: _Finite = 1.0
    offset: _Finite = 0.0

    @model_validator(mode="after")
    def _exists(self) -> FieldMapping:
        mistake = field_mistake(self.message, self.field, self.where)
        if mistake is not None:
            raise PydanticCustomError("mapping", "{problem}", mistake._asdict())
        return self


class Actuator(Contract):
    """One servo actuator and the control surface it moves.

    Attributes
    ----------
    servo
        Output channel, from 1.
    esc
        Index of the ESC that drives it, from 0; None if no ESC reports on it.
    servo_type
        Name of the type that fills in constants, speed and travel: see :mod:`~mavhums.actuator.servo_types`.
    csrv
        Id of its CSRV records; None if it is the servo's output, from 0, or from 1 on DroneCAN.
    esc_side
        Whether that ESC, or the servo itself, measures at the motor's terminals or at the supply bus.
    electronics_a
        Current that the electronics draw from the bus in addition to the motor, A.
    travel_deg, pwm_us
        Deflection at the smallest and the largest pulse; the pulses at the least, the zero and the
        largest deflection.
        Neither can be derived from a log; without ``travel_deg`` a pulse cannot be converted to an angle.
    moving_speed_deg_s
        Output speed above which the actuator counts as moving.
    response_lag_s
        Delay of the shaft behind the command, s.
    slew_deg_s
        Speed of the output shaft that the data sheet gives under nominal load; None disables the detection
        of a shaft that does not follow.
    min_rate_hz
        Minimum rate, Hz; a quantity with a lower rate is shown but not used as evidence.
    ema, limits
        None in a draft: the actuator's quantities are shown, but it is not judged.
    identified
        Motor constants identified from its own flights; no verdict uses them.
    fields
        Quantities that the log carries in custom messages.
    """

    name: Annotated[str, Field(min_length=1)]
    surface: str = ""
    servo: Annotated[int, Field(ge=1, le=48)]
    esc: Annotated[int, Field(ge=0, le=31)] | None = None
    servo_type: str | None = None
    csrv: Annotated[int, Field(ge=0, le=255)] | None = None
    esc_side: Literal["motor", "bus"] = "motor"
    electronics_a: _NotNegative = 0.0
    travel_deg: tuple[_Finite, _Finite] | None = None
    pwm_us: tuple[_Pulse, _Pulse, _Pulse]
    # Lower takes noise of the angle for motion; higher loses the samples of slow commands.
    moving_speed_deg_s: _Positive = 1.0
    response_lag_s: Annotated[float, Field(ge=0.04, le=1.0)] = 0.05
    slew_deg_s: _Positive | None = None
    # Lower lets registers that are refreshed once a second count as evidence.
    min_rate_hz: _Positive = 5.0
    ema: Ema | None = None
    limits: Limits | None = None
    identified: IdentifiedMotor | None = None
    fields: dict[Literal[*KEYS], FieldMapping] = {}  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _increasing(self) -> Actuator:
        if not self.pwm_us[0] < self.pwm_us[1] < self.pwm_us[2]:
            raise ValueError("the pulses in pwm_us must increase; a reversal belongs into travel_deg")
        return self

    @property
    def range_us(self) -> tuple[float, float]:
        """Shortest and longest pulse that ``pwm_us`` calibrates: ends are trimmed by some ten µs of 800."""
        spare = _BEYOND * (self.pwm_us[2] - self.pwm_us[0])
        return self.pwm_us[0] - spare, self.pwm_us[2] + spare

    @property
    def blanks(self) -> tuple[str, ...]:
        """Keys of the file that a verdict needs and the profile lacks."""
        sections = (("[actuators.ema]", self.ema), ("[actuators.limits]", self.limits))
        return tuple(name for name, section in sections if section is None)

    def known_ema(self) -> Ema:
        """Return the EMA's constants.

        Raises
        ------
        ProfileError
            If the profile lacks them.
        """
        if self.ema is None:
            raise self._blank()
        return self.ema

    def known_limits(self) -> Limits:
        """Return the friction limits.

        Raises
        ------
        ProfileError
            If the profile lacks them.
        """
        if self.limits is None:
            raise self._blank()
        return self.limits

    def _blank(self) -> ProfileError:
        return ProfileError(f"{self.name}: the profile has no {' and no '.join(self.blanks)}", FILL_IN)

    @property
    def moving_speed_rev_min(self) -> float:
        """Rotor speed above which the actuator counts as moving."""
        return self.moving_speed_deg_s * self.known_ema().gear_ratio / 6.0

    @property
    def inertia_output(self) -> float:
        """Rotating inertia referred to the output shaft, kg·m²."""
        return self.known_ema().inertia * self.known_ema().gear_ratio ** 2

    def rad_s(self, rotor_rev_min: float) -> float:
        """Convert a rotor speed in rev/min to the output shaft's speed in rad/s."""
        return rotor_rev_min * 2 * pi / 60 / self.known_ema().gear_ratio


class Airframe(Contract):
    """An airframe profile: its name, its actuators, and the limits of its axes."""

    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    axes: AxisLimits = AxisLimits()
    actuators: Annotated[tuple[Actuator, ...], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _typed(cls, profile: Any) -> Any:
        return with_servo_types(profile)

    @model_validator(mode="after")
    def _distinct(self) -> Airframe:
        for field in ("name", "servo"):
            seen = [getattr(actuator, field) for actuator in self.actuators]
            for k, value in enumerate(seen):
                if value in seen[:k]:
                    raise PydanticCustomError(
                        "shared",
                        "two actuators share {field} = {value}",
                        {"field": field, "value": repr(value), "place": ("actuators", k, field)},
                    )
        return self


_SECTIONS: dict[Place, tuple[str, ...]] = {
    (): tuple(Airframe.model_fields),
    ("axes",): tuple(AxisLimits.model_fields),
    ("actuators",): tuple(Actuator.model_fields),
    ("actuators", "ema"): tuple(Ema.model_fields),
    ("actuators", "limits"): tuple(Limits.model_fields),
    ("actuators", "identified"): tuple(IdentifiedMotor.model_fields),
    ("actuators", "fields"): tuple(FieldMapping.model_fields),
}


def packaged_airframes() -> list[str]:
    """Return the names of the packaged profiles.

    Examples
    --------
    >>> packaged_airframes()
    ['paper']
    """
    folder = resources.files("mavhums.actuator").joinpath("airframes")
    return sorted(
        entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")
    )


def packaged_text(name: str) -> str:
    """Return the text of a packaged profile."""
    packaged = resources.files("mavhums.actuator").joinpath(f"airframes/{name}.toml")
    return packaged.read_text(encoding="utf-8")


def load_airframe(name_or_path: Airframe | str | Path) -> Airframe:
    """Load a packaged profile by name, or a user's profile by path; a profile is returned as it is.

    Raises
    ------
    ProfileError
        If there is no such profile, or it is not valid; the message names the line.

    Examples
    --------
    >>> [actuator.name for actuator in load_airframe("paper").actuators]
    ['aileron_left', 'aileron_right', 'elevator', 'rudder']
    """
    if isinstance(name_or_path, Airframe):
        return name_or_path
    path = Path(name_or_path)
    if str(name_or_path) in packaged_airframes():
        text = packaged_text(str(name_or_path))
    else:
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            problem = f"{path}: this is not an airframe profile but a binary file, as a log is"
            remedy = "name the profile, a TOML file, with --airframe, and the log by itself"
            raise ProfileError(problem, remedy) from error
        except OSError as error:
            known = ", ".join(packaged_airframes())
            problem = f"no airframe profile {str(name_or_path)!r}"
            raise ProfileError(problem, f"name a TOML file, or one of: {known}") from error
    try:
        return Airframe.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(*explain_syntax(str(name_or_path), text, str(error))) from error
    except ValidationError as error:
        raise ProfileError(*explain_values(str(name_or_path), text, error, _SECTIONS)) from error
