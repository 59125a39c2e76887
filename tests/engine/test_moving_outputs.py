"""Which outputs are inferred, and how many vehicles are judged."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.engine import moving_outputs
from mavhums.engine.axes import MOST_VEHICLES, VehicleLimit
from mavhums.engine.moving_outputs import inferred
from mavhums.log import Table
from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import Demands
from tests.health.axis.flights import Array, excited, rows, steady


def flown(seconds: int = 60) -> tuple[Rows, Array]:
    """A flight that rolls by servo 5, with servo 6 reversed and servo 4 at half the travel."""
    flight = steady(seconds)
    demand = excited(seconds)
    flight["roll_rate"] = 2.2 * demand
    sent = np.full((len(demand), OUTPUTS), np.nan)
    sent[:, 3:6] = np.array([1500, 1500, 1520]) + np.outer(demand, [200, 400, -400])
    return rows(flight), sent


def test_inferred_outputs_give_one_demand_whatever_their_travel(monkeypatch: pytest.MonkeyPatch) -> None:
    explained = {"roll": (0.9, 0.0), "pitch": (0.0, 0.0)}
    monkeypatch.setattr(moving_outputs, "explained_by", lambda axis, *_: explained[axis])
    flight, sent = flown()
    found = inferred(flight, sent)
    assert found is not None
    assert {moved.servo for moved in found.of_axis("roll")} == {4, 5, 6}
    whole = Demands(found).feed(sent)[:, 0]
    stuck = sent.copy()
    stuck[600:, 4] = stuck[600, 4]  # servo 5 is overridden
    rest = Demands(found).feed(stuck)[:, 0]
    assert rest[700:] == pytest.approx(whole[700:], abs=0.01)


def table(*systems: int, name: str = "A", first: int = 0, step: int = 1) -> dict[str, Table]:
    n = len(systems)
    byte = np.zeros(n, dtype=np.uint8)
    frame = first + step * np.arange(n)
    fields = np.zeros(n, dtype=[("x", "u1")])
    return {name: Table(name, frame, frame, np.array(systems, dtype=np.uint8), byte, byte, byte, fields)}


@pytest.mark.parametrize("size", [1, 7, 100])
def test_the_first_vehicles_are_judged_in_the_order_of_the_log(size: int) -> None:
    """Vehicles 200, 199, … come by turns in two messages; one that describes no actuator takes no place."""
    systems = [200 - k for k in range(MOST_VEHICLES + 5)]
    limit = VehicleLimit(["A", "B"])
    assert limit.admits(7)
    for k in range(0, MOST_VEHICLES + 5, size):
        part = systems[k : k + size]
        even = table(*part[::2], name="A", first=2 * k, step=4)
        odd = table(*part[1::2], name="B", first=2 * k + 2, step=4)
        limit.observe({**odd, **even, **table(1, name="C", first=0)})
    assert [one for one in (1, 250, *systems) if limit.admits(one)] == systems[:MOST_VEHICLES]
