"""Which speed a servo with a measured angle has: its register, or the slope of the angle."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.health.estimation.equations.interface import ServoSpeed
from mavhums.health.estimation.flight_sums import AngleIntegrator
from mavhums.health.estimation.slots import Slots
from tests.health.builders import one_slot, samples
from tests.health.self_baseline.servo import blank

LEAST = 10
HALF = 5  # of the changes


def second(turns: int, steps: int, unknown: int = 0) -> tuple[Slots, ServoSpeed]:
    """Return a second in which the angle changes so often, and the register in the first so many of these.

    The register is not known in the last ``unknown`` changes of the angle.
    """
    n = turns + 1
    speed = np.minimum(np.arange(n), steps) * 1.0
    if unknown:
        speed[-unknown:] = np.nan
    return one_slot(np.arange(n) / 100.0, samples(n, V3=np.arange(n))), ServoSpeed(speed, 0.1)


@pytest.mark.parametrize(
    ("turns", "steps", "coarse"),
    [(LEAST, HALF, False), (LEAST, HALF - 1, True), (LEAST - 1, 0, None), (LEAST, LEAST, False)],
)
def test_a_register_that_changes_less_often_than_the_angle_is_coarse(
    turns: int, steps: int, coarse: bool | None
) -> None:
    turned = AngleIntegrator(0.5)
    slots, register = second(turns, steps)
    used = turned.fine_speed(blank(), slots, register)
    assert turned.coarse is coarse
    assert (used is register) == (not coarse)
    if coarse:
        assert used.rad_s[3:-3] == pytest.approx(np.radians(100.0))


def test_what_the_register_does_not_report_is_no_step_of_it() -> None:
    turned = AngleIntegrator(0.5)
    turned.fine_speed(blank(), *second(2 * LEAST, HALF - 1, LEAST))
    assert turned.coarse is True
    other = AngleIntegrator(0.5)
    other.fine_speed(blank(), *second(2 * LEAST, 0, LEAST + 1))
    assert other.coarse is None


def test_a_step_of_the_angle_is_a_speed_for_a_few_hundredths_of_a_second() -> None:
    """At 90 Hz three samples lie within 0.04 s on either side."""
    slots = one_slot(np.arange(90) / 90.0, samples(90, V3=np.where(np.arange(90) < 45, 0.0, 0.1)))
    turned = AngleIntegrator(0.5)
    turned.coarse = True
    used = turned.fine_speed(blank(), slots, ServoSpeed(np.zeros(90), 0.1))
    assert np.flatnonzero(used.rad_s > 0.0).tolist() == [*range(42, 48)]


def test_the_first_second_with_motion_decides() -> None:
    turned = AngleIntegrator(0.5)
    for turns, steps in ((LEAST, 0), (LEAST, LEAST)):
        turned.fine_speed(blank(), *second(turns, steps))
    assert turned.coarse is True
