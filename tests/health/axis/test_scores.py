"""Sums over seconds, and what a reference finds: each against its definition."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.reference import constants, least_squares, without_blocks
from mavhums.health.axis.regressions import FORMS, Shape
from tests.health.axis.flights import excited, lagged, late, rows, steady
from tests.present import present


@pytest.mark.parametrize(("axis", "column"), [("roll", 0), ("steering", 2)])
@pytest.mark.parametrize(("delay", "tau_s"), [(0, 0.0), (4, 0.1), (6, 0.2)])
def test_a_reference_finds_the_delay_and_the_lag(axis: str, column: int, delay: int, tau_s: float) -> None:
    flight, demand = steady(60), excited(60)
    flight["outputs"][:, column] = demand
    answer = late(lagged(demand, tau_s) if tau_s else demand, delay)
    flight["yaw_rate" if axis == "steering" else "roll_rate"] = 2.0 * answer
    tracker = EffectivenessTracker(axis)
    tracker.feed(rows(flight))
    assert present(tracker.reference).shape == Shape(delay, tau_s)
    assert present(tracker.reference).gain == pytest.approx(2.0)


def test_constants_have_the_error_of_a_jackknife_over_blocks() -> None:
    """Of a mean of blocks whose length is one: the standard error of that mean."""
    answer = np.array([1.0, 2.0, 4.0, 8.0, 3.0, 5.0, 9.0])
    form: Any = FORMS["roll"]
    # K = −1 is fitted exactly in rows that another column marks; b is the mean of the rest.
    design = np.zeros((14, 3))
    design[:7, 1] = 1.0
    design[7:, 0] = np.arange(1.0, 8.0)
    response = np.append(answer, -np.arange(1.0, 8.0))
    order = np.arange(14).reshape(2, 7).T.ravel()  # one row of each kind in every block of two
    given = design[order], response[order]
    fits = least_squares(*given)[0], without_blocks(*given)
    found = constants(form, 18.0, *fits)
    assert found["hard_over"].value == pytest.approx(answer.mean())
    assert found["hard_over"].error == pytest.approx(answer.std(ddof=1) / np.sqrt(7.0))
    assert constants(FORMS["yaw"], 18.0, *fits) == {}
