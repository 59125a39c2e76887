"""Draft of an airframe profile from a log's parameters; the user fills in what logs do not contain."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Final

from mavhums.actuator.named_guess import Guess, guesses_for, named_values
from mavhums.actuator.profile import Airframe
from mavhums.core.errors import MavhumsError
from mavhums.vehicle.outputs import Output, control_surfaces
from mavhums.vehicle.parameters import Parameters, read_parameters

__all__ = ["DRAFTED", "draft_profile", "drafted_airframe"]

DRAFTED: Final = "drafted"
"""Name of a profile that nobody has named: the same for every flight, so that these can be compared."""

_HEAD = """\
# DRAFT of an airframe profile, from the parameters of vehicle {vehicle} in {log}.
#
# A log cannot tell what an actuator is made of. Until you fill in what is marked FILL IN, an actuator
# that reports something is held against its own earlier flights alone. Remove the # of a line that you
# fill in. What is marked GUESS follows from a name in the log: check it.
name = {name}
"""
_ACTUATOR = """
[[actuators]]
name = {name}
surface = {surface}
servo = {servo}  # {because}
pwm_us = {pwm_us}  # {calibrated_by}{reversal}
# travel_deg =    # FILL IN: [deflection at the smallest pulse, at the largest], degrees
# esc =           # the ESC (from 0) that drives this actuator's motor, not the propeller's, if any
# esc_side =      # "motor" or "bus": where that ESC measures
{fields}
# [actuators.ema]     # FILL IN, from the data sheet
# gear_ratio =        # rotor turns per output shaft turn
# torque_constant =   # N·m/A
# resistance =        # of the winding, ohm
# inertia =           # of rotor and gear, referred to the rotor, kg·m²

# [actuators.limits]  # FILL IN, from the actuator's maker: Coulomb friction at the output shaft, N·m
# normal =            # normal up to this
# emergency =         # an emergency from this
"""


def draft_profile(
    path: str | os.PathLike[str],
    *,
    vehicle: int | None = None,
    name: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> str:
    """Return the text of a profile (TOML) for the control surfaces that a log's parameters name.

    Parameters
    ----------
    path
        A ``.tlog`` file in which the parameters were downloaded.
    vehicle
        System id; may be None where only one vehicle's parameters are in the log.
    name
        Name of the airframe; if None, the name of the log's file.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a telemetry log.
    MavhumsError
        If the log holds no parameters, or these name no control surface.
    """
    path = Path(path)
    parameters = read_parameters(path, vehicle=vehicle, progress=progress)
    outputs = control_surfaces(parameters)
    if not outputs:
        by_hand = "if a servo moves a surface after all, write the profile by hand: docs/guide/profile.md tells how"
        raise MavhumsError(f"{path}: {_no_surface(parameters)}", by_hand)
    head = _HEAD.format(vehicle=parameters.vehicle, log=_plain(path.name), name=_text(name or path.stem))
    return head + _sections(outputs, named_values(path, parameters))


def drafted_airframe(parameters: Parameters, named: Collection[str]) -> Airframe | None:
    """Return the unedited draft as a profile; None if the parameters name no control surface.

    Parameters
    ----------
    parameters
        Of one vehicle.
    named
        Names of its named values.
    """
    outputs = control_surfaces(parameters)
    text = f'name = "{DRAFTED}"\n{_sections(outputs, named)}'
    return Airframe.model_validate(tomllib.loads(text)) if outputs else None


def _sections(outputs: Sequence[Output], named: Collection[str]) -> str:
    return "".join(_section(own, one, named) for own, one in zip(_names(outputs), outputs, strict=True))


def _section(name: str, output: Output, named: Collection[str]) -> str:
    return _ACTUATOR.format(
        fields="".join(_field(guess) for guess in guesses_for(output.servo, named)),
        name=_text(name),
        surface=_text(output.surface),
        servo=output.servo,
        because=output.because,
        pwm_us=list(output.pwm_us),
        calibrated_by=output.calibrated_by,
        reversal="; reversed, as the logged pulses are" if output.is_reversed else "",
    )


def _field(guess: Guess) -> str:
    """Write a mapping of a quantity to a named value."""
    scale = "" if guess.scale == 1.0 else f", scale = {guess.scale!r}"
    mapping = f'message = "NAMED_VALUE_FLOAT", where = {{ name = {_text(guess.name)} }}, field = "value"'
    return f"fields.{guess.key} = {{ {mapping}{scale} }}  # GUESS: {guess.taken_for}\n"


def _names(outputs: Sequence[Output]) -> list[str]:
    """Name each actuator by its surface, and by its channel if several move the same surface."""
    plain = [re.sub(r"\W+", "_", output.surface) for output in outputs]
    return [
        f"{name}_{output.servo}" if plain.count(name) > 1 else name
        for name, output in zip(plain, outputs, strict=True)
    ]


def _no_surface(parameters: Parameters) -> str:
    px4 = ("PWM_MAIN_FUNCn", "PWM_AUX_FUNCn", "UAVCAN_SV_FUNCn")
    names = px4 if parameters.is_px4 else ("SERVOn_FUNCTION",)
    assigning = ", ".join(names)
    pattern = "|".join(name.replace("n", r"\d+") for name in names)
    outputs = sum(1 for name in parameters.values if re.fullmatch(pattern, name))
    if not outputs:
        return f"none of its {len(parameters.values)} parameters assigns an output ({assigning})"
    return f"none of the {outputs} outputs that its parameters assign moves a control surface"


def _plain(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)


def _text(text: str) -> str:
    """Write a TOML string."""
    return json.dumps(_plain(text), ensure_ascii=False)
