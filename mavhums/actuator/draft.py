"""The profile that a log gives: the one that it names itself, else a draft from its parameters.

A log names a profile in a text ``mavhums airframe=NAME``. A draft is a text, or serves a vehicle that names
none.

The user fills in what logs do not contain. A draft suffices for telemetry that names its servo: the servo's
own record, V1–V12, and named values with a servo's number, whose meaning is a guess. An ESC may drive a
propeller: only a profile of the user's says which one drives a servo.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from mavhums.actuator.profile import Airframe, packaged_airframes, packaged_text
from mavhums.core.errors import MavhumsError
from mavhums.log import Decoder, Table, decode_blocks
from mavhums.vehicle.formats import messages_of, reports
from mavhums.vehicle.parameters import (
    Output,
    Parameters,
    control_surfaces,
    read_parameters,
)
from mavhums.vehicle.states import texts

_TEXT: Final = re.compile(r"mavhums airframe=([A-Za-z0-9_.-]{1,40})")


class Announcement(NamedTuple):
    """A text ``mavhums airframe=NAME``.

    Attributes
    ----------
    frame
        Position of the message in the log.
    name
        The profile; a log may only name one that ships with mavhums, never a file.
    known
        Whether there is such a profile.
    """

    frame: int
    time_us: int
    vehicle: int
    name: str
    known: bool


def announcements(tables: Mapping[str, Table]) -> Iterator[Announcement]:
    """Yield the profile names in the log, in the order of the log."""
    known: list[str] | None = None
    for said in texts(tables):
        match = _TEXT.fullmatch(said.text.strip())
        if match:
            known = packaged_airframes() if known is None else known
            yield Announcement(said.frame, said.time_us, said.vehicle, match[1], match[1] in known)


DRAFTED: Final = "drafted"
"""Name of a profile that nobody has named: the same for every flight, so that these can be compared."""

_MOST_NAMES: Final = 1000  # of a log: a sender that makes up names cannot fill the memory
_FEW: Final = 4  # names in a notice: more are no more readable

_SERVO_VALUE: Final = re.compile(r"S(\d{1,2})(Cmd|Pos|V|A|Spd|RPM)")

_HEAD = """\
# DRAFT of an airframe profile, from the parameters of vehicle {vehicle} in {log}.
#
# A log does not record what an actuator is made of. Until you fill in what is marked FILL IN, an actuator
# that reports something is compared with its own earlier flights alone. Remove the # of a line that you
# fill in. What is marked GUESS follows from a name in the log: check it.
name = {name}
"""
_NAMED = """\
# {log} names the profile {profile}. This is that profile, with its constants and limits: change what
# differs on your aircraft.
"""
_NAME: Final = re.compile("^name = .*$", re.MULTILINE)
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

    Where the log itself names a packaged profile, that one is returned: a draft has neither its constants nor
    its limits.

    Parameters
    ----------
    path
        A log with the parameters.
    vehicle
        System id; may be None where only one vehicle's parameters are in the log.
    name
        Name of the airframe; if None, that of the profile in the log, else the name of the log's file.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a log.
    MavhumsError
        If the log holds no parameters, or these name no control surface.
    """
    path = Path(path)
    parameters = read_parameters(path, vehicle=vehicle, progress=progress)
    outputs = control_surfaces(parameters)
    if not outputs:
        by_hand = "if a servo moves a surface after all, write its profile by hand: see docs/guide/profile.md"
        raise MavhumsError(f"{path}: {_no_surface(parameters)}", by_hand)
    named: set[str] = set()
    for tables, _, _ in decode_blocks(path, Decoder(messages_of("script value", "text"))):
        for said in announcements(tables):
            if said.known and said.vehicle == parameters.vehicle:
                own = _NAMED.format(profile=said.name, log=_plain(path.name)) + packaged_text(said.name)
                return own if name is None else _NAME.sub(lambda _: f"name = {_text(name)}", own, count=1)
        for report in reports(tables, "script value"):
            if len(named) < _MOST_NAMES:
                named.update(report.select(report.table.system == parameters.vehicle).texts)
    head = _HEAD.format(vehicle=parameters.vehicle, log=_plain(path.name), name=_text(name or path.stem))
    return head + _sections(outputs, named)


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


def _field(guess: QuantityGuess) -> str:
    """Write a mapping of a quantity to a named value."""
    scale = "" if guess.scale == 1.0 else f", scale = {guess.scale!r}"
    [message] = messages_of("script value")
    mapping = f'message = "{message}", where = {{ name = {_text(guess.name)} }}, field = "value"'
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


class QuantityGuess(NamedTuple):
    """A quantity that a named value seems to be: value · ``scale`` in the quantity's unit."""

    key: str
    name: str
    scale: float
    taken_for: str


_MEANINGS: Final[dict[str, tuple[str, float, str]]] = {
    "Cmd": ("V1", 1.0, "commanded angle, degrees"),
    "Pos": ("V3", 1.0, "angle, degrees"),
    "V": ("V4", 1.0, "voltage, V"),
    "A": ("V5", 1.0, "current, A"),
    "RPM": ("V7", 1.0, "rotor speed, rev/min"),
    "Spd": ("V10", 1.0 / 6.0, "output speed, degrees per second"),
}


def guesses_for(servo: int, names: Collection[str]) -> Iterator[QuantityGuess]:
    """Yield the quantities of a servo output among named values, in the order of V1–V12.

    Examples
    --------
    >>> [(guess.key, guess.name) for guess in guesses_for(1, ["S1Pos", "S1Cmd", "S11Pos", "S1MT"])]
    [('V1', 'S1Cmd'), ('V3', 'S1Pos')]
    """
    parts = {name: match for name in names if (match := _SERVO_VALUE.fullmatch(name))}
    own = {match[2]: name for name, match in parts.items() if int(match[1]) == servo}
    for suffix, (key, scale, taken_for) in _MEANINGS.items():
        if suffix in own:
            yield QuantityGuess(key, own[suffix], scale, taken_for)


def is_guessed(name: str) -> bool:
    """Return whether a named value seems to be a quantity of a servo."""
    return _SERVO_VALUE.fullmatch(name) is not None


class Draft(NamedTuple):
    """A drafted profile, from a place in the log on, and the named values whose meaning it guesses."""

    vehicle: int
    frame: int
    time_us: int
    airframe: Airframe
    guesses: tuple[str, ...]

    @property
    def notice(self) -> str:
        """What the user must know of verdicts by this profile."""
        names, more = ", ".join(self.guesses[:_FEW]), len(self.guesses) - _FEW
        names += f" and {more} more" if more > 0 else ""
        guessed = f"; what {names} mean is guessed from these names" if names else ""
        return (
            "no profile was named: one is drafted from the log's parameters, without constants and limits"
            f"{guessed}; check it with `mavhums profile new LOG -o mine.toml`, then name it with --airframe"
        )


def drafted_airframe(parameters: Parameters, named: Collection[str]) -> Airframe:
    """Return the profile of the control surfaces that parameters name; ``named`` are names of values."""
    text = f'name = "{DRAFTED}"\n{_sections(control_surfaces(parameters), named)}'
    return Airframe.model_validate(tomllib.loads(text))
