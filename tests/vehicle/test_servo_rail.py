"""The rail that feeds the servos: what a sag is, and that it comes first where it explains an alarm."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.health.verdict import with_advice, with_supply
from mavhums.log import Table
from mavhums.results.verdict import Candidate, Evidence, Verdict
from mavhums.vehicle.reported import Sag, ServoRails

TIME_US = np.arange(600, dtype=np.int64) * 100_000
VOLTS = 5.1 + 0.1 * np.sin(TIME_US)
VOLTS[300:360] = 3.2
VOLTS[100] = 0.0  # one reading is noise


@pytest.mark.parametrize("cuts", [[], [1], [300], [301, 302, 330, 360], list(range(1, 600))])
def test_a_rail_that_sags_is_found_whatever_the_blocks(cuts: list[int]) -> None:
    rails, begun = ServoRails(), list[tuple[int, Sag]]()
    for rows in np.split(np.arange(600), cuts):
        fields = np.array([(volts,) for volts in VOLTS[rows]], dtype=[("VServo", "f8")])
        byte = np.ones(rows.size, dtype=np.uint8)
        begun += rails.feed({"POWR": Table("POWR", rows, TIME_US[rows], byte, byte, byte, 0 * byte, fields)})
    assert [(vehicle, sag.start_us) for vehicle, sag in begun] == [(1, 30_000_000)]
    deepest = rails.lowest[1]
    assert (deepest.start_us, deepest.end_us) == (30_000_000, 35_900_000)
    assert deepest.least_v == pytest.approx(3.2)


@pytest.mark.parametrize(("alarm_s", "first"), [(31.0, "servo rail"), (10.0, "elevator")])
def test_a_rail_that_sags_comes_before_the_surfaces_that_it_feeds(alarm_s: float, first: str) -> None:
    found = Evidence(kind="tracking", start_s=alarm_s, end_s=alarm_s + 4.0, value=9.0, rule="emergency: away")
    axis = Verdict(
        subject="axis", vehicle=1, actuator="pitch", condition="emergency", worst="emergency",
        evidence=(found,), candidates=(Candidate(surface="elevator", servo=2),),
    )  # fmt: skip
    verdict = with_advice(with_supply(axis, Sag(30_000_000, 36_000_000, 3.2, 5.1), 0))
    assert verdict.candidates[0].surface == first
    assert ("servo rail first" in (verdict.advice or "")) == (first == "servo rail")
