"""The use of a vehicle's servos, with the names and ranges from a profile or from the log's parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from mavhums.actuator.contradictions import contradictions
from mavhums.actuator.profile import Airframe
from mavhums.engine.vehicle_axes import VehicleAxes
from mavhums.results.reasons import Reason
from mavhums.results.sections import OutputUsage, VehicleUsage
from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.parameters import Parameters, control_surfaces
from mavhums.vehicle.rotors import Rotors
from mavhums.vehicle.surfaces import STEERING, Surfaces
from mavhums.vehicle.usage import OutputUse

_SATURATED_S: Final = 1.0
"""At full output in sum: shorter is a gust or a hard stop, as any flight has them."""


class _OutputFacts(NamedTuple):
    """The known facts about an output: its name, the source of the name, and its calibrated range."""

    name: str | None = None
    by: str | None = None
    range_us: tuple[int, int, int] | None = None
    bearing_deg: float | None = None


def vehicle_usage(
    identity: Identity, axes: VehicleAxes, parameters: Parameters, airframe: Airframe | None
) -> VehicleUsage:
    """Return the use of one vehicle.

    Parameters
    ----------
    identity
        Identity of the vehicle.
    axes
        The axes that followed its flight.
    parameters
        The parameters in the log.
    airframe
        The vehicle's profile, which takes precedence over the parameters where these do not contradict it;
        None without one.
    """
    known = {
        **dict(_facts_by_servo(parameters, airframe, axes.surfaces)),
        **dict(_motors(axes.motors.rotors)),
    }
    used, none = axes.usage.outputs, _OutputFacts()
    armed_s = axes.usage.armed_s
    return VehicleUsage(
        vehicle=identity.vehicle,
        kind=identity.kind,
        firmware=identity.software,
        armed_s=None if armed_s is None else round(armed_s, 3),
        forward_s=axes.flight.flown_s,
        outputs=tuple(
            _output(servo, used.get(servo), known.get(servo, none)) for servo in sorted(used | known)
        ),
    )


def _facts_by_servo(
    parameters: Parameters, airframe: Airframe | None, surfaces: Surfaces | None
) -> Iterator[tuple[int, _OutputFacts]]:
    """Yield the known facts by servo; later ones take precedence."""
    if surfaces is not None and surfaces.origin == "inferred":
        yield from ((moved.servo, _OutputFacts(surfaces.what(moved), "inferred")) for moved in surfaces.moved)
    if surfaces is not None and surfaces.axes == (STEERING,):
        yield from (
            (one.servo, _OutputFacts(STEERING, surfaces.origin, one.range_us)) for one in surfaces.moved
        )
    for output in control_surfaces(parameters):
        if output.servo <= OUTPUTS:
            yield output.servo, _OutputFacts(output.surface, "parameters", output.pwm_us)
    wrong = {
        one.servo
        for one in (contradictions(airframe, parameters) if airframe else ())
        if one.key != "travel_deg"
    }
    for actuator in airframe.actuators if airframe else ():
        if actuator.servo <= OUTPUTS and actuator.servo not in wrong:
            low, zero, high = (round(pulse) for pulse in actuator.pwm_us)
            yield actuator.servo, _OutputFacts(actuator.name, "profile", (low, zero, high))


def _motors(rotors: Rotors | Reason | None) -> Iterator[tuple[int, _OutputFacts]]:
    """Yield what is known of the outputs of a multirotor's motors."""
    if isinstance(rotors, Rotors) and not rotors.lift:
        idle, full = round(rotors.idle), round(rotors.full)
        for number, (servo, bearing) in enumerate(zip(rotors.servos, rotors.bearings_deg, strict=True), 1):
            if servo <= OUTPUTS:
                yield servo, _OutputFacts(f"motor {number}", "parameters", (idle, idle, full), bearing)


def _output(servo: int, use: OutputUse | None, known: _OutputFacts) -> OutputUsage:
    range_us, at_low_s, at_high_s = known.range_us, None, None
    span_us = range_us[2] - range_us[0] if range_us else None
    if use and range_us:
        at_low_s, at_high_s = (round(time_s, 3) for time_s in use.at_stops_s(range_us[0], range_us[2]))
    mean_us = use.mean_us if use else None
    return OutputUsage(
        servo=servo,
        name=known.name,
        named_by=known.by,
        commanded=use is not None and use.commanded,
        range_us=range_us,
        least_us=use.least_us if use else None,
        greatest_us=use.greatest_us if use else None,
        span=round((use.greatest_us - use.least_us) / span_us, 4) if use and span_us else None,
        travelled_us=use.travelled_us if use else 0,
        travelled=round(use.travelled_us / span_us, 3) if use and span_us else None,
        reversals=use.reversals if use else 0,
        held_s=round(use.held_s, 3) if use else 0.0,
        at_low_s=at_low_s,
        at_high_s=at_high_s,
        mean_us=None if mean_us is None else round(mean_us, 1),
        bearing_deg=known.bearing_deg,
    )


def at_full_output(followed: VehicleAxes) -> Iterator[str]:
    """Yield one sentence on the motors that were asked for all they have, as in a climb or in a gust."""
    rotors, outputs = followed.motors.rotors, followed.usage.outputs
    if not isinstance(rotors, Rotors) or rotors.lift:
        return
    full = {
        f"motor {number}": outputs[servo].at_stops_s(round(rotors.idle), round(rotors.full))[1]
        for number, servo in enumerate(rotors.servos, 1)
        if servo in outputs
    }
    short = {name: time_s for name, time_s in full.items() if time_s >= _SATURATED_S}
    if short:
        times = ", ".join(f"{name} for {time_s:.0f} s" for name, time_s in short.items())
        yield f"at full output in all: {times}"
