"""The closed loop: it flies its mission, and every fault does to the aircraft what its name says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums_sim.closed_loop import Air, ClosedLoop, Confounder, FlownLoop, SurfaceFault, fly_closed_loop
from mavhums_sim.closed_loop.mission import LEG, PHASES, plan, sticks
from mavhums_sim.closed_loop.surfaces import LAYOUTS
from mavhums_sim.closed_loop.truth import truth
from mavhums_sim.conditions import Condition
from mavhums_sim.flight import Flight
from mavhums_sim.motion import simulate

Array = NDArray[np.float64]

ONSET = 45.0
STILL = {"airframe": None, "mission": "manual", "duration_s": 75.0}


def flown(*faults: SurfaceFault, **changes: Any) -> FlownLoop:
    return fly_closed_loop(ClosedLoop(seed=4, faults=faults, **{**STILL, **changes}))


@pytest.fixture(scope="module")
def healthy() -> FlownLoop:
    return flown()


def after(flight: FlownLoop, begin: float, *servos: str) -> tuple[Array, ...]:
    """Surface angles, °, from a time on."""
    names = LAYOUTS[flight.flight.layout].surfaces
    rows = flight.time_s >= begin
    return tuple(np.degrees(flight.servos("surface")[rows, names.index(servo)]) for servo in servos)


def roll_gain(flight: FlownLoop, begin: float, end: float) -> float:
    """Roll rate per angle of a healthy aileron servo, with sideslip, yaw rate and inertia beside it."""
    rows = (flight.time_s >= begin) & (flight.time_s < end)
    speed = flight.column("airspeed")
    shaft = flight.servos("shaft") @ LAYOUTS[flight.flight.layout].effect()[0]
    p, r = flight.column("p"), flight.column("r")
    causes = [shaft, flight.column("beta"), r / speed, np.gradient(p, 0.01) / speed**2, np.ones_like(p)]
    average = [np.convolve(signal, np.ones(20) / 20.0, "same")[rows] for signal in (*causes, p / speed)]
    return float(np.linalg.lstsq(np.stack(average[:-1], axis=1), average[-1], rcond=None)[0][0])


@pytest.mark.parametrize("airframe", [78, 102])
def test_the_dutch_roll_of_a_drawn_airframe_is_damped(airframe: int) -> None:
    """Of 199 airframes these two have the largest: with the rudder mixed, and as it is."""
    flight = fly_closed_loop(ClosedLoop(seed=1, airframe=airframe, duration_s=120.0, air=Air(3.0, 0.0, 4.0)))
    assert np.degrees(flight.column("beta").std()) < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("mission", ["waypoints", "loiter", "heading", "manual", "mixed"])
def test_missions_are_flown(mission: Any) -> None:
    flight = fly_closed_loop(
        ClosedLoop(seed=3, airframe=7, duration_s=150.0, mission=mission, air=Air(5.0, 80.0, 9.0))
    )
    settled = flight.time_s > 45.0
    assert flight.end == "complete"
    assert np.abs(flight.column("speed_error")[settled]).mean() < 3.0
    assert np.abs(flight.column("roll")).max() < np.radians(65.0)
    assert np.degrees(np.std((flight.column("nav_roll") - flight.column("roll"))[settled])) < 12.0
    if mission != "manual":
        assert np.abs(flight.column("height_error")[settled]).mean() < 20.0


def test_same_seed_same_flight(healthy: FlownLoop) -> None:
    np.testing.assert_array_equal(healthy.log, flown().log)


def test_seeds_airframes_and_air_make_other_flights(healthy: FlownLoop) -> None:
    for changes in ({"airframe": 1}, {"air": Air(3.0)}, {"mission": "loiter"}):
        other = flown(**changes)
        assert not np.array_equal(healthy.log[:5000], other.log[:5000]), changes


@pytest.mark.slow
@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_every_layout_flies_the_same_axes(layout: str, healthy: FlownLoop) -> None:
    other = flown(layout=layout)
    assert other.end == "complete"
    assert roll_gain(other, 35.0, 75.0) == pytest.approx(roll_gain(healthy, 35.0, 75.0), rel=0.1)


def test_mixing_is_undone_by_the_airframe() -> None:
    for layout in LAYOUTS.values():
        np.testing.assert_allclose(layout.effect() @ np.array(layout.mixing), np.eye(3), atol=1e-12)


def test_a_frozen_surface_does_not_move(healthy: FlownLoop) -> None:
    flight = flown(SurfaceFault("aileron_left", "freeze", at_s=ONSET))
    (angle,) = after(flight, ONSET + 0.02, "aileron_left")
    assert np.ptp(angle) == 0.0
    before = flight.time_s < ONSET
    np.testing.assert_array_equal(flight.log[before], healthy.log[before])


def test_a_surface_that_runs_away_stops_at_its_angle() -> None:
    (angle,) = after(flown(SurfaceFault("rudder", "freeze", -12.0, ONSET)), ONSET, "rudder")
    assert angle[0] > -2.0
    assert angle[30:] == pytest.approx(-12.0)


def test_one_dead_aileron_of_two_halves_the_roll_gain(healthy: FlownLoop) -> None:
    flight = flown(SurfaceFault("aileron_left", "freeze", at_s=ONSET))
    assert roll_gain(flight, ONSET, 75.0) / roll_gain(healthy, ONSET, 75.0) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("left", [0.8, 0.4])
def test_lost_share_of_both_ailerons_is_lost_roll_gain(left: float, healthy: FlownLoop) -> None:
    both = [SurfaceFault(name, "gain", left, ONSET) for name in ("aileron_left", "aileron_right")]
    ratio = roll_gain(flown(*both), ONSET, 75.0) / roll_gain(healthy, ONSET, 75.0)
    assert ratio == pytest.approx(left, abs=0.03)


def shaft_and_surface(kind: str, value: float, surface: str = "aileron_right") -> tuple[Array, Array]:
    flight = flown(SurfaceFault(surface, kind, value, ONSET))
    index = LAYOUTS["conventional"].surfaces.index(surface)
    rows = flight.time_s > ONSET + 3.0
    return flight.servos("shaft")[rows, index], flight.servos("surface")[rows, index]


def test_gain_bias_backlash() -> None:
    shaft, surface = shaft_and_surface("gain", 0.3)
    np.testing.assert_allclose(surface, 0.3 * shaft, atol=1e-12)
    shaft, surface = shaft_and_surface("bias", 4.0)
    np.testing.assert_allclose(surface - shaft, np.radians(4.0), atol=1e-12)
    shaft, surface = shaft_and_surface("backlash", 3.0)
    assert np.degrees(np.abs(surface - shaft)).max() == pytest.approx(1.5)
    assert np.mean(np.diff(surface) == 0.0) > 0.3


def test_slow_and_rate_limited() -> None:
    shaft, surface = shaft_and_surface("slow", 0.5)
    slope = np.gradient(surface, 0.01)[5:-5]
    np.testing.assert_allclose(slope, ((shaft - surface) / 0.5)[5:-5], atol=0.02)
    shaft, surface = shaft_and_surface("slow_rate", 5.0)
    assert np.degrees(np.abs(np.diff(surface)).max()) == pytest.approx(0.05)


def test_a_free_surface_streams_with_the_air() -> None:
    flight = flown(SurfaceFault("elevator", "float", at_s=ONSET))
    (angle,) = after(flight, ONSET + 1.0, "elevator")
    alpha = np.degrees(flight.column("alpha")[flight.time_s >= ONSET + 1.0])
    assert np.abs(angle - 0.375 * alpha)[alpha < 15.0].mean() < 0.5


def test_a_fault_can_end() -> None:
    flight = flown(SurfaceFault("aileron_left", "freeze", 10.0, ONSET, ONSET + 5.0))
    (angle,) = after(flight, ONSET + 6.0, "aileron_left")
    (shaft,) = (np.degrees(flight.servos("shaft")[flight.time_s >= ONSET + 6.0, 0]),)
    np.testing.assert_allclose(angle, shaft, atol=1e-9)


def test_engine_failure_costs_speed_or_height_and_no_surface(healthy: FlownLoop) -> None:
    flight = flown(confounders=(Confounder("engine", 0.0, ONSET),), mission="loiter")
    lost = flight.time_s > ONSET + 3.0
    assert np.abs(flight.column("thrust")[lost]).max() < 0.01
    assert flight.column("height")[lost][-1] < flight.column("height")[flight.time_s < ONSET][-1] - 10.0


def test_airspeed_gps_and_wind() -> None:
    loiter = {"mission": "loiter"}
    reads = flown(confounders=(Confounder("airspeed", 0.8, ONSET),), **loiter)
    lied = reads.time_s > ONSET
    ratio = reads.column("measured_airspeed")[lied] / reads.column("airspeed")[lied]
    assert ratio.mean() == pytest.approx(0.8, abs=0.03)
    blown = flown(confounders=(Confounder("wind", 8.0, ONSET, 60.0),), **loiter)

    def wind(at: float) -> float:
        row = int(np.searchsorted(blown.time_s, at))
        column = {
            name: blown.column(name)[row] for name in ("roll", "pitch", "yaw", "alpha", "beta", "airspeed")
        }
        through_air = column["airspeed"] * np.cos(column["pitch"] - column["alpha"])
        heading = column["yaw"] + column["beta"]
        north = blown.column("north_speed")[row] - through_air * np.cos(heading)
        return float(np.hypot(north, blown.column("east_speed")[row] - through_air * np.sin(heading)))

    assert wind(ONSET - 1.0) < 1.5
    assert wind(ONSET + 8.0) == pytest.approx(8.0, abs=1.5)
    assert wind(72.0) < 2.5
    lost = flown(confounders=(Confounder("gps", 3.0, ONSET),), **loiter)
    assert not np.array_equal(lost.column("north"), flown(**loiter).column("north"))


def test_hitting_the_ground_ends_the_flight() -> None:
    flight = flown(SurfaceFault("elevator", "freeze", -20.0, ONSET))
    assert flight.end == "crashed"
    assert flight.end_s < 75.0
    assert truth(flight)["end"] == "crashed"


def test_mission_lands_and_the_log_ends() -> None:
    seed = next(s for s in range(20) if plan(s, 308.0)["phase"][-1] == PHASES.index("approach"))
    flight = fly_closed_loop(ClosedLoop(seed=seed, airframe=2, duration_s=320.0))
    assert flight.end == "landed"
    assert flight.end_s < 320.0


def test_plans_outlast_their_flight_and_sticks_stay_within_reach() -> None:
    for seed in range(5):
        legs = plan(seed, 250.0)
        assert legs.dtype == LEG
        assert legs["lasts"].sum() > 250.0
        assert np.abs(sticks(seed, 2000)).max() < 1.3


def test_emas_in_the_loop_move_as_they_do_alone() -> None:
    conditions = {
        "elevator": (Condition.step("friction", 0.6, 25.0),),
        "rudder": (Condition.step("jam", 10.0, 30.0),),
    }
    emas = Flight(seed=2, conditions=conditions)
    flight = flown(emas=emas, duration_s=40.0)
    assert flight.emas is not None
    elevator = flight.emas.actuators["elevator"].motion
    slope = 0.016 * 0.5 * 1.225 * np.repeat(flight.column("airspeed"), 10) ** 2
    slope = np.concatenate([np.zeros(elevator.command.size - slope.size + 10), slope])[
        : elevator.command.size
    ]
    alone = simulate(
        emas.parameters, elevator.command, elevator.friction, slope, elevator.load - slope * elevator.angle
    )
    assert np.degrees(np.abs(alone.angle - elevator.angle).max()) < 0.3
    jammed = flight.emas.actuators["rudder"].motion
    assert np.ptp(jammed.angle[jammed.time_s > 30.5]) == 0.0
    (rudder,) = after(flight, 30.6, "rudder")
    assert np.ptp(rudder) == 0.0
    known: Any = truth(flight)
    assert known["emas"]["actuators"]["rudder"]["fault"] == "jam"


def test_two_masses_fly_too() -> None:
    parameters = Flight().parameters.two_masses()
    flight = flown(emas=Flight(parameters=parameters), duration_s=24.0)
    assert flight.emas is not None
    motion = flight.emas.actuators["elevator"].motion
    assert np.abs(motion.rotor_angle - motion.angle).max() > 0.0
