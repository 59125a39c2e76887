"""Which outputs are inferred, and how many vehicles are judged."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.engine.axes import MOST_VEHICLES, VehicleLimit
from mavhums.log import Table


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
