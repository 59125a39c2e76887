"""The cyclograms: seeded, within the travel, and moving as much as they say."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums_sim import Flight, fly
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.manoeuvres import CYCLOGRAMS

# As docs/method/simulator.md states them: moving fraction from…to, peak hinge moment from…to in N·m.
STATED = {
    "preflight": ((0.12, 0.24), (0.0, 0.0)),
    "takeoff": ((0.90, 1.00), (1.8, 3.5)),
    "cruise": ((0.40, 0.70), (0.3, 1.2)),
    "turns": ((0.80, 0.97), (1.2, 3.5)),
    "gusts": ((0.94, 1.00), (2.2, 4.2)),
    "landing": ((0.75, 0.90), (0.7, 2.2)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CYCLOGRAMS)
@pytest.mark.parametrize("seed", [0, 1])
def test_cyclogram_moves_and_loads_as_stated(name: str, seed: int) -> None:
    moving, load = STATED[name]
    for record in fly(Flight(seed=seed, cyclogram=name)).actuators.values():
        assert moving[0] <= record.motion.moving_fraction <= moving[1]
        assert load[0] <= np.abs(record.motion.load).max() <= load[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", CYCLOGRAMS)
def test_cyclogram_depends_on_its_seed(name: str) -> None:
    one, again, other = (CYCLOGRAMS[name](seed, 20.0) for seed in (3, 3, 4))
    for surface in SURFACES:
        np.testing.assert_array_equal(one.commands[surface], again.commands[surface])
        assert not np.array_equal(one.commands[surface], other.commands[surface])
        assert np.abs(np.degrees(one.commands[surface])).max() <= 25.0
    assert one.time_s.size == one.airspeed.size == one.altitude.size == 20_000
    assert one.altitude.min() >= 0.0


@pytest.mark.parametrize("name", CYCLOGRAMS)
@pytest.mark.parametrize("duration_s", [1.0, 7.3])
def test_short_flights_are_whole(name: str, duration_s: float) -> None:
    flown = CYCLOGRAMS[name](0, duration_s)
    assert all(np.isfinite(command).all() for command in flown.commands.values())
    assert flown.time_s[-1] == pytest.approx(duration_s)


def test_surfaces_are_checked_one_at_a_time() -> None:
    flown = CYCLOGRAMS["preflight"](0, 100.0)
    moving = sum((np.diff(command) != 0).astype(int) for command in flown.commands.values())
    assert np.max(moving) == 1


def test_given_cyclogram_is_flown_as_far_as_asked() -> None:
    given = CYCLOGRAMS["turns"](0, 5.0)
    record = fly(Flight(duration_s=2.0, cyclogram=given))
    np.testing.assert_array_equal(record.actuators["rudder"].motion.command, given.commands["rudder"][:2000])
    with pytest.raises(ValueError, match="lasts 5 s, less than 6 s"):
        Flight(duration_s=6.0, cyclogram=given)
