"""What counts as forward flight, and which condition failed where nothing does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from mavhums.health.verdict.obstacles import why_not_at_all
from mavhums.show.headline import NOT_JUDGED, headline
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.vtol import lift_of, refined_identity, rotor_servos
from tests.engine.test_axes import of
from tests.engine.wired import PLANE, Wired
from tests.judge import judged

TILTROTOR = {
    "Q_ENABLE": 1.0,
    "Q_TILT_ENABLE": 1.0,
    "Q_TILT_MASK": 1.0,
    "Q_M_PWM_MIN": 1000.0,
    "Q_M_PWM_MAX": 2000.0,
    "Q_M_SPIN_MIN": 0.05,
    **PLANE,
    **{f"SERVO{n}_FUNCTION": f for n, f in ((5, 33.0), (6, 34.0), (7, 41.0))},
    **{f"SERVO{n}_{end}": us for n in (1, 2, 4) for end, us in (("MIN", 1100.0), ("MAX", 1900.0))},
    "SERVO7_MIN": 1000.0,
    "SERVO7_MAX": 2000.0,
}
"""Motor 1 on output 5 tilts by servo 7, motor 2 on output 6 lifts."""
HOVERS_S = 60


def transition(*, tilt_us: int = 2000, idle_us: int = 1060) -> Callable[[float], Sequence[int]]:
    def others(t: float) -> Sequence[int]:
        return (1500, 1500, 1000, 0) if t < HOVERS_S else (1900, idle_us, tilt_us, 0)

    return others


def test_a_tilted_motor_pulls_and_an_idling_one_does_not_lift() -> None:
    assessment, _ = judged(Wired(parameters=TILTROTOR, others=transition()).tlog())
    [usage] = assessment.usage
    assert usage.kind == "tiltrotor"
    assert usage.forward_s == pytest.approx(170 - HOVERS_S, abs=2)
    assert of(assessment, "roll").condition == "unchanged"  # it is as fast while it hovers


@pytest.mark.parametrize(
    "others", [transition(tilt_us=1500), transition(idle_us=1300)], ids=["half tilted", "lifting"]
)
def test_a_transition_that_is_not_finished_is_named_with_its_seconds(
    others: Callable[[float], Sequence[int]],
) -> None:
    assessment, _ = judged(Wired(parameters=TILTROTOR, others=others).tlog())
    reason = str(of(assessment, "axes").reason)
    assert assessment.usage[0].forward_s == 0
    assert "the lift motors carried it" in reason
    assert "fastest 18 m/s" in reason


@pytest.mark.slow
def test_parameters_that_come_late_give_the_same_forward_flight() -> None:
    flight = Wired(parameters=TILTROTOR, others=transition())
    late = judged(replace(flight, told_s=100.0).tlog())[0]
    assert late.usage[0].forward_s == judged(flight.tlog())[0].usage[0].forward_s


@pytest.mark.parametrize(
    ("parameters", "kind", "lifts"),
    [
        ({"Q_ENABLE": 0.0}, "fixed wing", set()),
        ({"Q_ENABLE": 1.0}, "quadplane", {5, 6, 7, 8}),
        ({"Q_ENABLE": 1.0, "Q_TILT_MASK": 5.0}, "tiltrotor", {5, 6, 7, 8}),
        ({"Q_ENABLE": 1.0, "Q_TILT_MASK": 5.0, "Q_TILT_ENABLE": 0.0}, "quadplane", {5, 6, 7, 8}),
        ({"Q_ENABLE": 1.0, "Q_FRAME_CLASS": 7.0}, "quadplane", {5, 6, 7, 8}),
        ({"Q_ENABLE": 1.0, "Q_TAILSIT_ENABLE": 1.0, "Q_TAILSIT_MOTMX": 3.0}, "tailsitter", {7, 8}),
    ],
)
def test_parameters_tell_the_kind_and_what_lifts(
    parameters: dict[str, float], kind: str, lifts: set[int]
) -> None:
    values = parameters | {f"SERVO{5 + k}_FUNCTION": 33.0 + k for k in range(4)} | {"SERVO9_FUNCTION": 39.0}
    tail = {9} if parameters.get("Q_FRAME_CLASS") != 7.0 and lifts else set()  # a tricopter's tail servo
    assert refined_identity(Identity(1, "fixed wing"), values).kind == kind
    assert lift_of(values).servos == lifts | tail


def test_a_tilt_that_the_log_does_not_carry_is_told_by_the_motors_that_do_not_tilt() -> None:
    lift = lift_of({"Q_ENABLE": 1.0, "Q_TILT_MASK": 1.0, "SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 34.0})
    pulses = np.array([[1900.0, 1000.0], [1900.0, 1300.0], [1900.0, np.nan]])
    assert lift.works(pulses).tolist() == [False, True, False]
    tilts_all = lift_of({"Q_ENABLE": 1.0, "Q_TILT_MASK": 3.0, "SERVO1_FUNCTION": 33.0})
    assert tilts_all.works(pulses).all(), "hovering and flying cannot be told apart"


@pytest.mark.slow
def test_which_modes_and_transitions_are_forward_flight() -> None:
    """ArduPlane hovers in its Q modes, 17 to 25 without 24 (thermal); MAV_VTOL_STATE 4 is forward flight."""

    def up(kind: int, autopilot: int, mode: int, vtol: float) -> bool:
        flat = {
            "state": np.array([[kind, autopilot, 1.0, mode]], dtype=np.float64),
            "vtol": np.array([[vtol]]),
            "landed": np.full((1, 1), np.nan),
            "groundspeed": np.full((1, 1), 12.0),
        }
        return bool(Flight(None)._up(flat, np.array([12.0]), np.zeros(1, dtype=bool))[0])

    hovering = {mode for mode in range(40) if not up(1, 3, mode, np.nan)}
    assert hovering == {17, 18, 19, 20, 21, 22, 23, 25}
    assert all(up(1, 12, mode, 0.0) for mode in hovering), "the modes of PX4 are others"
    for kind in (1, *range(19, 26)):
        assert [state for state in range(1, 6) if up(kind, 3, 10, state)] == [4]
    assert {kind for kind in range(40) if up(kind, 3, 10, np.nan)} == {1}


def test_outputs_without_pulses_are_recorded_all_the_same() -> None:
    """A log from the bench with the safety switch on."""
    silent = of(judged(Silent(seconds=60).dataflash())[0], "axes")
    assert silent.reason_codes == ("no_pulses",)
    assert "(600 RCOU)" in str(silent.reason)


class Silent(Wired):
    """The same flight with outputs that are off."""

    def rows(self):  # type: ignore[no-untyped-def]
        for t, _, p in super().rows():
            yield t, [0, 0, 0, 0], p


def test_a_program_on_board_is_named() -> None:
    flight = Flight(None)
    flight.kinds = {18}
    why = why_not_at_all(flight)
    assert why[0].text.startswith("a companion computer: ")


def test_the_servos_of_a_helicopters_rotors_are_unmonitored() -> None:
    values = {"FRAME_CLASS": 6.0, **{f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}}
    assert [*rotor_servos(values).values()] == ["swashplate 1", "swashplate 2", "swashplate 3", "tail rotor"]
    log = Wired(seconds=20, parameters=values).dataflash().replace(b"ArduPlane V4.5.7 ", b"ArduCopter V4.5.7")
    assessment, _ = judged(log)
    assert assessment.usage[0].kind == "helicopter"
    assert "helicopter: " in str(of(assessment, "axes").reason)
    servos = {v.actuator: v.condition for v in assessment.verdicts if v.subject == "actuator"}
    assert servos["swashplate 1 (servo 1)"] == servos["tail rotor (servo 4)"] == "unmonitored"
    assert headline(assessment).text == f"Helicopter: {NOT_JUDGED}"


@pytest.mark.parametrize("parameters", [{"Q_TILT_MASK": 5.0}, {"Q_TAILSIT_ENABLE": 1.0}])
def test_motors_that_pull_forward_too_are_said_to_be_not_judged(parameters: dict[str, float]) -> None:
    assessment, _ = judged(Wired(seconds=20, parameters={"Q_ENABLE": 1.0, **parameters}).tlog())
    assert assessment.log.notices[-1].startswith("lift motors that also drive forward flight")
    assert not [one for one in assessment.verdicts if one.subject == "motor"]


def test_differential_spoilers_are_split_elevons() -> None:
    """Each side's pair opens with the rudder and moves together with roll: the mean is the demand."""
    from mavhums.vehicle.parameters import Parameters
    from mavhums.vehicle.surfaces import Demands, of_parameters

    values = {f"SERVO{n}_FUNCTION": f for n, f in ((5, 86.0), (6, 16.0), (7, 87.0), (8, 17.0))}
    surfaces = of_parameters(Parameters(1, False, values))
    assert surfaces is not None
    assert [moved.servo for moved in surfaces.of_axis("roll")] == [5, 6, 7, 8]
    roll, split = np.sin(np.arange(100) / 10), 0.3 * np.cos(np.arange(100) / 7)
    pulses = np.full((100, 32), np.nan)
    for servo, share in ((5, roll + split), (6, roll - split), (7, -roll), (8, -roll)):
        pulses[:, servo - 1] = 1500 + 200 * share
    assert Demands(surfaces).feed(pulses)[:, 0] == pytest.approx(0.5 * roll)
