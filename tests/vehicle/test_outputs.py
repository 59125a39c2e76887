"""What parameters say of outputs, against the meaning that ArduPilot and PX4 document for each of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mavhums.vehicle.parameters import Parameters, assigned_outputs, read_parameters
from mavhums.vehicle.surfaces import AXES, Demands, SurfaceOutput, Surfaces, of_parameters, steers_by_wheels
from tests.log.ulog import writer
from tests.present import present


def outputs(values: Mapping[str, float], *, px4: bool = False) -> list[tuple[Any, ...]]:
    found = assigned_outputs(Parameters(1, px4, values))
    return [(one.servo, one.surface, one.pwm_us, one.is_reversed, one.is_surface) for one in found]


USUAL = (1100, 1500, 1900)


def test_which_functions_of_ardupilot_move_a_surface() -> None:
    surfaces = {2, 3, 4, 16, 17, 19, 21, 24, 25, 77, 78, 79, 80, 86, 87, 110}
    others = {*range(26, 41), 70, 73, 74, 82, 85}
    found = {n: outputs({"SERVO32_FUNCTION": float(n)}) for n in surfaces | others}
    assert {n for n, known in found.items() for *_, moves in known if moves} == surfaces


def test_pulses_of_ardupilot() -> None:
    base = {"SERVO2_FUNCTION": 19.0, "SERVO2_MIN": 1000.0, "SERVO2_TRIM": 1480.0, "SERVO2_MAX": 2000.0}
    for changes, pwm_us, is_reversed in (
        ({}, (1000, 1480, 2000), False),
        ({"SERVO2_REVERSED": 1.0}, (1000, 1480, 2000), True),
        ({"SERVO2_TRIM": 1000.0}, (1000, 1500, 2000), False),
        ({"SERVO2_TRIM": 2100.0}, (1000, 1500, 2000), False),
        ({"SERVO2_MAX": 1001.0}, USUAL, False),
        ({"SERVO2_MAX": 1002.0, "SERVO2_TRIM": 1001.0}, (1000, 1001, 1002), False),
    ):
        assert outputs(base | changes) == [(2, "elevator", pwm_us, is_reversed, True)]
    assert outputs({"SERVO2_FUNCTION": 19.0, "SERVO2_MIN": 1000.0})[0][2] == (1000, 1450, 1900)


def test_channels_of_arduplane_before_3_8() -> None:
    """RCn_REV is -1 where reversed and 1 else; RCMAP_* move the first four channels."""
    old = {"RC1_REV": 1.0, "KFF_RDDRMIX": 0.5}
    moved = {"RC1_REV": -1.0, "RC2_REV": 1.0, "RC4_REV": -1.0, "RC8_FUNCTION": 3.0}
    names, turned = ("aileron", "elevator", "throttle", "rudder", "flap"), (True, False, False, True, False)
    expected = [*zip((1, 2, 3, 4, 8), names, turned, strict=True)]
    assert [(one[0], one[1], one[3]) for one in outputs(old | moved)] == expected
    found = {one[0]: one[1] for one in outputs(old | {"RCMAP_ROLL": 6.0, "RCMAP_YAW": 1.0})}
    assert found == {1: "rudder", 2: "elevator", 3: "throttle", 6: "aileron"}
    trimmed = outputs(old | {"RC2_TRIM": 1487.0, "RC2_MIN": 1068.0, "RC2_MAX": 1907.0})
    assert [one[2][1] for one in trimmed[:2]] == [1500, 1487]
    five = assigned_outputs(Parameters(1, False, old | {"RC5_FUNCTION": 4.0}))
    assert [five[0].because, five[-1].because] == ["channel 1 of ArduPlane before 3.8", "RC5_FUNCTION = 4"]
    for mixed in ("VTAIL_OUTPUT", "ELEVON_MIXING"):
        assert outputs(old | {mixed: 1.0}) == []
        assert outputs(old | {mixed: 0.0}) == outputs(old)
    # A later version whose SERVOn_FUNCTION were not downloaded has RCn_REVERSED.
    for lost in ({"RC1_REV": 1.0}, {"RC1_REVERSED": 0.0, "KFF_RDDRMIX": 0.5}):
        assert outputs(lost) == []


def px4(kind: int, *, bus: str = "PWM_MAIN", n: int = 1, k: int = 0) -> dict[str, float]:
    """Return the parameters of servo ``k`` on output ``n`` of a bus."""
    return {f"{bus}_FUNC{n}": 201.0 + k, f"CA_SV_CS{k}_TYPE": float(kind)}


def test_outputs_of_px4() -> None:
    """CA_SV_CSn_TYPE of the actuator reference; MAIN counts from 1, AUX from 17, UAVCAN from 33."""
    names = """left aileron,right aileron,elevator,rudder,left elevon,right elevon,left v-tail,right v-tail,
        left flap,right flap,airbrake,servo 1,left a-tail,right a-tail,aileron,-,left spoiler,right spoiler"""
    for kind, name in enumerate((word.strip() for word in names.split(",")), start=1):
        found = outputs(px4(kind), px4=True)
        assert found == ([] if name == "-" else [(1, name, (1000, 1500, 2000), False, True)])
    for bus, first, usual in (("PWM_MAIN", 0, 1000), ("PWM_AUX", 16, 1000), ("UAVCAN_SV", 32, 0)):
        pwm_us = (usual, (usual + usual + 1000) // 2, usual + 1000)
        for n in (1, 16):
            reverse = {f"{bus}_REV": float(1 << (n - 1))}
            found = outputs(px4(3, bus=bus, n=n, k=5) | reverse, px4=True)
            assert found == [(first + n, "elevator", pwm_us, True, True)]
            one_pulse = {f"{bus}_MIN{n}": 1500.0, f"{bus}_CENT{n}": 1500.0, f"{bus}_MAX{n}": 1501.0}
            assert outputs(px4(3, bus=bus, n=n) | one_pulse, px4=True)[0][2] == pwm_us
            ends = {f"{bus}_MIN{n}": usual + 50.0, f"{bus}_MAX{n}": usual + 950.0}
            assert outputs(px4(3, bus=bus, n=n) | ends, px4=True)[0][2] == (
                usual + 50,
                usual + 500,
                usual + 950,
            )
            assert not outputs(px4(3, bus=bus, n=n) | {f"{bus}_REV": float(1 << n)}, px4=True)[0][3]
    [known] = assigned_outputs(Parameters(1, True, px4(3, bus="PWM_AUX")))
    assert known.because == "PWM_AUX_FUNC1 = 201, CA_SV_CS0_TYPE = 3"
    assert "CHECK" in known.calibrated_by
    motors = {f"PWM_MAIN_FUNC{n}": one for n, one in enumerate((101.0, 112.0, 113.0, 233.0), start=1)}
    found = [(servo, what, moves) for servo, what, _, _, moves in outputs(motors, px4=True)]
    assert found == [(1, "motor 1", False), (2, "motor 12", False)]


def surfaces(values: Mapping[str, float], *, of_px4: bool = False) -> Surfaces:
    return present(of_parameters(Parameters(1, of_px4, values)))


def test_signs_of_px4_are_those_of_the_torque() -> None:
    for kind, name, letter, without in (
        (1, "left aileron", "R", -500),
        (2, "right aileron", "R", 500),
        (3, "elevator", "P", 500),
        (4, "rudder", "Y", 500),
        (7, "left tail", "P", 500),
    ):
        for torque, half in ((0.0, without), (0.5, 500), (-0.5, -500)):
            values = px4(kind, k=3) | {f"CA_SV_CS3_TRQ_{letter}": torque}
            for reverse, sign in ((0.0, 1), (1.0, -1)):
                known = surfaces(values | {"PWM_MAIN_REV": reverse}, of_px4=True)
                assert known.moved == (SurfaceOutput(1, name, 1500, sign * half),)


def servos(*functions: int) -> dict[str, float]:
    return {f"SERVO{n}_FUNCTION": float(function) for n, function in enumerate(functions, start=1)}


@pytest.mark.parametrize(
    ("functions", "axes", "mixed"),
    [
        ((4, 19, 70, 21), [(1,), (2,), (4,)], {}),
        ((24, 25, 19, 21), [(1, 2), (3,), (4,)], {}),
        ((4, 24, 25, 19), [(1,), (4,), ()], {}),
        ((77, 78, 21), [(1, 2), (1, 2), (3,)], {"roll": "pitch", "pitch": "roll"}),
        ((16, 86, 17, 87), [(1, 2, 3, 4), (1, 2, 3, 4), ()], {"roll": "pitch", "pitch": "roll"}),
        ((77, 19, 21), [(1,), (2,), (3,)], {}),
        ((77, 78, 19), [(1, 2), (3,), ()], {}),
        ((4, 79, 80), [(1,), (2, 3), (2, 3)], {"pitch": "yaw"}),
        ((4, 79, 80, 21), [(1,), (2, 3), (4,)], {"pitch": "yaw"}),
        ((4, 79, 19), [(1,), (3,), (2,)], {}),
    ],
)
def test_surfaces_of_each_axis(
    functions: tuple[int, ...], axes: list[tuple[int, ...]], mixed: dict[str, str]
) -> None:
    known = surfaces(servos(*functions))
    assert [tuple(one.servo for one in known.of_axis(axis)) for axis in AXES] == axes
    assert known.mixed == mixed


def test_of_several_outputs_the_median_of_their_shares_counts() -> None:
    pulses = np.full((1, 32), np.nan)
    pulses[0, :3] = 1600, 1400, 1900
    demand = Demands(surfaces(servos(4, 4, 4))).feed(pulses)
    np.testing.assert_allclose(demand, [[0.25, np.nan, np.nan]])


@pytest.mark.parametrize(
    ("functions", "axis", "ignored"),
    [((4, 4), 0, True), ((19, 19), 1, True), ((77, 77, 78), 0, False), ((79, 79, 80), 1, False)],
)
def test_of_several_outputs_one_that_is_stuck_is_ignored_unless_they_mix(
    functions: tuple[int, ...], axis: int, ignored: bool
) -> None:
    """The first output stays at half its travel for 3 s, while the others move as one."""
    moves = 1500 + 100 * np.sin(np.arange(60) / 3)
    pulses = np.full((60, 32), np.nan)
    pulses[:, : len(functions)] = moves[:, None]
    alone = Demands(surfaces(servos(*functions))).feed(pulses)[:, axis]
    pulses[:, 0] = 1700
    for size in (60, 7):
        demands = Demands(surfaces(servos(*functions)))
        found = np.concatenate([demands.feed(pulses[k : k + size])[:, axis] for k in range(0, 60, size)])
        assert not np.allclose(found[:19], alone[:19])
        np.testing.assert_allclose(found[20:], alone[20:] if ignored else found[20:])
        assert np.allclose(found[20:], alone[20:]) == ignored


@pytest.mark.parametrize(
    ("bus", "n", "moved"), [("PWM_MAIN", 1, (1,)), ("PWM_AUX", 16, (32,)), ("UAVCAN_SV", 1, None)]
)
def test_an_output_counts_up_to_the_last_one_of_the_second_message(
    bus: str, n: int, moved: tuple[int, ...] | None
) -> None:
    found = of_parameters(Parameters(1, True, px4(3, bus=bus, n=n)))
    assert (found and tuple(one.servo for one in found.moved)) == moved


def test_skid_steering_needs_both_wheels_and_a_rover() -> None:
    tank = {"CRUISE_THROTTLE": 50.0, "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    assert steers_by_wheels(Parameters(1, False, tank))
    for name in tank:
        less = {key: value for key, value in tank.items() if key != name}
        assert not steers_by_wheels(Parameters(1, False, less))
    for airframe, wheels in ((5.0, False), (6.0, True), (7.0, False)):
        assert steers_by_wheels(Parameters(1, True, {"CA_AIRFRAME": airframe})) == wheels


def test_inferred_outputs_are_parted_beyond_three_microseconds() -> None:
    """Two outputs of opposite sense: the median of their shares lies midway, half as far from each."""
    pair = (SurfaceOutput(1, "aileron", 1500, 400), SurfaceOutput(2, "aileron", 1500, -400))
    pulses = np.full((4, 32), np.nan)
    pulses[:, 0] = [1600.0, 1600.0, 1605.5, 1606.5]
    pulses[:, 1] = [1400.0, np.nan, 1400.0, 1400.0]
    for origin, parted in (("inferred", [False, False, False, True]), ("profile", [False] * 4)):
        demands = Demands(Surfaces(pair, origin))
        roll = demands.feed(pulses)[:, 0]
        assert demands.parted.tolist() == parted
        expected = np.where(parted, np.nan, [0.25, 0.25, 0.256875, 0.258125])
        np.testing.assert_allclose(roll, expected, rtol=1e-12)


def test_parameters_of_a_ulog_are_numbers_and_the_last_counts(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(writer.flight(3.0))
    parameters = read_parameters(path)
    assert parameters.is_px4
    assert parameters.vehicle == 7
    assert dict(parameters.values) == {"MAV_SYS_ID": 7, "PWM_MAIN_MIN1": 1050, "CA_SV0_TRQ_R": -0.5}
