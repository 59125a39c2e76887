"""Identifies the motors of servos from their own flights, and writes the result into a profile."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mavhums.actuator.plausibility import not_used
from mavhums.actuator.profile import Airframe
from mavhums.app.analysis import analyse
from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError
from mavhums.health.estimation.motor_identification import VOLTAGE, Identified, identified
from mavhums.results.verdict import Interval, OwnRecord

_BLOCK = re.compile(r"(?m)^\[\[actuators\]\][^\n]*\n(?:(?!^\[\[actuators\]\]).*\n?)*")
_BEFORE = re.compile(r"(?ms)^\[actuators\.identified\][^\n]*\n(?:(?!^\[)[^\n]*\n?)*")
_OWN_NAME = re.compile(r"(?m)^name\s*=\s*(\"(?:[^\"\\]|\\.)*\"|'[^']*')")
_TO_IDENTIFY = "record each servo's voltage, current and rotor speed (V4, V5, V7) at the motor, in motion"


@dataclass(frozen=True, slots=True)
class MotorIdentification:
    """The identified motor of one actuator, and the names of the logs used."""

    found: Identified
    flights: tuple[str, ...]


def identify(
    logs: Sequence[str | os.PathLike[str]],
    options: Options | Settings,
    *,
    progress: Callable[[int], None] | None = None,
) -> dict[str, MotorIdentification]:
    """Return the motor of each actuator, identified from all logs of one aircraft, by actuator.

    Parameters
    ----------
    logs
        Logs of flights of the same aircraft.
    options
        The options, with a profile in which the EMA's constants or limits are open.
    progress
        Called with the number of bytes read of each log after each block.

    Raises
    ------
    MavhumsError
        If a log or the profile cannot be read, or no log shows any motor.
    """
    records: dict[str, list[tuple[str, OwnRecord]]] = {}
    refused: list[str] = []
    settings = Settings.read(options).alone()
    for path in logs:
        for verdict in analyse(path, settings, progress=progress).verdicts:
            refused += [f"{key} {why}" for key, why in not_used(verdict.provenance).items()]
            for record in verdict.own:
                records.setdefault(verdict.actuator, []).append((Path(path).name, record))
    motors = {}
    for actuator, several in records.items():
        found = identified([record for _, record in several])
        if found is not None:
            motors[actuator] = _motor(found, several)
    if not motors and refused:
        problem = f"no log shows an actuator's motor: {', '.join(dict.fromkeys(refused))}"
        raise MavhumsError(
            problem, f"{_TO_IDENTIFY}, as sampled and not as a register that is seldom refreshed"
        )
    if not motors:
        raise MavhumsError("no log shows an actuator's motor: V4, V5 and V7 together", _TO_IDENTIFY)
    return motors


def _motor(found: Identified, several: Sequence[tuple[str, OwnRecord]]) -> MotorIdentification:
    logs = dict.fromkeys(name for name, record in several if record.equation == VOLTAGE)
    return MotorIdentification(found, tuple(logs))


def with_motors(profile: str, motors: Mapping[str, MotorIdentification]) -> str:
    """Return a profile's text with the identified motors; all other text is unchanged.

    Examples
    --------
    >>> one = Interval(estimate=1.0, low=0.9, high=1.1)
    >>> motor = MotorIdentification(Identified(one, one, one, 1), ("a.tlog",))
    >>> print(with_motors('[[actuators]]\\nname = "rudder"\\n', {"rudder": motor}), end="")
    [[actuators]]
    name = "rudder"
    <BLANKLINE>
    [actuators.identified]  # estimate and 95 % interval, by the voltage equation
    resistance = [1.0, 0.9, 1.1]  # ohm
    back_emf = [1.0, 0.9, 1.1]  # V·s/rad of the rotor
    drop = [1.0, 0.9, 1.1]  # V
    convention = "unknown"  # "dc" where V4·V5 is the electrical power: then back_emf is the torque constant
    flights = ["a.tlog"]
    <BLANKLINE>
    """

    def filled(block: re.Match[str]) -> str:
        named = _OWN_NAME.search(block[0])
        motor = motors.get(_plain(named[1])) if named else None
        if motor is None:
            return block[0]
        return f"{_BEFORE.sub('', block[0]).rstrip()}\n\n{_section(motor)}\n"

    return _BLOCK.sub(filled, profile)


def servo_type_section(name: str, motors: Mapping[str, MotorIdentification], airframe: Airframe) -> str:
    """Return the section of a servo type (TOML) of which all identified motors are examples.

    Its uncertainty covers their intervals and how they differ. Gear ratio, inertia and voltage are those of
    the profile, if it has them.

    Examples
    --------
    >>> from mavhums.actuator.profile import load_airframe
    >>> one = Interval(estimate=1.0, low=0.9, high=1.1)
    >>> motor = MotorIdentification(Identified(one, one, one, 1), ("a.tlog",))
    >>> print(servo_type_section("mine", {"rudder": motor}, load_airframe("paper")), end="")
    [servo_types.mine]
    source = ["identified from a.tlog"]
    voltage = 27.0
    [servo_types.mine.ema]
    torque_constant = 1  # from the back-EMF, where V4·V5 is the electrical power
    resistance = 1
    torque_uncertainty = 0.1
    gear_ratio = 300.0
    inertia = 2.4e-07
    """
    found = [motor.found for motor in motors.values()]
    emf = np.array([_numbers(motor.back_emf) for motor in found])
    constant = float(emf[:, 0].mean())
    logs = ", ".join(dict.fromkeys(log for motor in motors.values() for log in motor.flights))
    actuator = next(actuator for actuator in airframe.actuators if actuator.name in motors)
    known = {key: getattr(actuator.ema, key, None) for key in ("gear_ratio", "inertia")}
    voltage = actuator.ema and actuator.ema.supply_voltage
    lines = [
        f"[servo_types.{name}]",
        f"source = {json.dumps(['identified from ' + logs], ensure_ascii=False)}",
        *([] if voltage is None else [f"voltage = {voltage}"]),
        f"[servo_types.{name}.ema]",
        f"torque_constant = {constant:.4g}  # from the back-EMF, where V4·V5 is the electrical power",
        f"resistance = {np.mean([motor.resistance.estimate for motor in found]):.4g}",
        f"torque_uncertainty = {np.abs(emf / constant - 1.0).max():.2g}",
        *(f"# {key} =  # FILL IN" if value is None else f"{key} = {value}" for key, value in known.items()),
    ]
    return "\n".join(lines) + "\n"


def _plain(quoted: str) -> str:
    return quoted[1:-1] if quoted.startswith("'") else str(json.loads(quoted))


def _section(motor: MotorIdentification) -> str:
    found = motor.found
    return (
        "[actuators.identified]  # estimate and 95 % interval, by the voltage equation\n"
        f"resistance = {_numbers(found.resistance)}  # ohm\n"
        f"back_emf = {_numbers(found.back_emf)}  # V·s/rad of the rotor\n"
        f"drop = {_numbers(found.drop)}  # V\n"
        'convention = "unknown"  # "dc" where V4·V5 is the electrical power: '
        "then back_emf is the torque constant\n"
        f"flights = {json.dumps(motor.flights, ensure_ascii=False)}\n"
    )


def _numbers(interval: Interval) -> list[float]:
    return [interval.estimate, interval.low, interval.high]
