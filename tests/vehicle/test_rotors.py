"""The motors of a multirotor against the simulator, which has its own tables."""

import numpy as np
import pytest

from mavhums.results.reasons import Reason
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.rotors import _FRAMES, Rotors, rotors_of
from mavhums_sim.multirotor.craft import FRAMES
from mavhums_sim.multirotor.log import FUNCTIONS, PARAMETERS, pulses


def of(values: dict[str, float], *, px4: bool = False) -> Rotors | Reason | None:
    return rotors_of(Parameters(1, px4, values))


def rotors(values: dict[str, float], *, px4: bool = False) -> Rotors:
    found = of(values, px4=px4)
    assert isinstance(found, Rotors)
    return found


def known(frame: str) -> Rotors:
    kind, type_ = FRAMES[frame].parameters
    return rotors({**PARAMETERS, **FUNCTIONS, "FRAME_CLASS": kind, "FRAME_TYPE": type_})


@pytest.mark.parametrize("frame", FRAMES)
def test_columns_are_those_of_the_simulator(frame: str) -> None:
    factors = FRAMES[frame].factors
    assert np.allclose(known(frame).columns, factors / (factors**2).sum(axis=0))


@pytest.mark.parametrize("places", _FRAMES.values())
def test_efforts_of_every_frame_do_not_mix(places: tuple[tuple[float, int], ...]) -> None:
    angles = np.radians([angle for angle, _ in places])
    factors = np.stack([-np.sin(angles), np.cos(angles), [spin for _, spin in places]])
    gram = factors @ factors.T
    assert np.allclose(gram, np.diag(np.diag(gram)), atol=1e-9)
    assert np.allclose(factors.sum(axis=1), 0)


@pytest.mark.parametrize(("type_", "turns"), [(14, 1), (13, -1)])
@pytest.mark.parametrize("size", [1, 2])
def test_clockwise_numbering_and_its_mirror_go_once_round(size: int, type_: int, turns: int) -> None:
    """ArduPilot numbers type 14 clockwise and type 13, as DJI does, against it, from the front on."""
    bearings = np.array([angle for angle, _ in _FRAMES[size, type_]])
    steps = turns * np.diff(bearings, append=bearings[0]) % 360
    assert steps == pytest.approx(360 / len(bearings))
    assert abs(bearings[0]) <= 45
    frame = rotors({**PARAMETERS, **FUNCTIONS, "FRAME_CLASS": float(size), "FRAME_TYPE": float(type_)}).frame
    assert "order" in frame or "clockwise" in frame


def test_betaflights_first_motor_is_the_rear_right_one() -> None:
    quad = rotors({**PARAMETERS, **FUNCTIONS, "FRAME_CLASS": 1.0, "FRAME_TYPE": 12.0})
    assert quad.frame == "quad X (Betaflight order)"
    right_rear, right_front, left_rear, left_front = np.sign(quad.columns).tolist()
    assert (right_rear, right_front) == ([-1, -1, -1], [-1, 1, 1])
    assert (left_rear, left_front) == ([1, -1, 1], [1, 1, -1])


def test_thrusts_invert_the_curve_of_the_parameters() -> None:
    command = np.random.default_rng(1).uniform(0, 1, (50, 4))
    sent = np.full((50, 32), np.nan)
    sent[:, :4] = pulses(command)
    thrusts = known("quad x").thrusts(sent, np.full((50, 4), np.nan))
    assert np.allclose(thrusts, command, atol=2e-3)


def test_an_overridden_output_is_replaced_by_what_the_mixer_asks() -> None:
    hexa = known("hexa x")
    asked = np.array([[0.1, -0.05, 0.02, 0.4]])
    command = asked[:, 3:] + 0.5 * asked[:, :3] @ FRAMES["hexa x"].factors.T
    sent = np.full((1, 32), np.nan)
    sent[:, :6] = pulses(command)
    sent[0, 2] = 1000.0
    assert np.allclose(hexa.thrusts(sent, asked), command, atol=3e-3)
    sent[0, 4] = 1000.0
    assert np.allclose(hexa.thrusts(sent, asked), command, atol=3e-3), "two of six are replaced"
    sent[0, 0] = 1000.0
    assert hexa.thrusts(sent, asked)[0, [0, 2, 4]].tolist() == [0.0] * 3, "three of six are the limit"
    # Without the mixer's commands, the outputs are all that is known.
    assert hexa.thrusts(sent, np.full((1, 4), np.nan))[0, 2] == 0.0


@pytest.mark.parametrize(
    ("frame", "off", "replaced"),
    [
        ("quad x", 1, True),
        ("quad x", 2, False),
        ("hexa x", 2, True),
        ("hexa x", 3, False),
        ("octa x", 2, True),
    ],
)
def test_few_overridden_outputs_are_replaced(frame: str, off: int, replaced: bool) -> None:
    """More than a third of them differ where the mixer is at a limit: then it shows less than they do."""
    count = len(FRAMES[frame].factors)
    sent, asked = np.full((2, 32), np.nan), np.tile([0.0, 0.0, 0.0, 0.5], (2, 1))
    command = np.full((2, count), 0.5)
    command[0, :off] += 0.14  # as far as the sampling moves it
    command[1, :off] += 0.16
    sent[:, :count] = pulses(command)
    found = known(frame).thrusts(sent[:, None], asked[:, None])[:, 0]
    assert np.allclose(found[0], command[0], atol=3e-3)
    assert np.allclose(found[1], 0.5 if replaced else command[1], atol=3e-3)


def test_an_output_that_differs_in_few_rows_is_not_replaced() -> None:
    """An override lasts; a mixer whose records are rarer than the outputs' misses what was asked between."""
    quad, asked = known("quad x"), np.tile([0.0, 0.0, 0.0, 0.3], (20, 1))
    command = np.full((20, 4), 0.3)
    sent = np.full((20, 32), np.nan)
    for rows, replaced in ((9, False), (11, True)):
        command[:rows, 1] = 0.6
        sent[:, :4] = pulses(command)
        expected = 0.3 if replaced else command[:, 1]
        assert np.allclose(quad.thrusts(sent, asked)[:, 1], expected, atol=3e-3)


def test_thrust_ends_at_both_ends_of_the_range_and_so_does_what_is_asked() -> None:
    quad, full = known("quad x"), FRAMES["quad x"].factors
    sent = np.full((2, 32), np.nan)
    sent[0, :4], sent[1, :4] = 500.0, 2500.0
    assert quad.thrusts(sent, np.full((2, 4), np.nan)).tolist() == [[0.0] * 4, [1.0] * 4]
    for thrust in (0.2, 0.8):
        asked = np.array([[1.0, 0.0, 0.0, thrust]])
        command = np.clip(thrust + 0.5 * full[:, 0], 0.0, 1.0)
        sent[:, :4] = pulses(command[None])
        sent[0, 2] = 1500.0
        found = quad.thrusts(sent[:1], asked)[0]
        assert np.allclose(found, command, atol=3e-3), "at the limits the mixer's share is cut, too"


def functions(*outputs: int) -> dict[str, float]:
    """Return the parameters that put a copter's motors 1, 2, … on these outputs."""
    return {f"SERVO{n}_FUNCTION": 33.0 + k for k, n in enumerate(outputs)}


MOTORS = {"SPIN_MIN": 0.2, "SPIN_MAX": 0.9, "THST_EXPO": 0.65, "PWM_MIN": 1000.0, "PWM_MAX": 2000.0}
COPTER = {f"MOT_{name}": value for name, value in MOTORS.items()} | {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}
QUAD = COPTER | functions(1, 2, 3, 4)
LIFT = {f"Q_M_{name}": value for name, value in MOTORS.items()} | functions(*range(5, 11))
LIFT |= {"Q_ENABLE": 1.0, "Q_FRAME_CLASS": 2.0, "Q_FRAME_TYPE": 0.0, "Q_TILT_ENABLE": 0.0}
LIFT |= {"Q_TAILSIT_ENABLE": 0.0, "Q_M_SPIN_MIN": 0.1, "Q_M_SPIN_MAX": 0.95}
OLD = {"FRAME": 0.0, "MOT_SPIN_ARMED": 70.0, "RC3_MIN": 1000.0, "RC3_MAX": 2000.0, "RCMAP_THROTTLE": 3.0}
BY_THROTTLE = QUAD | {"MOT_PWM_MIN": 0.0, "MOT_PWM_MAX": 0.0, "RCMAP_THROTTLE": 3.0}
BY_THROTTLE |= {"RC3_MIN": 1100.0, "RC3_MAX": 1900.0}


FOUR, NARROW = (1, 2, 3, 4), {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}


@pytest.mark.parametrize(
    ("values", "frame", "servos", "range_us", "curve"),
    [
        (QUAD, "quad X", FOUR, (1200, 1900), 0.65),
        (QUAD | {"Q_ENABLE": 0.0}, "quad X", FOUR, (1200, 1900), 0.65),
        (QUAD | {"MOT_PWM_MIN": 1800.0, "MOT_PWM_MAX": 1945.0}, "quad X", FOUR, (1829, 1930.5), 0.65),
        (QUAD | NARROW | {"MOT_THST_EXPO": 0.5, "RC3_MIN": 1000.0}, "quad X", FOUR, (1260, 1820), 0.5),
        (BY_THROTTLE, "quad X", FOUR, (1260, 1820), 0.65),
        (COPTER | functions(32, 9, 3, 1) | {"SERVO2_FUNCTION": 4.0}, "quad X", (32, 9, 3, 1), (1200, 1900), 0.65),  # noqa: E501
        (COPTER | LIFT | {"Q_M_PWM_MIN": 1100.0}, "lift hexa +", tuple(range(5, 11)), (1190, 1955), 0.65),
        (OLD, "quad +", FOUR, (1150, 1950), 0.65),
    ],
)  # fmt: skip
def test_ardupilots_parameters_give_the_range_of_the_motors(
    values: dict[str, float], frame: str, servos: tuple[int, ...], range_us: tuple[float, ...], curve: float
) -> None:
    """Idle and full pulse: MOT_PWM_MIN … MOT_PWM_MAX times MOT_SPIN_MIN, MOT_SPIN_MAX (0.15, 0.95)."""
    found = rotors(values)
    assert (found.frame, found.servos, found.curve) == (frame, servos, curve)
    assert found.lift == frame.startswith("lift")
    assert (found.idle, found.full) == pytest.approx(range_us)


def placed(count: int, output: str = "PWM_MAIN_FUNC") -> dict[str, float]:
    """Return PX4's parameters of rotors evenly on a circle, from the nose on, on the outputs 2, 3, …"""
    values = {"CA_ROTOR_COUNT": float(count), "CA_AIRFRAME": 0.0, "THR_MDL_FAC": 0.0}
    for k, angle in enumerate(2 * np.pi * np.arange(count) / count):
        values |= {f"CA_ROTOR{k}_PX": np.cos(angle), f"CA_ROTOR{k}_PY": np.sin(angle)}
        values |= {f"CA_ROTOR{k}_KM": 0.05 * (-1) ** k, f"{output}{k + 2}": 101.0 + k}
    return values


PUSHED = placed(4) | {"CA_ROTOR_COUNT": 5.0, "CA_AIRFRAME": 2.0, "CA_ROTOR4_AX": 1.0}
PUSHED |= {f"CA_ROTOR{k}_AX": 0.0 for k in range(4)}


@pytest.mark.parametrize(
    ("values", "frame", "servos"),
    [
        (placed(4), "quad", (2, 3, 4, 5)),
        (placed(6, "PWM_AUX_FUNC"), "hexa", tuple(range(18, 24))),
        (placed(8, "HIL_ACT_FUNC"), "octa", tuple(range(2, 10))),
        (PUSHED, "lift quad", (2, 3, 4, 5)),
        *(
            ({"SYS_AUTOSTART": first + 1000.0 * (sign == "+"), "MAV_TYPE": kind}, f"{name} {sign}", outputs)
            for first, kind, name, outputs in (
                (4001.0, 2.0, "quad", (1, 2, 3, 4)),
                (6001.0, 13.0, "hexa", tuple(range(1, 7))),
                (8001.0, 14.0, "octa", tuple(range(1, 9))),
            )
            for sign in "X+"
        ),
    ],
)
def test_px4s_parameters_give_places_and_outputs(
    values: dict[str, float], frame: str, servos: tuple[int, ...]
) -> None:
    """Numbers of airframes as in PX4's list: 4000 quadrotor x, 5000 +, and so on; MAIN 1–16, AUX 17–32."""
    found = rotors(values, px4=True)
    assert (found.frame, found.servos, found.lift) == (frame, servos, frame.startswith("lift"))
    assert (found.idle, found.full, found.curve) == (1000, 2000, None)
    assert rotors(values | {"THR_MDL_FAC": 0.3}, px4=True).curve == 0.3
    if frame == "quad X":
        assert np.allclose(found.columns, known("quad x").columns)
    if "CA_ROTOR_COUNT" in values:
        bearings = (np.arange(0, 360, 360 / len(servos)) + 179.9) % 360 - 179.9
        assert found.bearings_deg == pytest.approx(bearings)


@pytest.mark.parametrize("values", [QUAD, BY_THROTTLE, LIFT, OLD, placed(4), PUSHED])
def test_motors_are_the_same_or_not_known_without_any_one_parameter(values: dict[str, float]) -> None:
    """A log that lost some records hides any value: no default takes its place."""
    px4 = "CA_AIRFRAME" in values
    whole = rotors(values, px4=px4)
    for name in values:
        found = of({other: value for other, value in values.items() if other != name}, px4=px4)
        assert not isinstance(found, Rotors) or found == whole, name


IN_LINE = placed(4) | {f"CA_ROTOR{k}_P{axis}": 2.0 * k - 3.0 for k in range(4) for axis in "XY"}
NOWHERE = placed(4) | {f"CA_ROTOR{k}_PX": 0.0 for k in range(4)}
SHIFTED = {name.replace("FUNC2", "FUNC20"): value for name, value in placed(4).items()}
SIMULATED = {**PARAMETERS, **FUNCTIONS, "FRAME_TYPE": 1.0}


@pytest.mark.parametrize(
    ("px4", "values", "why"),
    [
        (False, QUAD | {"MOT_PWM_MIN": 1800.0, "MOT_PWM_MAX": 1940.0}, "pulses_implausible"),  # 98 µs
        (False, COPTER | functions(1, 2, 3), "motor_unassigned"),
        (False, QUAD | {"FRAME_CLASS": 7.0}, "unjudged_frame"),
        (False, SIMULATED | {"FRAME_CLASS": 5.0}, "which of a pair"),
        (False, SIMULATED | {"FRAME_CLASS": 7.0}, "a tricopter turns by a servo"),
        (False, SIMULATED | {"FRAME_CLASS": 13.0}, "FRAME_CLASS 13"),
        (False, {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}, "None"),  # a rover or a boat
        (False, {}, "None"),
        (True, placed(3), "arrangement"),
        (True, placed(4) | {"CA_ROTOR_COUNT": 5.0}, "lacks the parameter CA_ROTOR4_PX"),
        (True, placed(5), "arrangement"),
        (True, NOWHERE, "arrangement"),
        (True, IN_LINE, "arrangement"),  # roll and pitch are one
        (True, SHIFTED, "motor_unassigned"),
        (True, placed(4) | {"CA_AIRFRAME": 1.0, "SYS_AUTOSTART": 4001.0, "MAV_TYPE": 2.0}, "None"),
        (True, {"SYS_AUTOSTART": 4001.0}, "None"),
        (True, {"MAV_TYPE": 2.0}, "None"),
        (True, {"SYS_AUTOSTART": 2100.0, "MAV_TYPE": 1.0}, "None"),
    ],
)
def test_parameters_that_leave_the_motors_unknown(px4: bool, values: dict[str, float], why: str) -> None:
    found = of(values, px4=px4)
    assert (found is None) == (why == "None")
    assert why in str(found)
