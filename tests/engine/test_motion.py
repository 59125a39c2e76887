"""Which outputs move alike, which one stands alone, which are inferred; how many vehicles are judged."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mavhums.engine import motion
from mavhums.engine.axes import MOST_VEHICLES, VehicleLimit
from mavhums.engine.motion import _alike, _alone, inferred
from mavhums.log import Table
from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import Demands, SurfaceOutput
from tests.health.axis.flights import Array, excited, rows, steady


def test_outputs_are_alike_where_both_are_known_and_it_flies() -> None:
    """Output 3 mirrors output 1, output 2 does not; on the ground and where one is off nothing counts."""
    rng = np.random.default_rng(1)
    pulses = 1500 + 100 * rng.standard_normal((200, 4))
    pulses[:, 2] = 3000 - pulses[:, 0]
    pulses[50:60, 2], pulses[100:, 2] = np.nan, 1500.0
    rows: Any = SimpleNamespace(flying=np.arange(200) < 100)
    assert _alike(rows, pulses, 1, 3)
    assert _alike(rows, pulses, 3, 1)
    assert _alike(rows, pulses, 2, 2)
    assert not _alike(rows, pulses, 1, 2)
    assert not _alike(rows, pulses, 3, 4)
    rows.flying[:] = True
    assert not _alike(rows, pulses, 1, 3)


def test_an_output_that_stands_a_second_while_its_group_moves_shows_no_demand() -> None:
    pulses = np.tile(1500.0 + 10 * np.arange(60)[:, None], (1, 4))
    pulses[20:45, 1] = 1600.0
    group = [SurfaceOutput(servo, "aileron", 1500, 400) for servo in (2, 3)]
    middle = float(np.median(pulses[:, 1]))
    found = _alone(pulses, 1, group)
    assert np.flatnonzero(np.isnan(found)).tolist() == [*range(40, 45)]
    known = np.isfinite(found)
    demand = (pulses[:, 1] - middle)[known]
    np.testing.assert_allclose(found[known] * demand[0] / found[0], demand)
    assert np.isfinite(_alone(pulses, 3, group)).all(), "it is of no group"
    assert np.isfinite(_alone(pulses, 1, group[:1])).all(), "nothing else moves"


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
    monkeypatch.setattr(motion, "explained_by", lambda axis, *_: explained[axis])
    flight, sent = flown()
    found = inferred(flight, sent)
    assert found is not None
    assert {moved.servo for moved in found.of_axis("roll")} == {4, 5, 6}
    whole = Demands(found).feed(sent)[:, 0]
    stuck = sent.copy()
    stuck[600:, 4] = stuck[600, 4]  # servo 5 is overridden
    rest = Demands(found).feed(stuck)[:, 0]
    assert rest[700:] == pytest.approx(whole[700:], abs=0.01)


@pytest.mark.parametrize(
    ("changes", "roll", "pitch"),
    [
        ({}, {4, 5, 6}, ()),
        ({"roll": 0.61}, {4, 5, 6}, ()),
        ({"roll": 0.59}, None, ()),
        ({"second": 0.79}, {4, 5, 6}, ()),  # it leaves 0.21, twice as much as the 0.1 of the best
        ({"second": 0.81}, None, ()),
        ({"mixed": 0.39}, {4, 5, 6}, ()),
        ({"mixed": 0.41}, None, ()),
        ({"pitch": 0.36}, {4, 5, 6}, {8}),
        ({"pitch": 0.34}, {4, 5, 6}, ()),
        ({"pitch": 0.5, "other pitch": 0.24}, {4, 5, 6}, {8}),
        ({"pitch": 0.5, "other pitch": 0.26}, {4, 5, 6}, ()),
    ],
)
def test_an_inference_is_the_only_one_that_the_flight_allows(
    changes: dict[str, float], roll: set[int] | None, pitch: set[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Servos 4 to 6 move as one; servos 8 and 9 by themselves, servo 10 too little."""
    shares = {"roll": 0.9, "second": 0.0, "mixed": 0.0, "pitch": 0.0, "other pitch": 0.0} | changes
    flight, sent = flown()
    time_s = np.arange(len(sent)) / 20
    own = {8: 300 * np.sin(0.7 * time_s), 9: 300 * np.sin(1.9 * time_s), 10: 12 * np.sin(time_s)}
    for servo, moved in own.items():
        sent[:, servo - 1] = 1500 + moved

    def explained(axis: str, _: Rows, demand: Array, others: Array) -> tuple[float, float]:
        which = next((servo for servo in own if abs(np.corrcoef(own[servo], demand)[0, 1]) > 0.99), 0)
        assert which != 10, "its standard deviation is below 10 µs"
        names = {"roll": {0: "roll", 8: "second", 9: ""}, "pitch": {0: "", 8: "pitch", 9: "other pitch"}}
        return shares.get(names[axis][which], 0.0), shares["mixed"] if others.shape[1] else 0.0

    monkeypatch.setattr(motion, "explained_by", explained)
    found = inferred(flight, sent)
    assert (found is None) == (roll is None)
    if found is not None:
        assert {one.servo for one in found.of_axis("roll")} == roll
        assert {one.servo for one in found.of_axis("pitch")} == set(pitch)


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
    assert not limit.admits(None)
