"""The demand of outputs that move together, named or inferred."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import (
    AXES,
    STEERING,
    Demands,
    SurfaceOutput,
    Surfaces,
    of_parameters,
)
from mavhums.vehicle.vtol import lift_of
from tests.health.axis.flights import Array
from tests.present import present


def pulses(**outputs: Array) -> Array:
    """Pulses of the outputs ``s1``, ``s2`` …; the others are off."""
    some = next(iter(outputs.values()))
    found = np.full((len(some), OUTPUTS), np.nan)
    for name, values in outputs.items():
        found[:, int(name[1:]) - 1] = values
    return found


def ailerons(*servos: int) -> Surfaces:
    return Surfaces(tuple(SurfaceOutput(servo, "aileron", 1500.0, 400.0) for servo in servos), "profile")


def test_a_demand_is_the_same_whatever_its_surfaces_are_called() -> None:
    names = (("left aileron", 1), ("aileron 1", 1), ("left elevon", 1), ("right elevon", 1), ("aileron", 2))
    moved = (Surfaces((SurfaceOutput(n, name, 1500.0, 400.0),), "profile").demands for name, n in names)
    left, plain, left_elevon, right_elevon, other = moved
    assert left == plain != other
    assert left_elevon != right_elevon, "they mix two axes"


@pytest.mark.parametrize("off", [(), (1,), (1, 2)])
def test_outputs_that_are_off_do_not_count(off: tuple[int, ...]) -> None:
    moving = 1500 + 100 * np.sin(np.arange(400) / 10)
    sent = pulses(**{f"s{n}": moving * (np.nan if n in off else 1.0) for n in (1, 2)})
    demand = Demands(ailerons(1, 2)).feed(sent)[:, 0]
    np.testing.assert_allclose(demand, (moving - 1500) / 400 if len(off) < 2 else moving * np.nan)


def test_a_profile_whose_outputs_are_all_contradicted_steers_no_rover() -> None:
    assert Surfaces((), "profile").axes == AXES
    assert Surfaces((SurfaceOutput(1, STEERING, 1500.0, 400.0),), "parameters").axes == (STEERING,)


def mixed(functions: dict[int, float], reversed_: int = 0) -> tuple[Surfaces, Array, Array]:
    """An ArduPlane's surfaces, their pulses as it mixes them, and the aileron and the elevator asked for."""
    values = {f"SERVO{n}_FUNCTION": function for n, function in functions.items()}
    values |= {f"SERVO{n}_REVERSED": float(n == reversed_) for n in functions}
    surfaces = present(of_parameters(Parameters(1, False, values)))
    t = np.arange(400) / 20
    aileron, elevator, rudder = asked = np.array([0.2, 0.15, 0.1])[:, None] * np.sin(
        np.outer([2, 3, 5], t) + 1
    )
    flap = np.where(t > 10, 0.3, 0.0)
    left, right = elevator - aileron, elevator + aileron
    split = np.maximum(-rudder, 0.0), np.maximum(rudder, 0.0)
    shares = {
        **{4: aileron, 19: elevator, 21: rudder, 77: left, 78: right, 24: aileron + flap, 25: aileron - flap},
        **{79: elevator - rudder, 80: elevator + rudder, 16: left + split[0], 86: left - split[0]},
        **{17: right + split[1], 87: right - split[1]},
    }
    half_us = {n: -400 if n == reversed_ else 400 for n in functions}
    moved = {n: shares[int(one)] for n, one in functions.items() if one in shares}
    return surfaces, pulses(**{f"s{n}": 1500 + half_us[n] * share for n, share in moved.items()}), asked.T


@pytest.mark.parametrize(
    "functions",
    [
        {1: 77, 2: 78},
        {1: 16, 2: 86, 3: 17, 4: 87},
        {1: 24, 2: 19, 4: 21, 5: 25},
        {1: 4, 2: 79, 3: 80, 6: 4},
        # A quadplane's and a tiltrotor's surfaces are those of its wing, whatever lifts it.
        {1: 4, 2: 19, 4: 21, 5: 33, 6: 34, 7: 35, 8: 36},
        {1: 77, 2: 78, 5: 33, 6: 34, 7: 75, 8: 76},
    ],
)
@pytest.mark.parametrize("reversed_", [0, 1])
def test_each_function_moves_its_axes_by_what_was_asked(functions: dict[int, float], reversed_: int) -> None:
    surfaces, sent, asked = mixed(functions, reversed_)
    demand = Demands(surfaces).feed(sent)
    # Left less right: elevons turn right by a demand to the left, which the sign of the gain takes up.
    first = [next(iter(surfaces.of_axis(axis)), None) for axis in AXES]
    sign = [np.nan if one is None else {"elevon": -1.0, "tail": -1.0}.get(one.kind, 1.0) for one in first]
    sign[1] = 1.0
    np.testing.assert_allclose(demand, sign * asked, atol=1e-9)
    assert surfaces.lift.servos == {n for n, function in functions.items() if 33 <= function <= 36}


def test_what_steers_a_rover_by_its_parameters() -> None:
    """ArduPilot: ground steering, with CRUISE_THROTTLE. PX4: the first servo of an Ackermann frame."""
    rover = {"CRUISE_THROTTLE": 50.0, "SERVO3_FUNCTION": 26.0, "SERVO4_FUNCTION": 4.0}
    frame = {"CA_AIRFRAME": 5.0, "PWM_MAIN_FUNC2": 201.0, "PWM_MAIN_FUNC3": 202.0}
    for values, px4, moved in (
        (rover, False, SurfaceOutput(3, STEERING, 1500, 400.0)),
        (rover | {"SERVO3_REVERSED": 1.0}, False, SurfaceOutput(3, STEERING, 1500, -400.0)),
        (
            {"CRUISE_THROTTLE": 50.0, "SERVO32_FUNCTION": 26.0},
            False,
            SurfaceOutput(32, STEERING, 1500, 400.0),
        ),
        (frame, True, SurfaceOutput(2, STEERING, 1500, 500.0)),
        (frame | {"PWM_MAIN_REV": 2.0}, True, SurfaceOutput(2, STEERING, 1500, -500.0)),
    ):
        assert of_parameters(Parameters(1, px4, values)) == Surfaces((moved,), "parameters")
    for values, px4 in (
        ({name: value for name, value in rover.items() if name != "CRUISE_THROTTLE"}, False),
        (frame | {"CA_AIRFRAME": 6.0}, True),
        ({"CA_AIRFRAME": 5.0, "UAVCAN_SV_FUNC1": 201.0}, True),  # output 33 is not a pulse
        ({"CRUISE_THROTTLE": 50.0, "SERVO1_FUNCTION": 70.0, "SERVO2_FUNCTION": 29.0}, False),
    ):
        found = of_parameters(Parameters(1, px4, values))
        assert found is None or found.axes == AXES


def test_an_axis_has_a_short_name_for_alerts() -> None:
    plain = SurfaceOutput(1, "aileron", 1500, 400), SurfaceOutput(12, "aileron", 1500, -400)
    for moved, origin, brief in (
        (plain, "profile", "aileron 1/12"),
        (plain[:1], "profile", "aileron"),
        (plain, "inferred", "servo 1/12"),
    ):
        assert (Surfaces(moved, origin).brief("roll"), Surfaces(moved, origin).brief("pitch")) == (brief, "")
    assert plain[0].range_us == plain[1].range_us == (1100, 1500, 1900)


def test_outputs_are_the_same_where_they_move_the_same_the_same_way() -> None:
    one = SurfaceOutput(1, "aileron", 1500, 400)
    lifts = {n: lift_of({f"SERVO{k}_FUNCTION": 33.0 for k in range(5, 5 + n)}) for n in (0, 1, 2)}
    known = Surfaces((one,), "parameters", lifts[1])
    for other, lift, same in (
        (one, 1, True),
        (one._replace(zero_us=1400, half_us=300), 1, True),
        (one._replace(half_us=-400), 1, False),
        (one._replace(servo=2), 1, False),
        (one._replace(surface="elevator"), 1, False),
        (one, 0, False),
        (one, 2, False),
    ):
        assert known.same_outputs(Surfaces((other,), "profile", lifts[lift])) == same
