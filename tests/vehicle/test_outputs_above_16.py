"""Outputs 17 to 32, which come in a second or third message, move surfaces as the others do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.vehicle.facts import ALL_OUTPUTS, OUTPUTS, Signal
from mavhums.vehicle.flight import Flight
from mavhums.vehicle.grid import RATE_HZ, Grid
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import of_parameters
from tests.present import present

SECONDS, RATE = 8, 25
N = SECONDS * RATE


def signal(name: str, width: int, values: NDArray[np.float64] | float, servo: int, late: int) -> Signal:
    """Return a stream of one output; of a pair of messages each comes every second time."""
    pulses = np.full((N, width), np.nan)
    pulses[:, servo - 1] = values
    return Signal(1, name, name, 2 * np.arange(N) + late, np.arange(N) * 1_000_000 // RATE, pulses)


@pytest.mark.parametrize(("bank", "alone"), [("outputs_2", False), ("outputs_2", True), ("outputs_3", False)])
def test_a_surface_on_output_20_is_followed(bank: str, alone: bool) -> None:
    values = {"SERVO20_FUNCTION": 19.0, "SERVO20_MIN": 1000.0, "SERVO20_MAX": 2000.0, "SERVO20_TRIM": 1500.0}
    surfaces = present(of_parameters(Parameters(1, False, values)))
    moving = signal(bank, ALL_OUTPUTS, 1500 + 300 * np.sin(np.arange(N) / 20), 20, late=1)
    first = [] if alone else [signal("outputs", OUTPUTS, 1100.0, 4, late=0)]
    flight = Flight(surfaces)
    rows = list(flight.feed(present(Grid(0).feed([*first, moving], final=True))))
    assert "outputs" in flight.heard
    demand = np.concatenate([each.demand("pitch") for each in rows])
    assert np.isfinite(demand).sum() >= (SECONDS - 1) * RATE_HZ
    assert (np.nanmin(demand), np.nanmax(demand)) == pytest.approx((-0.6, 0.6), abs=0.02)
