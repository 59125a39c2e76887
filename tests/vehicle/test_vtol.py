"""What carries a VTOL aircraft, from its parameters alone."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.vehicle.vtol import lift_of

# A tiltrotor: motors 1 and 3 tilt, motor 2 lifts only, servo 8 tilts.
TILTROTOR = {"Q_ENABLE": 1.0, "Q_TILT_MASK": 0b101}
TILTROTOR |= {f"SERVO{n}_FUNCTION": function for n, function in ((5, 33), (6, 34), (7, 35), (8, 41))}


def sent(**pulses: float) -> np.ndarray:
    """One sample of 16 outputs, µs: ``s5=1500`` sets output 5."""
    row = np.full((1, 16), 1000.0)
    for name, pulse in pulses.items():
        row[0, int(name[1:]) - 1] = pulse
    return row


def test_the_mask_of_tilts_parts_the_motors() -> None:
    lift = lift_of(TILTROTOR)
    assert [motor.servo for motor in lift.fixed] == [6]
    assert [motor.servo for motor in lift.tilting] == [5, 7]
    assert lift.tilts == ((8, 1100.0, 1900.0),)
    assert lift_of(TILTROTOR | {"Q_TILT_ENABLE": 0.0}).tilting == ()
    assert lift_of(TILTROTOR | {"Q_ENABLE": 0.0}).servos == frozenset()


@pytest.mark.parametrize(
    ("values", "servos"),
    [
        ({"Q_FRAME_CLASS": 10.0}, {5, 6}),
        ({"Q_FRAME_CLASS": 10.0, "Q_TAILSIT_MOTMX": 1.0}, {6}),
        ({"Q_TAILSIT_ENABLE": 1.0, "Q_TAILSIT_MOTMX": 1.0}, {6}),
        ({"Q_TAILSIT_MOTMX": 1.0}, {5, 6}),  # no tailsitter
        ({"Q_FRAME_CLASS": 10.0, "Q_TAILSIT_MOTMX": 1.0, "Q_TAILSIT_ENABLE": 0.0}, {5, 6}),
    ],
)
def test_motors_of_a_tailsitter_that_pull_do_not_lift(values: dict[str, float], servos: set[int]) -> None:
    motors = {"Q_ENABLE": 1.0, "SERVO5_FUNCTION": 33.0, "SERVO6_FUNCTION": 34.0}
    assert lift_of(motors | values).servos == servos


def test_functions_of_motors_lift_and_those_of_tilts_tilt_and_no_other() -> None:
    lifting = {n for n in range(150) if lift_of({"Q_ENABLE": 1.0, "SERVO3_FUNCTION": n}).servos}
    tilting = {n for n in range(150) if lift_of(TILTROTOR | {"SERVO8_FUNCTION": n}).tilts}
    assert lifting == {*range(33, 41), *range(82, 86)}
    assert tilting == {41, 45, 46, 47, 75, 76}


@pytest.mark.parametrize(
    ("parameters", "above_us"),
    [
        ({}, 1050.0),  # 0.05 of 1000 to 2000 µs
        ({"Q_M_PWM_MIN": 1100.0, "Q_M_PWM_MAX": 1900.0}, 1140.0),
        ({"Q_M_PWM_MIN": 0.0, "Q_M_PWM_MAX": 0.0}, 1050.0),  # 0: not set
        ({"Q_THR_MIN_PWM": 1200.0, "Q_THR_MAX_PWM": 1800.0}, 1230.0),  # names of earlier versions
        ({"Q_M_SPIN_MIN": 0.15}, 1200.0),
        ({"Q_M_SPIN_MIN": 9.0}, 1550.0),  # damaged: at most half of the range
        ({"Q_M_SPIN_MIN": -9.0}, 1050.0),
        ({"Q_M_PWM_MIN": 2000.0, "Q_M_PWM_MAX": 1000.0}, 2000.0),  # reversed: no range
    ],
)
def test_a_motor_carries_above_its_idle_pulse(parameters: dict[str, float], above_us: float) -> None:
    lift = lift_of({"Q_ENABLE": 1.0, "SERVO5_FUNCTION": 33.0, **parameters})
    assert lift.fixed[0].carries_us == pytest.approx(above_us)
    assert not lift.works(sent(s5=above_us - 1))[0]
    assert lift.works(sent(s5=above_us + 1))[0]


@pytest.mark.parametrize(("servo", "known"), [(0, False), (1, True), (16, True), (32, True), (33, False)])
def test_a_motor_lifts_and_turns_at_each_output(servo: int, known: bool) -> None:
    assert lift_of({f"SERVO{servo}_FUNCTION": 33.0}).servos == ({servo} if known else set())
    tilts = lift_of({f"SERVO{servo}_FUNCTION": 41.0, "Q_TILT_MASK": 1.0}).tilts
    assert tilts == (((servo, 1100.0, 1900.0),) if known else ())


def test_tilted_motors_lift_until_they_point_forward() -> None:
    lift = lift_of(TILTROTOR)
    assert lift.works(sent(s5=1500, s8=1100))[0]
    assert lift.works(sent(s5=1500, s8=1739))[0]  # 0.8 of 1100 to 1900 µs is 1740 µs
    assert not lift.works(sent(s5=1500, s8=1740))[0]
    assert lift.works(sent(s5=1500, s6=1500, s8=1900))[0], "the motor that does not tilt lifts"
    assert not lift.works(sent(s5=1500, s8=np.nan))[0], "no tilt is known: the fixed one counts, and is idle"
    reversed_ = lift_of(TILTROTOR | {"SERVO8_REVERSED": 1.0})
    assert not reversed_.works(sent(s5=1500, s8=1100))[0]
    assert reversed_.works(sent(s5=1500, s8=1900))[0]
    no_travel = lift_of(TILTROTOR | {"SERVO8_MIN": 1500.0, "SERVO8_MAX": 1500.0})
    assert no_travel.tilts == ()


def test_motor_seven_of_a_tricopter_is_its_tail_servo() -> None:
    motors = {"Q_ENABLE": 1.0, "SERVO5_FUNCTION": 33.0, "SERVO6_FUNCTION": 39.0}
    assert lift_of(motors).servos == {5, 6}
    assert lift_of(motors | {"Q_FRAME_CLASS": 7.0}).servos == {5}
