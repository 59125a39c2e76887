"""What a profile says otherwise than the parameters of either autopilot: functions, ranges, directions."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.actuator.contradictions import contradictions, reconciled
from mavhums.actuator.draft import _names, _section
from mavhums.actuator.profile import Actuator, Airframe, load_airframe
from mavhums.vehicle.parameters import Parameters, control_surfaces
from mavhums_sim.telemetry import parameters as simulated
from tests.present import present

ROOT = Path(__file__).parents[2]
PAPER = load_airframe("paper")


def ardupilot(**values: float) -> Parameters:
    return Parameters(1, False, values)


def px4(**values: float) -> Parameters:
    return Parameters(1, True, values)


def one(surface: str, servo: int = 2, **fields: object) -> Airframe:
    given_fields = {"pwm_us": (1100, 1500, 1900), **fields}
    actuator = Actuator(name="it", surface=surface, servo=servo, **given_fields)  # type: ignore[arg-type]
    return Airframe(name="mine", actuators=(actuator,))


def texts(airframe: Airframe, parameters: Parameters) -> list[str]:
    return [found.text for found in contradictions(airframe, parameters)]


def test_a_function_is_reported_with_both_values() -> None:
    of_px4 = px4(PWM_MAIN_FUNC2=201.0, CA_SV_CS0_TYPE=3.0, PWM_MAIN_FUNC3=101.0)
    for parameters, logged in (
        (ardupilot(SERVO2_FUNCTION=19, SERVO3_FUNCTION=70), ("SERVO2_FUNCTION = 19", "throttle")),
        (of_px4, ("PWM_MAIN_FUNC2 = 201, CA_SV_CS0_TYPE = 3", "motor 1")),
    ):
        aileron, elevator = contradictions(PAPER, parameters)
        assert aileron.text.endswith(f"is right aileron in the profile and elevator in the log ({logged[0]})")
        assert f"servo 3 is elevator in the profile and {logged[1]} in the log" in elevator.text


@pytest.mark.parametrize(
    ("surface", "function", "agrees"),
    [
        ("left aileron", 4, True),
        ("left aileron", 24, True),  # a flaperon rolls
        ("left aileron", 86, True),  # so may a differential spoiler
        ("left aileron", 77, False),
        ("left aileron", 21, False),
        ("left aileron", 33, False),
        ("elevator", 19, True),
        ("elevator", 79, False),
        ("left v-tail", 79, True),
        ("ruddervator", 79, True),
        ("rudder", 79, False),
        ("left flap", 3, True),
        ("left flap", 4, False),
        ("", 19, True),  # the profile does not say what it is
        ("trim tab", 19, True),
        *(("elevator", open_, True) for open_ in (0, 1, 51, 94, 1234)),  # the log does not say what it moves
    ],
)
def test_what_moves_the_same_axis_agrees(surface: str, function: float, agrees: bool) -> None:
    assert (texts(one(surface), ardupilot(SERVO2_FUNCTION=function)) == []) is agrees


def test_surfaces_that_px4_does_not_name_contradict_nothing() -> None:
    for kind in ({"CA_SV_CS0_TYPE": 12.0}, {}):
        assert texts(one("elevator"), px4(PWM_MAIN_FUNC2=201.0, **kind)) == []


@pytest.mark.parametrize(
    ("own_us", "ends", "agrees"),
    [
        ((1100, 1900), {"MIN": 1100, "MAX": 1900}, True),
        ((1100, 1900), {"MIN": 1200, "MAX": 1800}, True),  # a profile may calibrate more than is used
        ((1100, 1900), {"MIN": 1080, "MAX": 1930}, True),  # trimmed ends
        ((1100, 1900), {"MIN": 1000, "MAX": 1900}, False),
        ((1100, 1900), {"MIN": 1100, "MAX": 2000}, False),
        ((1300, 1700), {}, True),  # the usual range is no statement
        ((1300, 1700), {"MIN": 1000}, True),
        ((1300, 1700), {"MIN": 1900, "MAX": 1100}, True),
    ],
)
def test_an_output_that_leaves_the_calibrated_range_contradicts(
    own_us: tuple[int, int], ends: dict[str, int], agrees: bool
) -> None:
    profile = one("elevator", pwm_us=(own_us[0], 1500, own_us[1]))
    found = contradictions(
        profile, ardupilot(SERVO2_FUNCTION=19, **{f"SERVO2_{end}": us for end, us in ends.items()})
    )
    assert [one.key for one in found] == ["pwm_us"] * (not agrees)
    for contradiction in found:
        assert f"1100 to 1900 µs in the profile and {ends['MIN']} to {ends['MAX']} µs" in contradiction.text
        assert "SERVO2_MIN, SERVO2_MAX" in contradiction.text


def test_a_range_in_other_units_contradicts() -> None:
    bus = px4(UAVCAN_SV_FUNC1=201.0, CA_SV_CS0_TYPE=3.0, UAVCAN_SV_MIN1=0.0, UAVCAN_SV_MAX1=1000.0)
    assert [found.key for found in contradictions(one("elevator", 33), bus)] == ["pwm_us"]


def pair(*travels: tuple[float, float] | None) -> Airframe:
    rows = zip(("aileron_left", "aileron_right"), (1, 5), travels, strict=True)
    pwm_us = (1100, 1500, 1900)
    actuators = (Actuator(name=name, servo=n, pwm_us=pwm_us, travel_deg=way) for name, n, way in rows)
    return Airframe(name="pair", actuators=tuple(actuators))


UP, DOWN = (-20.0, 20.0), (20.0, -20.0)


@pytest.mark.parametrize(
    ("left", "right", "reversed_", "agrees"),
    [
        (UP, UP, (0, 0), True),
        (DOWN, DOWN, (0, 0), True),  # a profile may call either way positive
        (UP, UP, (1, 1), True),
        (UP, DOWN, (0, 1), True),
        (UP, UP, (0, 1), False),
        (UP, DOWN, (0, 0), False),
        (UP, None, (0, 1), True),  # the profile does not say which way
    ],
)
def test_only_the_direction_beside_one_another_counts(
    left: tuple[float, float], right: tuple[float, float] | None, reversed_: tuple[int, int], agrees: bool
) -> None:
    values = {"SERVO1_FUNCTION": 4.0, "SERVO5_FUNCTION": 4.0}
    values |= {f"SERVO{n}_REVERSED": float(r) for n, r in zip((1, 5), reversed_, strict=True)}
    found = contradictions(pair(left, right), ardupilot(**values))
    assert (found == ()) is agrees
    if not agrees:
        assert found[0].key == "travel_deg"
        assert "(SERVO1_REVERSED = {}; SERVO5_REVERSED = {})".format(*reversed_) in found[0].text


def test_outputs_without_travel_take_the_logs_directions_beside_the_first() -> None:
    values = ardupilot(SERVO1_FUNCTION=4, SERVO5_FUNCTION=4, SERVO1_REVERSED=1, SERVO5_REVERSED=0)
    surfaces = present(reconciled(pair(None, None), values))
    assert [moved.half_us for moved in surfaces.of_axis("roll")] == [400.0, -400.0]
    assert surfaces.confirmed == {"roll"}


def test_a_contradicted_axis_takes_the_logs_outputs_and_the_others_the_profiles() -> None:
    values = {"SERVO1_FUNCTION": 4, "SERVO2_FUNCTION": 19, "SERVO3_FUNCTION": 70, "SERVO4_FUNCTION": 21}
    surfaces = present(reconciled(PAPER, ardupilot(**values, SERVO9_FUNCTION=4)))
    assert [moved.servo for moved in surfaces.of_axis("roll")] == [1, 9]
    assert [moved.servo for moved in surfaces.of_axis("pitch")] == [2]
    assert [(m.servo, m.half_us) for m in surfaces.of_axis("yaw")] == [(4, 500.0)]
    assert surfaces.by_log == surfaces.contradicted.keys() == {"roll", "pitch"}
    assert surfaces.confirmed == {"yaw"}


def test_a_contradicted_axis_of_which_the_log_records_nothing_has_no_outputs() -> None:
    surfaces = present(reconciled(PAPER, ardupilot(SERVO2_FUNCTION=70)))
    assert surfaces.of_axis("roll") == ()
    assert [moved.servo for moved in surfaces.of_axis("pitch")] == [3]
    assert "throttle" in surfaces.contradicted["roll"]


def test_an_axis_that_the_profile_leaves_out_takes_the_logs_outputs() -> None:
    surfaces = present(reconciled(one("elevator"), ardupilot(SERVO1_FUNCTION=4, SERVO2_FUNCTION=19)))
    assert [moved.servo for moved in surfaces.of_axis("roll")] == [1]
    assert surfaces.by_log == {"roll"}
    assert not surfaces.contradicted


def test_the_simulators_parameters_agree_with_the_papers_profile() -> None:
    assert texts(PAPER, ardupilot(**dict(simulated()))) == []


def test_the_bridges_profile_agrees_with_an_aircraft_wired_like_it() -> None:
    bridge = load_airframe(ROOT / "bridge" / "servo_bridge.toml")
    functions = {"left aileron": 4, "right aileron": 4, "elevator": 19, "rudder": 21}
    wired = {a.servo: {"FUNCTION": functions[a.surface], "MIN": 1100, "MAX": 1900} for a in bridge.actuators}
    values = {f"SERVO{n}_{key}": value for n, one in wired.items() for key, value in one.items()}
    assert texts(bridge, ardupilot(**values)) == []


SURFACES = st.sampled_from([0, 1, 2, 4, 16, 19, 21, 24, 33, 70, 77, 78, 79, 80, 86, 110])
PULSES = st.integers(800, 2200).map(float)


@st.composite
def ardupilots(draw: st.DrawFn) -> Parameters:
    values: dict[str, float] = {}
    kinds = {"MIN": PULSES, "MAX": PULSES, "TRIM": PULSES, "REVERSED": st.sampled_from([0.0, 1.0])}
    for n in range(1, draw(st.integers(1, 8)) + 1):
        values[f"SERVO{n}_FUNCTION"] = float(draw(SURFACES))
        values |= {f"SERVO{n}_{key}": draw(value) for key, value in kinds.items() if draw(st.booleans())}
    return Parameters(1, False, values)


@st.composite
def of_px4(draw: st.DrawFn) -> Parameters:
    values: dict[str, float] = {"PWM_MAIN_REV": float(draw(st.integers(0, 255)))}
    for n in range(1, draw(st.integers(1, 8)) + 1):
        values[f"PWM_MAIN_FUNC{n}"] = float(draw(st.sampled_from([0, 101, 102, 200 + n])))
        values[f"CA_SV_CS{n - 1}_TYPE"] = float(draw(st.integers(0, 18)))
        values[f"PWM_MAIN_MIN{n}"], values[f"PWM_MAIN_MAX{n}"] = draw(PULSES), draw(PULSES)
        values[f"CA_SV_CS{n - 1}_TRQ_R"] = draw(st.sampled_from([-0.5, 0.0, 0.5]))
    return Parameters(1, True, values)


@given(parameters=st.one_of(ardupilots(), of_px4()))
def test_a_profile_drafted_from_a_log_never_contradicts_it(parameters: Parameters) -> None:
    outputs = control_surfaces(parameters)
    if not outputs:
        return
    sections = zip(_names(outputs), outputs, strict=True)
    text = 'name = "drafted"\n' + "".join(_section(name, output, ()) for name, output in sections)
    airframe = Airframe.model_validate(tomllib.loads(text))
    assert contradictions(airframe, parameters) == ()
    surfaces = reconciled(airframe, parameters)
    assert surfaces is None or not surfaces.contradicted
