"""The list of a flight's events: what is on it, what is not, and that it is bounded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mavhums.app.analysis import analyse
from mavhums.results.sections import FlightEvent
from mavhums.vehicle.events import FlightEvents, VehicleEvents
from tests.conftest import CARRIED
from tests.vehicle.test_phases import seconds

NAN = np.nan
FLIGHT = np.r_[np.zeros(10), np.linspace(0, 20, 10), np.full(40, 20.0)]
"""Altitude, m: 10 s on the ground, a climb, a hover at 20 m."""


def flown(altitude: Any = FLIGHT, kind: float = 2.0, **others: Any) -> VehicleEvents:
    """Return the events of a vehicle of a MAV_TYPE that was there, seen in two blocks."""
    events, of_seconds = VehicleEvents(1), seconds(altitude=altitude, **others)
    of_seconds.signals["state"][:, :, 0] = kind
    for part in (of_seconds.part(0, 17), of_seconds.part(17, len(altitude))):
        events.feed(part)
    return events


def kinds(events: VehicleEvents, *, rotors: bool = True) -> list[str]:
    found = sorted(events.events(rotors=rotors), key=lambda event: event.time_s)
    return [event.kind for event in found]


def test_a_flight_has_its_events_in_order() -> None:
    armed = np.where(np.arange(70) < 5, 0.0, np.where(np.arange(70) < 66, 1.0, 0.0))
    events = flown(np.r_[FLIGHT, np.zeros(10)], armed=armed)
    events.finish()
    assert kinds(events) == ["armed", "take_off", "landing", "disarmed"]


@pytest.mark.parametrize(
    ("altitude", "kind", "others", "expected"),
    [
        (FLIGHT, 2, {}, ["take_off", "ends_in_air"]),
        (FLIGHT[10:], 2, {}, ["begins_in_air", "ends_in_air"]),
        (FLIGHT[10:], 2, {"landed": np.r_[1.0, np.full(49, 2.0)]}, ["take_off", "ends_in_air"]),
        (FLIGHT, 10, {}, []),  # a rover on a hill
        (np.r_[np.zeros(20), np.full(20, 1.5), np.zeros(20)], 1, {}, []),  # a barometer that drifts
        (np.r_[FLIGHT, np.zeros(2)], 2, {}, ["take_off"]),  # it has come down, and no more is certain
    ],
    ids=["ends", "begins", "begins on the ground", "rover", "drift", "just landed"],
)
def test_where_the_log_begins_and_ends(
    altitude: Any, kind: float, others: dict[str, Any], expected: list[str]
) -> None:
    events = flown(altitude, kind, **others)
    assert "ends_in_air" not in kinds(events), "the log goes on"
    events.finish()
    assert kinds(events) == expected


@pytest.mark.parametrize(
    ("kind", "airspeed", "ends"),
    [(1, 0.5, "landing"), (1, 14.0, "ends_in_air"), (2, 0.5, "ends_in_air")],
    ids=["wing", "against the wind", "copter"],
)
def test_a_wing_that_does_not_move_has_landed_however_high(kind: float, airspeed: float, ends: str) -> None:
    """It lands 20 m above its take-off and rests for ten seconds; a copter would hover there."""
    speed = np.r_[np.zeros(10), np.full(50, 15.0), np.full(10, 0.5)]
    through_air = np.where(np.arange(70) < 60, speed, airspeed)
    altitude = np.r_[FLIGHT, np.full(10, 20.0)]
    events = flown(altitude, kind, groundspeed=speed, airspeed=through_air)
    events.finish()
    assert kinds(events) == ["take_off", ends]


@pytest.mark.parametrize(("kind", "sinks_m_s", "hits"), [(1, 2.5, True), (1, 1.5, False), (2, 2.5, False)])
def test_a_wing_that_sinks_until_it_is_at_rest_hits_the_ground(
    kind: float, sinks_m_s: float, hits: bool
) -> None:
    speed = np.r_[np.zeros(10), np.full(50, 15.0), np.full(15, 0.5)]
    altitude = np.r_[FLIGHT, np.full(15, 0.0)]
    altitude[40:60] = sinks_m_s * np.arange(20, 0, -1)
    events = flown(altitude, kind, groundspeed=speed)
    impacts = [one for one in events.events(rotors=False) if one.kind == "impact"]
    assert [(one.time_s, one.value) for one in impacts] == ([(61.0, 3 * sinks_m_s)] if hits else [])


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("failsafe", "Throttle failsafe on"),
        ("", "Throttle failsafe off"),
        ("failsafe", "Radio Failsafe - Disarming"),
        ("", "Radio Failsafe Cleared"),
        ("failsafe", "[failsafe] Failsafe activated"),
        ("", "PreArm: Battery failsafe"),
        ("", "Flight mode change failed"),
        ("crash", "Crash: Disarming: AngErr=160>30"),
        ("", "crash check disabled"),
    ],
)
def test_a_failsafe_and_a_crash_are_what_the_vehicle_says(kind: str, text: str) -> None:
    events = VehicleEvents(1)
    events.hear_text(3.0, text)
    found = [(one.kind, one.time_s, one.said) for one in events.events(rotors=False)]
    assert found == [(kind, 3.0, text)] * bool(kind)


@pytest.mark.parametrize(
    ("until", "step", "missing"),
    [(30.0, 0.1, True), (55.0, 0.1, False), (30.0, 2.0, False), (12.0, 1.0, False)],
    ids=["ends", "of late", "of a slow source", "too few to know"],
)
def test_a_source_that_ends_in_flight(until: float, step: float, missing: bool) -> None:
    events, times = flown(), np.arange(0, until, step)
    for part in np.array_split(times, 3):
        events.hear_source("ESC 2", part)
    found = [event for event in events.events(rotors=True) if event.kind == "telemetry_ends"]
    assert [one.subject for one in found] == ["ESC 2"] * missing
    assert [one.value for one in found] == pytest.approx([60 - times[-1]] * missing, abs=0.1)


@pytest.mark.parametrize(
    ("below", "mode", "off_deg", "found"),
    [("stays", 15, 3.0, [47.0]), ("follows", 15, 3.0, []), ("stays", 5, 3.0, []), ("stays", 15, 20.0, [])],
    ids=["engine out", "descends", "a pilot descends", "turned over"],
)
def test_a_wing_that_sinks_below_its_demand(
    below: str, mode: int, off_deg: float, found: list[float]
) -> None:
    """It holds 100 m for 40 s, and then sinks at 1.2 m/s."""
    sunk = np.clip(np.arange(60) - 40, 0, None) * 1.2
    of_seconds = seconds(altitude=100 - sunk, groundspeed=np.full(60, 15.0), demand=np.zeros(60))
    of_seconds.signals["state"][:] = (1, 3, 1, mode)
    of_seconds.signals["demand"][:] = np.radians(off_deg)
    of_seconds.signals["altitude error"][:, :, 0] = (sunk if below == "stays" else 0 * sunk)[:, None]
    events = VehicleEvents(1)
    for second in range(60):
        events.feed(of_seconds.part(second, second + 1))
    assert [e.time_s for e in events.events(rotors=False) if e.kind == "altitude_loss"] == found
    assert [e.kind for e in events.events(rotors=True) if e.kind == "altitude_loss"] == []


def test_a_jump_of_the_clock_counts_in_flight_alone() -> None:
    events = flown()
    events.add("reboot", 3.0)
    events.add("reboot", 40.0)
    assert [e.time_s for e in events.events(rotors=True) if e.kind == "reboot"] == [40.0]


def test_a_rail_that_sags_after_the_landing_was_switched_off() -> None:
    events = flown(np.r_[FLIGHT, np.zeros(10)])
    [landing] = [one.time_s for one in events.events(rotors=True) if one.kind == "landing"]
    time_s = np.arange(0.0, landing + 20.0, 0.5)
    low = (np.abs(time_s - landing + 20.0) < 1.5) | (time_s > landing + 5.0)
    events.rail.feed(time_s, np.where(low, 3.2, 5.1))
    (sag,) = [event for event in events.events(rotors=True) if event.kind == "supply"]
    assert sag.time_s == pytest.approx(landing - 21.0, abs=0.5)
    assert sag.value == 3.2


def test_a_contact_brings_a_copter_down() -> None:
    """Neither a touch-down, nor what a copter that flies on felt, nor what a wing did."""
    events = flown(np.r_[FLIGHT, np.zeros(10)])
    [landing] = [one.time_s for one in events.events(rotors=True) if one.kind == "landing"]
    for time_s in (landing - 30.0, landing - 5.0, landing - 1.0):
        events.add("contact", time_s)
    found = [[e.time_s for e in events.events(rotors=r) if e.kind == "contact"] for r in (True, False)]
    assert found == [[landing - 5.0], []]


def test_the_list_is_bounded_and_what_is_left_out_is_counted() -> None:
    events = FlightEvents()
    for k in range(250):
        events.of(1).add("mode", float(k), said=str(k))
        events.of(1).hear_source(f"servo {k}", np.array([float(k)]))
    found, left_out = events.gathered(frozenset())
    assert (len(found), found[0].said, left_out) == (100, "0", 150)
    assert events.gathered(frozenset(), {1}) == ((), 250)


def test_the_events_of_a_flight_are_in_words() -> None:
    from mavhums.show.event_words import event_lines, foremost

    assessment = analyse(CARRIED / "healthy.tlog")
    assert event_lines(assessment)[2:4] == ["12.0s: take-off", "25.3s: flight mode LOITER"]
    assert foremost(assessment) == ["2m30s: the log ends in flight"]
    more = (FlightEvent(kind="failsafe", vehicle=1, time_s=float(k), said="{x} <b>") for k in range(3))
    assessment = assessment.model_copy(update={"events": (*assessment.events, *more)})
    assert foremost(assessment)[0] == '0.0s: failsafe: the vehicle reports "{x} <b>" (and 2 more such events)'
