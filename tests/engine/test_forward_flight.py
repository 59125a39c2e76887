"""What counts as forward flight, and which condition failed where nothing does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from mavhums.results.verdict import ALL
from mavhums.show.headline import NOT_JUDGED, headline
from mavhums.vehicle.vtol import lift_of
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
    late = judged(replace(flight, sent_s=100.0).tlog())[0]
    assert late.usage[0].forward_s == judged(flight.tlog())[0].usage[0].forward_s


def test_a_tilt_that_the_log_does_not_carry_is_known_by_the_motors_that_do_not_tilt() -> None:
    lift = lift_of({"Q_ENABLE": 1.0, "Q_TILT_MASK": 1.0, "SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 34.0})
    pulses = np.array([[1900.0, 1000.0], [1900.0, 1300.0], [1900.0, np.nan]])
    assert lift.works(pulses).tolist() == [False, True, False]
    tilts_all = lift_of({"Q_ENABLE": 1.0, "Q_TILT_MASK": 3.0, "SERVO1_FUNCTION": 33.0})
    assert tilts_all.works(pulses).all(), "hovering and flying look alike"


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


def test_a_helicopter_is_not_judged() -> None:
    values = {"FRAME_CLASS": 6.0, **{f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 5)}}
    log = Wired(seconds=20, parameters=values).dataflash().replace(b"ArduPlane V4.5.7 ", b"ArduCopter V4.5.7")
    assessment, _ = judged(log)
    assert assessment.usage[0].kind == "helicopter"
    assert "helicopter: " in str(of(assessment, "axes").reason)
    servos = {v.actuator: v.condition for v in assessment.verdicts if v.subject == "actuator"}
    assert servos == {ALL: "unmonitored"}
    assert headline(assessment).text == f"Helicopter: {NOT_JUDGED}"


@pytest.mark.parametrize("parameters", [{"Q_TILT_MASK": 5.0}, {"Q_TAILSIT_ENABLE": 1.0}])
def test_motors_that_pull_forward_too_are_said_to_be_not_judged(parameters: dict[str, float]) -> None:
    assessment, _ = judged(Wired(seconds=20, parameters={"Q_ENABLE": 1.0, **parameters}).tlog())
    assert assessment.log.notices[-1].startswith("lift motors that also drive forward flight")
    assert not [one for one in assessment.verdicts if one.subject == "motor"]
