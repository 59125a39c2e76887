"""The compiled kernels do what their Python does, in every branch."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mavhums_sim import _integrate
from mavhums_sim._integrate import Course, integrate_one_mass, integrate_two_masses, mesh, rub
from mavhums_sim.ema import EmaParameters

ONE = EmaParameters.from_data_sheet(integral_gain=400.0)
N = 60


def course() -> Course:
    rng = np.random.default_rng(0)
    return Course(
        command=np.radians(20 * np.sin(np.arange(N) / 9)),
        friction=np.full(N, 0.225),
        load_slope=rng.uniform(0, 2, N),
        load_offset=rng.uniform(-2, 2, N),
        torque_factor=rng.uniform(0.9, 1, N),
        resistance_factor=rng.uniform(1, 1.2, N),
        speed_factor=rng.uniform(0.5, 1, N),
        sag=rng.uniform(0, 5, N),
        sensor_bias=np.full(N, 0.01),
        backlash=np.full(N, 0.002),
        jam=np.where(np.arange(N) > 50, 10.0, 0.0),
    )


@pytest.mark.parametrize("method", ["impulse", "karnopp"])
@pytest.mark.parametrize("kernel", [integrate_one_mass, integrate_two_masses])
def test_compiled_kernel_does_what_its_python_does(
    kernel: Any, method: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    constants = replace(ONE.two_masses(), friction_method=method).constants()
    compiled = kernel(1e-4, 10, constants, course())
    helpers = ("rub", "mesh", "control", "advance_one_mass", "advance_two_masses", "_note", "_remember")
    for name in helpers:
        monkeypatch.setattr(_integrate, name, getattr(_integrate, name).py_func)
    python = kernel.py_func(1e-4, 10, constants, course())
    for one, other in zip(compiled, python, strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("rule", [rub, vars(rub)["__wrapped__"]])
@pytest.mark.parametrize(
    ("speed", "torque", "band", "expected"),
    [
        (0.0, 1.1, 0.0, 0.0),  # the impulse holds a resting shaft up to T_s = 1.2 N·m …
        (0.0, 1.3, 0.0, 0.003),  # … and beyond it only T_c = 1 N·m brakes
        (0.0005, 0.0, 0.0, 0.0),  # a slow shaft stops, and is not thrown back
        (1.0, 0.0, 0.0, 0.99),
        (-1.0, 0.0, 0.0, -0.99),
        (0.0005, 1.1, 1e-3, 0.0),  # Karnopp: within the band T_s holds …
        (0.0, 1.3, 1e-3, 0.001),  # … and beyond it T_s is subtracted
        (1.0, 0.0, 1e-3, 0.99),
    ],
)
def test_friction_rule(rule: Any, speed: float, torque: float, band: float, expected: float) -> None:
    result = rule(speed, torque, 1.0, 1.2, 0.1, 1e-3, band)
    assert result == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("rule", [mesh, vars(mesh)["__wrapped__"]])
@pytest.mark.parametrize(
    ("twist", "speed", "expected"),
    [
        (0.0, 5.0, 0.0),
        (0.3, 0.0, 20.0),
        (-0.3, 0.0, -20.0),
        (0.3, -50.0, 0.0),
        (-0.3, 50.0, 0.0),
        (0.3, 1.0, 21.0),
    ],
)
def test_teeth_push_outside_the_play_and_never_pull(
    rule: Any, twist: float, speed: float, expected: float
) -> None:
    assert rule(twist, speed, 0.1, 100.0, 1.0) == pytest.approx(expected)
