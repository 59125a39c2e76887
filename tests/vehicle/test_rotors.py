"""The motors of a multirotor against the simulator, which has its own tables."""

import numpy as np
import pytest

from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.rotors import _FRAMES, Rotors, rotors_of
from mavhums_sim.multirotor.craft import FRAMES
from mavhums_sim.multirotor.log import PARAMETERS, pulses


def of(values: dict[str, float], *, px4: bool = False) -> Rotors | str | None:
    return rotors_of(Parameters(1, px4, values))


def known(frame: str) -> Rotors:
    kind, type_ = FRAMES[frame].parameters
    rotors = of({**PARAMETERS, "FRAME_CLASS": kind, "FRAME_TYPE": type_})
    assert isinstance(rotors, Rotors)
    return rotors


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
    rotors = of({**PARAMETERS, "FRAME_CLASS": float(size), "FRAME_TYPE": float(type_)})
    assert isinstance(rotors, Rotors)
    assert "order" in rotors.frame or "clockwise" in rotors.frame


def test_betaflights_first_motor_is_the_rear_right_one() -> None:
    rotors = of({**PARAMETERS, "FRAME_CLASS": 1.0, "FRAME_TYPE": 12.0})
    assert isinstance(rotors, Rotors)
    assert rotors.frame == "quad X (Betaflight order)"
    right_rear, right_front, left_rear, left_front = np.sign(rotors.columns).tolist()
    assert (right_rear, right_front) == ([-1, -1, -1], [-1, 1, 1])
    assert (left_rear, left_front) == ([1, -1, 1], [1, 1, -1])


def test_thrusts_invert_the_curve_of_the_parameters() -> None:
    command = np.random.default_rng(1).uniform(0, 1, (50, 4))
    sent = np.full((50, 32), np.nan)
    sent[:, :4] = pulses(command)
    thrusts = known("quad x").thrusts(sent, np.full((50, 4), np.nan))
    assert np.allclose(thrusts, command, atol=2e-3)


def test_an_overridden_output_is_replaced_by_what_the_mixer_asks() -> None:
    rotors = known("hexa x")
    asked = np.array([[0.1, -0.05, 0.02, 0.4]])
    command = asked[:, 3:] + 0.5 * asked[:, :3] @ FRAMES["hexa x"].factors.T
    sent = np.full((1, 32), np.nan)
    sent[:, :6] = pulses(command)
    sent[0, 2] = 1000.0
    assert np.allclose(rotors.thrusts(sent, asked), command, atol=3e-3)
    # Without the mixer's commands, the outputs are all that is known.
    assert rotors.thrusts(sent, np.full((1, 4), np.nan))[0, 2] == 0.0


def test_functions_name_the_outputs() -> None:
    values = {**PARAMETERS, "FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}
    functions = {
        f"SERVO{n}_FUNCTION": function for n, function in zip(range(5, 9), (34, 33, 36, 35), strict=True)
    }
    rotors = of(values | functions)
    assert isinstance(rotors, Rotors)
    assert rotors.servos == (6, 5, 8, 7)
    assert isinstance(of(values | {"SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 1.0}), str)


def test_what_is_no_multirotor_or_not_known() -> None:
    assert of({"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}) is None  # a rover or a boat
    assert of({}) is None
    for kind, why in (
        (5.0, "which of a pair"),
        (7.0, "a tricopter turns by a servo"),
        (13.0, "FRAME_CLASS 13"),
    ):
        assert why in str(of({**PARAMETERS, "FRAME_CLASS": kind, "FRAME_TYPE": 1.0}))


def test_px4_tells_the_places_or_an_airframe() -> None:
    placed = {"CA_ROTOR_COUNT": 4.0, "CA_AIRFRAME": 0.0}
    for k, (x, y, km) in enumerate(((1, 1, 0.05), (-1, -1, 0.05), (1, -1, -0.05), (-1, 1, -0.05))):
        placed |= {
            f"CA_ROTOR{k}_PX": x,
            f"CA_ROTOR{k}_PY": y,
            f"CA_ROTOR{k}_KM": km,
            f"PWM_MAIN_FUNC{k + 1}": 101 + k,
        }
    by_place, by_number = of(placed, px4=True), of({"SYS_AUTOSTART": 4001.0, "MAV_TYPE": 2.0}, px4=True)
    assert isinstance(by_place, Rotors)
    assert isinstance(by_number, Rotors)
    assert np.allclose(by_place.columns, by_number.columns)
    assert np.allclose(by_place.columns, known("quad x").columns)
    assert of({"SYS_AUTOSTART": 2100.0, "MAV_TYPE": 1.0}, px4=True) is None
