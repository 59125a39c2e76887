"""Forward flight row by row, what lifts a vehicle, and airspeeds: a case on each side of every condition."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mavhums.vehicle.airspeed import WindTriangle
from mavhums.vehicle.flight import SPEEDS, Flight
from mavhums.vehicle.grid import RATE_HZ, Seconds
from mavhums.vehicle.identity import Identity
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.surfaces import SurfaceOutput, Surfaces, of_parameters
from mavhums.vehicle.vtol import hovers, lift_of, refined_identity, turns_its_motors
from tests.present import present
from tests.vehicle.tables import seconds_of

PLANE, COPTER, ROVER, BOAT, QUADPLANE = 1.0, 2.0, 10.0, 11.0, 22.0
ARDUPILOT, PX4 = 3.0, 12.0
AUTO, MANUAL, QHOVER, QACRO = 10.0, 0.0, 18.0, 23.0


def seconds(count: int, first: int = 0, **changes: Any) -> Seconds:
    """Return seconds of a plane that flies north at 15 m/s, but for the changes."""
    level: dict[str, Any] = {"airspeed": 15.0, "groundspeed": 15.0, "velocity": [15.0, 0.0, 0.0]}
    level |= {"attitude": 0.0, "rates": 0.0, "state": [PLANE, ARDUPILOT, 1.0, AUTO], "force": 0.0}
    level |= {"demand": [0.1, 0.2]} | changes
    return seconds_of(count, first, **level)


def flown(*parts: Seconds, surfaces: Surfaces | None = None) -> Flight:
    flight = Flight(surfaces)
    for part in parts:
        list(flight.feed(part))
    return flight


@pytest.mark.parametrize(
    ("changes", "counts", "why"),
    [
        ({}, True, ""),
        ({"airspeed": 8.1}, True, ""),
        ({"airspeed": 8.0}, False, ""),
        ({"airspeed": 5.0}, True, ""),  # a dead sensor: the triangle of the velocities answers
        ({"state": [PLANE, ARDUPILOT, 0.0, AUTO]}, False, ""),
        ({"state": [PLANE, ARDUPILOT, np.nan, AUTO]}, False, ""),
        ({"state": [COPTER, ARDUPILOT, 1.0, AUTO]}, False, "vtol"),
        ({"state": [QUADPLANE, ARDUPILOT, 1.0, AUTO]}, False, "vtol"),
        ({"state": [QUADPLANE, PX4, 1.0, AUTO], "vtol": 4.0}, True, ""),
        ({"state": [19.0, PX4, 1.0, AUTO], "vtol": 4.0}, True, ""),
        ({"state": [25.0, PX4, 1.0, AUTO], "vtol": 4.0}, True, ""),
        ({"state": [QUADPLANE, PX4, 1.0, AUTO], "vtol": 1.0}, False, "vtol"),
        ({"vtol": 3.0}, False, "vtol"),
        ({"vtol": 0.0}, True, ""),
        ({"vtol": 4.0}, True, ""),
        *(({"state": [PLANE, ARDUPILOT, 1.0, mode]}, False, "mode") for mode in (17.0, 22.0, 23.0, 25.0)),
        ({"state": [PLANE, ARDUPILOT, 1.0, 24.0]}, True, ""),
        ({"state": [PLANE, PX4, 1.0, 18.0]}, True, ""),
        ({"landed": 1.0}, False, "ground"),
        ({"landed": 2.0}, True, ""),
        ({"groundspeed": 5.0}, False, "slow"),
        ({"groundspeed": 5.1}, True, ""),
        ({"groundspeed": np.nan}, True, ""),
    ],
)
def test_what_counts_as_forward_flight(changes: dict[str, Any], counts: bool, why: str) -> None:
    flight = flown(seconds(10, **changes))
    # Three seconds without a break come before: their last row is the first that counts.
    assert flight.flown_s == (7 if counts else 0)
    for reason in ("vtol", "mode", "ground", "slow"):
        assert flight.lasted_s(reason) == (10.0 if reason == why else 0.0)
    fast = counts or bool(why)
    assert flight.lasted_s("fast") == (10.0 if fast else 0.0)


@pytest.mark.parametrize(
    ("kind", "speed", "counts"),
    [(ROVER, 0.6, True), (ROVER, 0.5, False), (BOAT, 0.6, True), (BOAT, 0.5, False), (ROVER, -3.0, False)],
)
def test_driving_forward_is_measured_along_the_heading(kind: float, speed: float, counts: bool) -> None:
    course: dict[str, Any] = {"attitude": [0.0, 0.0, np.pi / 2], "velocity": [0.0, speed, 0.0]}
    course |= {"airspeed": np.nan, "groundspeed": abs(speed)}
    drive = seconds(10, state=[kind, ARDUPILOT, 1.0, AUTO], **course)
    flight = flown(drive)
    assert flight.on_ground
    assert flight.flown_s == (7 if counts else 0)
    assert flight.fastest == pytest.approx(max(speed, 0.0))
    still = flown(seconds(10, state=[kind, ARDUPILOT, 0.0, AUTO], **course))
    assert (still.flown_s, still.fastest) == (0, 0.0)


@pytest.mark.parametrize(
    ("changes", "speed"),
    [
        ({}, 0),
        ({"airspeed": np.nan}, 1),
        ({"airspeed": np.nan, "velocity": np.nan}, 2),
        ({"state": [ROVER, ARDUPILOT, 1.0, AUTO]}, 2),
        ({"state": [BOAT, ARDUPILOT, 1.0, AUTO]}, 3),
    ],
)
def test_rows_separate_speeds_and_rates_of_every_source(changes: dict[str, Any], speed: int) -> None:
    flight, ranks = seconds(4, **changes), np.array([0, 1, 2, 1])
    flight.ranks["rates"][:] = ranks
    followed = Flight(None)
    [rows] = followed.feed(flight)
    assert followed.settled_s == (0 if speed == 1 else followed.flown_s), "no turn has shown the wind"
    rank, source = np.divmod(rows.sources.reshape(4, RATE_HZ), SPEEDS)
    assert (source == speed).all()
    assert (rank == ranks[:, np.newaxis]).all()


def test_breaks_spacings_and_what_was_heard() -> None:
    flight = flown(seconds(5), seconds(5, first=5), seconds(5, first=11))
    assert flight.flown_s == 7 + 2, "a gap begins the three seconds again"
    assert flight.lasted_s("armed") == 15.0
    assert (flight.fastest, flight.doubted_s, flight.parted_s) == (15.0, 0, 0.0)
    assert (flight.kinds, flight.autopilots, flight.on_ground) == ({1}, {3}, False)
    assert flight.heard >= {"airspeed", "velocity", "attitude", "rates"}
    assert not flight.heard & {"outputs", "outputs_2", "vtol"}
    assert flight.rate_hz("rates") == pytest.approx(10.0, rel=0.01)
    assert flight.used_s("speed") == {0: 9}
    assert flight.used_s("rates") == {0: 9}
    assert Flight(None).rate_hz("outputs") is None
    assert "outputs" in flown(seconds(1, outputs_2=1500.0)).heard


def test_each_column_of_a_row_is_its_own() -> None:
    given = {"rates": [1.0, 2.0, 3.0], "force": [4.0, 5.0, -9.80665], "attitude": [6.0, 7.0, 8.0]}
    [rows] = Flight(None).feed(seconds(1, first=9, **given))
    names = ["roll_rate", "pitch_rate", "yaw_rate", "side_force", "load", "roll", "pitch"]
    names += ["roll_demand", "pitch_demand", "speed"]
    found = [getattr(rows, name)[[0, -1]].tolist() for name in names]
    assert found == [[value] * 2 for value in (1.0, 2.0, 3.0, 5.0, -1.0, 6.0, 7.0, 0.1, 0.2, 15.0)]
    assert (rows.second, rows.fresh, rows.seconds) == (9, True, 1)
    assert np.isnan(rows.outputs).all()


def test_three_seconds_come_before_the_first_row_that_counts_and_after_each_break() -> None:
    """A break of one row in the fifth second, a gap of seconds, and a border of blocks."""
    part = seconds(14)
    part.signals["groundspeed"][4, 7] = 5.0
    flight = Flight(None)
    runs = [
        *flight.feed(replace(part, index=np.r_[0:9, 12:17])),
        *flight.feed(seconds(4, first=17)),
        *flight.feed(seconds(4, first=22)),
    ]
    assert [run.second for run in runs] == [0, 12, 17, 22]
    assert [(run.fresh, run.seconds) for run in runs] == [(True, 9), (True, 5), (False, 4), (True, 4)]
    first = 3 * RATE_HZ - 1
    expected = np.concatenate([np.arange(seconds * RATE_HZ) >= first for seconds in (9, 9, 4)])
    expected[4 * RATE_HZ + 7 : 4 * RATE_HZ + 7 + first + 1] = False
    assert np.concatenate([run.aloft for run in runs]).tolist() == expected.tolist()
    assert flight.lasted_s("slow") == 1 / RATE_HZ


def test_only_spacings_in_flight_count_and_the_middle_one_gives_the_rate() -> None:
    still, moving = seconds(20, state=[PLANE, ARDUPILOT, 0.0, AUTO]), seconds(10, first=20, outputs=1500.0)
    for signals in (still.signals, moving.signals):
        signals["outputs_spacing"][:] = 0.5 if signals is still.signals else 0.04
        signals["rates_spacing"][:] = signals["outputs_spacing"] / 2
    moving.signals["rates_spacing"][5] = np.nan
    flight = Flight(None)
    [_, rows] = [*flight.feed(still), *flight.feed(moving)]
    assert flight.rate_hz("outputs") == pytest.approx(1 / 0.0405)
    assert flight.rate_hz("rates") == pytest.approx(1 / 0.0205)
    assert np.unique(rows.spacing).tolist() == [0.04], "the longer one; of one that is unknown the other"


def test_who_only_steers_drives_even_where_the_kind_is_not_known() -> None:
    steering = Surfaces((SurfaceOutput(1, "steering", 1500, 400),), "parameters")
    course: dict[str, Any] = {"velocity": [1.0, 0.0, 0.0], "groundspeed": 1.0, "airspeed": np.nan}
    cases = (np.nan, steering, 7), (np.nan, None, 0), (ROVER, None, 7), (PLANE, steering, 0)
    for kind, surfaces, flown_s in cases:
        flight = flown(seconds(10, state=[kind, ARDUPILOT, 1.0, AUTO], **course), surfaces=surfaces)
        assert flight.flown_s == flown_s
        assert flight.on_ground == (surfaces is steering or kind == ROVER)


def test_a_kind_that_comes_late_lets_its_own_seconds_count() -> None:
    part = seconds(10, state=[ROVER, ARDUPILOT, 1.0, AUTO])
    part.signals["state"][:3, :, 0] = np.nan
    assert flown(part).flown_s == 4


def test_inferred_outputs_that_part_count_only_in_flight() -> None:
    pair = SurfaceOutput(1, "aileron", 1500, 400), SurfaceOutput(2, "aileron", 1500, 400)
    for armed, parted_s in ((1.0, 2.2), (0.0, 0.0)):
        part = seconds(8, state=[PLANE, ARDUPILOT, armed, AUTO])
        part.signals["outputs"][:, :, :2] = 1500.0
        part.signals["outputs"][:, ::2, :2] += 20.0  # both move, so that neither is stuck
        part.signals["outputs"][[1, 4, 6], :, 0] += 100.0
        part.signals["outputs"][7, : RATE_HZ // 5, 0] += 100.0
        flight = flown(part, surfaces=Surfaces(pair, "inferred"))
        assert flight.parted_s == pytest.approx(parted_s)


def test_the_last_rows_are_of_forward_flight_where_no_motor_lifts() -> None:
    lift = lift_of({"SERVO5_FUNCTION": 33.0, "Q_ENABLE": 1.0})
    flight = Flight(Surfaces((SurfaceOutput(1, "aileron", 1500, 400),), "parameters", lift))
    assert (flight.last(9), flight.fastest) == (None, 0.0)
    part = seconds(6)
    part.signals["outputs"][:, :, 4] = 1000.0
    part.signals["outputs"][4, :, 4] = 1500.0
    list(flight.feed(part))
    for count, until_s, begin, end in ((9, np.inf, 0, 6), (2, np.inf, 4, 6), (2, 4.0, 2, 4), (9, 5.9, 0, 5)):
        known = present(flight.last(count, until_s))
        rows, pulses = known
        assert rows.fresh == (begin == 0)
        assert [rows.cut(k, k + 1).fresh for k in range(2)] == [begin == 0, False]
        assert (rows.second, rows.seconds, len(pulses)) == (begin, end - begin, (end - begin) * RATE_HZ)
        row = np.arange(begin * RATE_HZ, end * RATE_HZ)
        assert rows.flying.tolist() == ((row >= 3 * RATE_HZ - 1) & (row // RATE_HZ != 4)).tolist()
    assert flight.last(9, 0.5) is None


def test_a_demand_that_no_autopilot_controls_is_none() -> None:
    for mode, autopilot, follows in (
        *((mode, ARDUPILOT, False) for mode in (0.0, 2.0, 3.0, 4.0, 16.0)),
        *((mode, ARDUPILOT, True) for mode in (1.0, 5.0, 10.0, 15.0)),
        (0.0, PX4, True),
        (0.0, 0.0, True),
    ):
        [rows] = Flight(None).feed(seconds(1, state=[PLANE, autopilot, 1.0, mode]))
        assert np.isfinite(rows.roll_demand).all() == np.isfinite(rows.pitch_demand).all() == follows


def test_lift_motors_end_forward_flight() -> None:
    lift = lift_of({"SERVO5_FUNCTION": 33.0, "Q_ENABLE": 1.0})
    surfaces = Surfaces((SurfaceOutput(1, "aileron", 1500, 400),), "parameters", lift)
    for pulse, flown_s in ((1050.0, 7), (1051.0, 0)):  # 5 % of 1000 to 2000 µs
        outputs = np.where(np.arange(16) == 4, pulse, np.nan)
        flight = flown(seconds(10, outputs=outputs), surfaces=surfaces)
        assert (flight.flown_s, flight.lasted_s("lift"), flight.on_ground) == (
            flown_s,
            10.0 * (not flown_s),
            False,
        )
    list(flight.learn(of_parameters(Parameters(1, False, {"SERVO1_FUNCTION": 4.0}))))
    assert flight.flown_s == 7, "without lift motors the same flight is forward flight"
    assert flight.lasted_s("lift") == 0.0


def test_kinds_that_parameters_show() -> None:
    plane, copter = Identity(1, "fixed wing"), Identity(1, "quadrotor", multirotor=True)
    quadplane = {"Q_ENABLE": 1.0}
    for values, kind, turns in (
        ({}, "fixed wing", False),
        ({"Q_ENABLE": 0.0}, "fixed wing", False),
        ({"Q_ENABLE": -1.0}, "fixed wing", False),
        (quadplane, "quadplane", False),
        (quadplane | {"Q_TILT_MASK": 1.0}, "tiltrotor", True),
        (quadplane | {"Q_TILT_MASK": 1.0, "Q_TILT_ENABLE": 0.0}, "quadplane", False),
        (quadplane | {"Q_TAILSIT_ENABLE": 1.0, "Q_TILT_MASK": 1.0}, "tailsitter", True),
        (quadplane | {"Q_TAILSIT_ENABLE": 0.0, "Q_FRAME_CLASS": 10.0}, "quadplane", False),
        (quadplane | {"Q_FRAME_CLASS": 10.0}, "tailsitter", True),
    ):
        assert refined_identity(plane, values).kind == kind
        assert turns_its_motors(values) == turns
    for frame in (6.0, 11.0, 13.0):
        assert refined_identity(copter, {"FRAME_CLASS": frame}) == Identity(1, "helicopter")
        assert refined_identity(plane, {"FRAME_CLASS": frame}) == plane
    assert refined_identity(copter, {"FRAME_CLASS": 1.0}) == copter


def test_where_a_quadplane_hovers() -> None:
    nan = np.nan
    for autopilot, mode, vtol, airspeed, expected in (
        *((ARDUPILOT, float(mode), nan, nan, 17 <= mode <= 20) for mode in (10, 16, 17, 18, 19, 20, 21, 25)),
        (PX4, 18.0, nan, nan, False),
        (PX4, 3.0, 3.0, nan, True),
        (PX4, 3.0, 4.0, nan, False),
        (ARDUPILOT, 18.0, 4.0, nan, False),
        (ARDUPILOT, 18.0, 0.0, nan, True),
        (ARDUPILOT, 18.0, nan, 8.0, True),
        (ARDUPILOT, 18.0, nan, 8.1, False),
    ):
        state = np.array([[QUADPLANE, autopilot, 1.0, mode]])
        signals = {"state": state, "vtol": np.array([[vtol]]), "airspeed": np.array([[airspeed]])}
        assert hovers(signals).tolist() == [expected]


def test_a_wind_triangle_finds_airspeed_and_wind_in_turns() -> None:
    triangle = WindTriangle()
    for k in range(120):
        heading = 2 * np.pi * k / 40
        velocity = 17.0 * np.array([np.cos(heading), np.sin(heading)]) + [3.0, -4.0]
        triangle.step(velocity, heading)
        triangle.step(np.array([4.0, 2.9]), heading)  # below 5 m/s: the heading shows no wind
        triangle.step(np.array([np.nan, 1.0]), heading)
    assert triangle.is_settled
    np.testing.assert_allclose(triangle.wind, [3.0, -4.0], atol=0.01)
    straight = WindTriangle()
    for _ in range(300):
        straight.step(np.array([20.0, 0.0]), 0.0)
    assert not straight.is_settled, "one heading does not part airspeed and wind"


def test_a_long_straight_leg_in_gusts_leaves_the_wind_that_turns_showed() -> None:
    triangle, rng, gust = WindTriangle(), np.random.default_rng(1), np.zeros(2)
    for k in range(2000):
        heading = k / 15 if k < 120 else 2.0 + rng.normal(0.0, 0.02)
        gust = 0.9 * gust + rng.normal(0.0, 0.45, 2)
        triangle.step(18.0 * np.array([np.cos(heading), np.sin(heading)]) + [3.0, 4.0] + gust, heading)
    assert np.hypot(*(triangle.wind - [3.0, 4.0])) < 1.0
    for k in range(300):  # another wind shows in the next turns
        heading = k / 15
        triangle.step(18.0 * np.array([np.cos(heading), np.sin(heading)]) + [-2.0, 1.0], heading)
    np.testing.assert_allclose(triangle.wind, [-2.0, 1.0], atol=0.2)


def test_a_velocity_that_leaps_begins_the_wind_anew() -> None:
    triangle = WindTriangle()

    def turn(wind: list[float]) -> None:
        for heading in np.arange(0.0, 12.0, 0.2):
            triangle.step(17.0 * np.array([np.cos(heading), np.sin(heading)]) + wind, heading)

    turn([3.0, -4.0])
    triangle.step(np.array([20.0 + 30.0, -4.0]), 0.0)
    assert not triangle.is_settled
    turn([2.0, 1.0])
    np.testing.assert_allclose(triangle.wind, [2.0, 1.0], atol=0.01)


def test_the_first_velocity_is_shared_by_airspeed_and_wind_as_they_are_uncertain() -> None:
    """A prior of 15 ± 50 m/s airspeed and of 0 ± 30 m/s wind, wider after a second; 1 m/s of the velocity."""
    grown = np.exp(1 / 60)
    for heading in (0.0, np.pi / 2):
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        triangle = WindTriangle()
        triangle.step(turn @ [25.0, 3.0], heading)
        wind = turn @ [10.0 * 900 * grown / (3400 * grown + 1), 3.0 * 900 * grown / (900 * grown + 1)]
        np.testing.assert_allclose(triangle.wind, wind, rtol=1e-9, atol=1e-9)
        airspeed = 15.0 + 10.0 * 2500 * grown / (3400 * grown + 1)
        assert triangle._fit.values[0] == pytest.approx(airspeed, rel=1e-9)
