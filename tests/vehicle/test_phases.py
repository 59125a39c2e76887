"""Phases of a flight: what is evidence of flight, what is none, and that blocks do not matter."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mavhums.core.arrays import Array
from mavhums.vehicle.grid import RATE_HZ, Seconds
from mavhums.vehicle.phases import CONTACT, LANDING, TAKE_OFF, PhaseEvent, PhaseRows, Phases
from mavhums.vehicle.rotors import Rotors
from tests.vehicle.tables import seconds_of

NAN = np.nan
MOTOR = Rotors("one motor", (1,), ((1.0, 1.0, 1.0),), (0.0,), 1000.0, 2000.0, 0.0)


def seconds(**signals: Any) -> Seconds:
    """Return seconds, each signal of one value a second; what is not given is not known."""
    found = seconds_of(len(next(iter(signals.values()))), attitude=0.0, rates=0.0)
    for name, values in signals.items():
        where, column = {"armed": ("state", 2), "climb": ("velocity", 2)}.get(name, (name, 0))
        found.signals[where][:, :, column] = np.asarray(values)[:, None]
    return found


def followed(flown: Seconds, thrust: Any, block: int = 1000) -> tuple[Array, list[PhaseEvent], PhaseRows]:
    """Follow a flight whose one motor is asked for a thrust, second by second."""
    phases = Phases()
    flown.signals["outputs"][:, :, 0] = 1000 + 1000 * np.asarray(thrust, dtype=float)[:, None]
    parts = [phases.feed(flown.part(k, k + block), MOTOR) for k in range(0, len(flown.index), block)]
    airborne = np.concatenate([part.airborne for part in parts])[::RATE_HZ]
    return airborne, [event for part in parts for event in part.events], parts[-1]


@pytest.mark.parametrize(
    ("signals", "thrust", "flies"),
    [
        ({"altitude": 1.0}, 0.2, True),  # a hover at knee height
        ({"altitude": 30.0}, NAN, True),
        ({"climb": -1.0}, NAN, True),
        ({"groundspeed": 15.0}, NAN, True),  # a wing
        ({}, 0.3, True),  # nothing else is recorded
        ({"altitude": 30.0, "armed": 0.0}, 0.2, False),  # the altitude takes another origin
        ({"altitude": 0.0}, 0.2, False),
        ({"altitude": 0.0, "landed": 2.0}, 0.13, False),  # motors on the ground, a detector of a manual mode
        ({"altitude": 1.0}, 0.01, False),  # a barometer in the wash, without throttle
        ({"landed": 1.0}, 0.3, False),
        ({"groundspeed": 3.0}, NAN, False),
        ({}, NAN, False),
    ],
)
def test_each_evidence_has_its_trust(signals: dict[str, float], thrust: float, flies: bool) -> None:
    at_rest = np.arange(30) < 10
    values = {k: np.where(at_rest, 0.0 if k == "altitude" else NAN, v) for k, v in signals.items()}
    airborne, events, _ = followed(seconds(attitude=np.zeros(30), **values), np.where(at_rest, 0.0, thrust))
    assert airborne[15:].all() == flies == bool(events)
    assert not airborne[: 10 if flies else 30].any()


def test_the_hover_is_that_of_level_flight_and_blocks_do_not_matter() -> None:
    """A climb at 0.76, a hover at 0.46, a landing: the climb is no hover."""
    climbs, hovers = slice(5, 15), slice(15, 60)
    altitude, climb, thrust = np.zeros((3, 70))
    altitude[climbs], altitude[hovers] = np.arange(1, 11), 10.0
    climb[climbs], thrust[climbs], thrust[hovers] = -1.0, 0.76, 0.46
    flown = seconds(altitude=altitude, climb=climb)
    airborne, events, rows = followed(flown, thrust)
    assert [event.kind for event in events] == [TAKE_OFF, LANDING]
    assert events[0].time_s == pytest.approx(5, abs=1)
    assert events[1].time_s == pytest.approx(60, abs=1)
    assert np.nanmin(rows.hover) == pytest.approx(np.nanmax(rows.hover)) == pytest.approx(0.46)
    for block in (1, 7):
        cut = followed(flown, thrust, block)
        assert (cut[0].tolist(), cut[1]) == (airborne.tolist(), events)


@pytest.mark.parametrize(
    ("jump", "knocks"),
    [((3.0, -3.0, 0.5), False), ((4.0, 0.0, 0.0), True), ((0.0, 0.0, 1.1), True)],
    ids=["a motor stops", "knocked over", "turned"],
)
def test_a_jump_that_no_motor_makes_is_a_contact(jump: tuple[float, ...], knocks: bool) -> None:
    flown = seconds(altitude=np.full(20, 5.0))
    flown.signals["rates"][12, 5:] = jump
    flown.signals["rates"][13:] = jump
    for block in (1, 1000):
        _, events, _ = followed(flown, np.full(20, 0.4), block)
        contacts = [event for event in events if event.kind == CONTACT]
        assert contacts == ([PhaseEvent(CONTACT, 12.25)] if knocks else [])


@pytest.mark.parametrize(("off_deg", "rate", "rows", "held"), [
    (10.1, 0.149, 20, True), (10.1, 0.149, 100, True),
    (9.9, 0.149, 20, False), (10.1, 0.151, 20, False), (10.1, 0.149, 19, False),
])  # fmt: skip
def test_what_holds_the_craft_for_a_second_is_a_contact(
    off_deg: float, rate: float, rows: int, held: bool
) -> None:
    flown = seconds(altitude=np.zeros(12))
    flat = flown.signals["attitude"].reshape(-1, 3)
    flat[10 : 10 + rows, 1] = -np.radians(off_deg)
    flown.signals["demand"][:], flown.signals["rates"][:, :, 2] = 0.0, -rate
    _, _, found = followed(flown, np.full(12, 0.4))
    until = 10 + rows - 1 + 3 * RATE_HZ
    assert np.flatnonzero(found.held).tolist() == ([*range(29, until + 1)] if held else [])
