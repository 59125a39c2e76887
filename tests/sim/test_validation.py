"""The checks pass on the actuator as it is, and fail on one that is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mavhums_sim import validation
from mavhums_sim.ema import EmaParameters
from mavhums_sim.energy import energy_balance
from mavhums_sim.validation import CHECKS, Check, validate

ONE = EmaParameters.from_data_sheet()


def test_every_check_passes() -> None:
    checks = list(validate())
    assert len(checks) > 30
    assert [check for check in checks if not check.passed] == []


@pytest.mark.parametrize(
    ("model", "wrong", "fails"),
    [
        ("one mass", {"torque_per_ampere": 4.4}, "nominal current"),
        ("one mass", {"resistance": 23.0}, "stall torque"),
        ("two masses", {"slew_limit": 1.7}, "no-load speed"),
        ("two masses", {"stroke": 1.0}, "output stroke"),
        ("one mass", {"supply_voltage": 26.0}, "supply voltage"),
    ],
)
def test_another_actuator_is_not_the_data_sheets(
    model: str, wrong: dict[str, float], fails: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    nominal = ONE if model == "one mass" else ONE.two_masses()
    monkeypatch.setitem(validation._MODELS, model, replace(nominal, **wrong))  # type: ignore[arg-type]
    assert any(not check.passed and fails in check.name and model in check.name for check in CHECKS[0]())


@pytest.mark.parametrize("parameters", [ONE, ONE.two_masses()])
def test_energy_is_accounted_for_item_by_item(parameters: EmaParameters) -> None:
    balance = energy_balance(parameters, 0.5)
    assert abs(balance.residual) < 1e-3 * balance.supplied
    assert min(balance.copper, balance.friction, balance.supplied) > 0
    assert (balance.gear > 0) == (parameters.gearbox is not None)


def test_check_compares_with_its_tolerance() -> None:
    assert Check("", 1.0, 1.09, "", 0.1).passed
    assert not Check("", 1.0, 1.11, "", 0.1).passed
    assert not Check("", 1.0, np.nan, "", 0.1).passed
