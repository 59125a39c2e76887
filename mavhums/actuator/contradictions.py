"""Where an airframe profile contradicts the log's own parameters, and which outputs then count.

A profile for another aircraft mixes outputs that do not belong together, and the aircraft then seems not to
answer them. So each axis takes its outputs from the profile only while the log's parameters do not contradict
them, and else from these parameters: they are what the autopilot itself acts on. An actuator whose function
is contradicted is not judged at all, since the telemetry is that of another one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from mavhums.actuator.profile import Actuator, Airframe
from mavhums.results.reasons import Reason
from mavhums.vehicle.facts import ALL_OUTPUTS
from mavhums.vehicle.parameters import Output, Parameters, assigned_outputs
from mavhums.vehicle.surfaces import AXES, KINDS, SurfaceOutput, Surfaces, of_parameters
from mavhums.vehicle.vtol import NO_LIFT

_OTHERS: Final = ("spoiler", "flap", "airbrake")  # named by autopilots, of no axis

_ALIKE: Final = {
    "aileron": ("aileron", "flaperon", "spoiler", "split elevon"),
    "flaperon": ("flaperon", "aileron"),
    "elevon": ("elevon", "spoiler"),
    "elevator": ("elevator",),
    "rudder": ("rudder",),
    "tail": ("tail",),
    "spoiler": ("spoiler", "airbrake", "split elevon"),
    "flap": ("flap", "spoiler", "split elevon"),
    "airbrake": ("airbrake", "spoiler", "split elevon"),
}
"""The functions in a log that a profile's surface may have: both move the same axes, or the function moves
none for certain, as a spoiler's."""


class Contradiction(NamedTuple):
    """One statement of a profile that the log's parameters contradict.

    Attributes
    ----------
    servo, actuator
        The output and its name in the profile.
    key
        The line of the profile: ``servo``, ``pwm_us`` or ``travel_deg``.
    text
        Both values, as a clause.
    """

    servo: int
    actuator: str
    key: str
    text: str


def named_surface(actuator: Actuator) -> str | None:
    """Return the kind of surface that a profile names for an actuator; None if it names none.

    Examples
    --------
    >>> named_surface(Actuator(name="ruddervator_left", servo=2, pwm_us=(1000, 1500, 2000)))
    'tail'
    """
    text = f"{actuator.surface} {actuator.name}".lower().replace("_", " ").replace("ruddervator", "tail")
    return next((kind for kind in (*KINDS, *_OTHERS) if kind in text), None)


def of_airframe(airframe: Airframe) -> Surfaces | None:
    """Return the surfaces that a profile names; None if it names none that moves an axis."""
    found = []
    for actuator in airframe.actuators:
        kind = named_surface(actuator)
        if kind not in KINDS or actuator.servo > ALL_OUTPUTS:
            continue
        text = f"{actuator.surface} {actuator.name}".lower()
        side = next((side for side in ("left", "right") if side in text), "")
        low, zero, high = actuator.pwm_us
        turned = actuator.travel_deg is not None and actuator.travel_deg[0] > actuator.travel_deg[1]
        half = (low - high) / 2 if turned else (high - low) / 2
        found.append(SurfaceOutput(actuator.servo, f"{side} {kind}".strip(), zero, half))
    return Surfaces(tuple(found), "profile") if found else None


def contradictions(airframe: Airframe, parameters: Parameters) -> tuple[Contradiction, ...]:
    """Return where the log's parameters contradict a profile, in the order of the profile.

    Examples
    --------
    >>> from mavhums.actuator.profile import load_airframe
    >>> throttle = Parameters(1, False, {"SERVO3_FUNCTION": 70.0})
    >>> contradictions(load_airframe("paper"), throttle)[0].text
    'servo 3 is elevator in the profile and throttle in the log (SERVO3_FUNCTION = 70)'
    """
    logged = {output.servo: output for output in assigned_outputs(parameters)}
    reversed_ = dict(_reversed(airframe, parameters, logged))
    found = []
    for actuator in airframe.actuators:
        output = logged.get(actuator.servo)
        if output is None:
            continue
        kind = named_surface(actuator)
        if kind is not None and not _agrees(kind, output):
            text = (
                f"servo {actuator.servo} is {_named(actuator)} in the profile and {output.surface} in the log"
            )
            text += f" ({output.because})"
            found.append(Contradiction(actuator.servo, actuator.name, "servo", text))
        elif output.is_surface and _exceeds(actuator, output):
            found.append(_of_range(actuator, output))
        elif actuator.servo in reversed_:
            found.append(reversed_[actuator.servo])
    return tuple(found)


def against_log(found: Sequence[Contradiction]) -> Reason:
    """Return contradictions as the reason of a verdict."""
    names = {"servo": "servo or surface"}
    lines = dict.fromkeys(f"{names.get(one.key, one.key)} of {one.actuator}" for one in found)
    statements = "; ".join(one.text for one in found)
    return Reason("contradicts", statements=statements, lines=", ".join(lines))


def reconciled(airframe: Airframe, parameters: Parameters | None) -> Surfaces | None:
    """Return the outputs of each axis: the profile's, where the log's parameters do not contradict them.

    An axis whose outputs are contradicted, or not named by the profile, has those of the parameters. None
    if neither names any.
    """
    own = of_airframe(airframe)
    by_parameters = None if parameters is None else of_parameters(parameters)
    if own is None or parameters is None:
        return own or by_parameters
    found = contradictions(airframe, parameters)
    logged = {moved.servo: moved for moved in by_parameters.moved} if by_parameters else {}
    unturned = {actuator.servo for actuator in airframe.actuators if actuator.travel_deg is None}
    moved: dict[int, SurfaceOutput] = {}
    by_log, contradicted, confirmed = set(), {}, set()
    for axis in AXES:
        outputs = own.of_axis(axis)
        servos = {one.servo for one in outputs}
        against = [one for one in found if one.servo in servos]
        if against:
            contradicted[axis] = against_log(against).text
        if against or not outputs:
            outputs = by_parameters.of_axis(axis) if by_parameters else ()
            by_log |= {axis} if outputs else set()
        elif servos <= logged.keys():
            confirmed.add(axis)
            outputs = _directed(outputs, unturned, logged)
        moved |= {one.servo: one for one in outputs}
    lift = by_parameters.lift if by_parameters else NO_LIFT
    return Surfaces(
        tuple(moved.values()), "profile", lift, frozenset(by_log), contradicted, frozenset(confirmed)
    )


def _agrees(kind: str, output: Output) -> bool:
    if not output.is_surface:
        return False
    names = [name for name in _ALIKE if name in output.surface]  # none in PX4's custom surfaces
    return not names or any(name in output.surface for name in _ALIKE[kind])


def _exceeds(actuator: Actuator, output: Output) -> bool:
    """Return whether the log lets the output leave the range that the profile calibrates.

    A narrower range is no contradiction: a profile may calibrate more than the autopilot uses.
    """
    least, most = actuator.range_us
    return bool(output.ends_by) and (output.pwm_us[0] < least or output.pwm_us[2] > most)


def _of_range(actuator: Actuator, output: Output) -> Contradiction:
    (low, _, high), (least, _, most) = actuator.pwm_us, output.pwm_us
    text = (
        f"servo {actuator.servo} ({_named(actuator)}) has {low} to {high} µs in the profile and "
        f"{least} to {most} µs in the log ({output.ends_by})"
    )
    return Contradiction(actuator.servo, actuator.name, "pwm_us", text)


def _reversed(
    airframe: Airframe, parameters: Parameters, assigned: dict[int, Output]
) -> Iterator[tuple[int, Contradiction]]:
    """Yield the outputs whose direction beside the first of their axis is another one in the log.

    The direction of the whole axis does not count: a profile may call either way positive.
    """
    own, logged = of_airframe(airframe), of_parameters(parameters)
    if own is None or logged is None:
        return
    sides = {moved.servo: moved for moved in logged.moved}
    actuators = {actuator.servo: actuator for actuator in airframe.actuators if actuator.travel_deg}
    for axis in AXES:
        known = [one for one in own.of_axis(axis) if one.servo in sides and one.servo in actuators]
        for one in known[1:]:
            first = known[0]
            alike = first.half_us * one.half_us > 0
            if alike == (sides[first.servo].half_us * sides[one.servo].half_us > 0):
                continue
            ways = ("the same way", "opposite ways")[:: 1 if alike else -1]
            by = "; ".join(assigned[servo].direction_by for servo in (first.servo, one.servo))
            text = (
                f"servos {first.servo} and {one.servo} ({_named(actuators[one.servo])}) deflect {ways[0]} in "
                f"the profile and {ways[1]} in the log ({by})"
            )
            yield one.servo, Contradiction(one.servo, actuators[one.servo].name, "travel_deg", text)


def _directed(
    outputs: tuple[SurfaceOutput, ...], unturned: set[int], logged: dict[int, SurfaceOutput]
) -> tuple[SurfaceOutput, ...]:
    """Return the outputs with the log's directions beside the first, where the profile has no ``travel_deg``.

    The first keeps its direction, so that the axis has one sign with and without parameters.
    """
    first = outputs[0]

    def directed(one: SurfaceOutput) -> SurfaceOutput:
        alike = logged[first.servo].half_us * logged[one.servo].half_us > 0
        if one.servo not in unturned or alike == (first.half_us * one.half_us > 0):
            return one
        return one._replace(half_us=-one.half_us)

    return (first, *map(directed, outputs[1:]))


def _named(actuator: Actuator) -> str:
    return actuator.surface or actuator.name
