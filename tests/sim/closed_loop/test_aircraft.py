"""The aircraft in JSBSim against the published coefficients, written out again here by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

from mavhums_sim.closed_loop.aircraft import FRAME_S, STATES, Air, Aircraft, Dispersion, Trim
from mavhums_sim.closed_loop.frame import propel

Array = NDArray[np.float64]

MASS, AREA, SPAN, CHORD, SPEED, HEIGHT = 11.0, 0.55, 2.8956, 0.18994, 25.0, 100.0
JX, JY, JZ, JXZ = 0.8244, 1.135, 1.759, 0.1204
FOOT = 0.3048
PUBLISHED_DENSITY, PUBLISHED_ELEVATOR = 1.2682, -0.1248


def forces(
    alpha: float, elevator: float, speed: float, q: float, density: float
) -> tuple[float, float, float]:
    """Aerodynamic X, Z and pitching moment: the book's equations 4.6 and 4.7 …"""
    pressure = 0.5 * density * speed**2
    lift = 0.23 + 5.61 * alpha + 7.95 * CHORD / (2 * speed) * q + 0.13 * elevator
    drag = 0.043 + (0.23 + 5.61 * alpha) ** 2 / (np.pi * 0.9 * SPAN**2 / AREA) + 0.0135 * abs(elevator)
    pitch = 0.0135 - 2.74 * alpha - 38.21 * CHORD / (2 * speed) * q - 0.99 * elevator
    x = pressure * AREA * (lift * np.sin(alpha) - drag * np.cos(alpha))
    z = -pressure * AREA * (lift * np.cos(alpha) + drag * np.sin(alpha))
    return x, z, pressure * AREA * CHORD * pitch


def trimmed(density: float, gravity: float = 9.81) -> Array:
    def residual(guess: Array) -> list[float]:
        alpha, elevator, thrust = guess
        x, z, moment = forces(alpha, elevator, SPEED, 0.0, density)
        return [x + thrust - MASS * gravity * np.sin(alpha), z + MASS * gravity * np.cos(alpha), moment]

    return np.asarray(fsolve(residual, [0.05, 0.0, 10.0]))


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return Aircraft()


@pytest.fixture(scope="module")
def trim(aircraft: Aircraft) -> Trim:
    return aircraft.trim(HEIGHT, SPEED)


def density(aircraft: Aircraft) -> float:
    return float(aircraft.exec["atmosphere/rho-slugs_ft3"]) * 515.3788


def test_trim_is_that_of_the_published_coefficients(aircraft: Aircraft, trim: Trim) -> None:
    expected = trimmed(density(aircraft))
    assert [trim.alpha, trim.elevator, trim.thrust] == pytest.approx(expected, rel=0.01)


def test_trim_in_the_books_air_is_the_published_one() -> None:
    assert trimmed(PUBLISHED_DENSITY)[1] == pytest.approx(PUBLISHED_ELEVATOR, rel=0.01)


@pytest.mark.parametrize(("throttle", "speed"), [(0.8, 25.0), (1.0, 25.0), (1.0, 5.0)])
def test_propeller_turns_where_its_torque_is_the_motors(throttle: float, speed: float) -> None:
    diameter, constant = 0.508, 60.0 / (2.0 * np.pi * 145.0)

    def torques(omega: float) -> tuple[float, float]:
        advance = 2.0 * np.pi * speed / (omega * diameter)
        load = 1.225 * (omega / (2.0 * np.pi)) ** 2 * diameter**5
        load *= 0.00523 + 0.00497 * advance - 0.01664 * advance**2
        return load, constant * ((44.4 * throttle - constant * omega) / 0.042 - 1.5)

    omega = float(brentq(lambda o: np.subtract(*torques(o)), 50.0, 900.0))
    advance = 2.0 * np.pi * speed / (omega * diameter)
    thrust = 1.225 * (omega / (2.0 * np.pi)) ** 2 * diameter**4
    thrust *= 0.09357 - 0.06044 * advance - 0.1079 * advance**2
    assert propel(throttle, speed) == pytest.approx((thrust, torques(omega)[0]), rel=1e-6)


def linearised(
    aircraft: Aircraft, trim: Trim, inputs: dict[str, float], keys: list[str], rows: list[int]
) -> Array:
    """Numerical derivatives of JSBSim's accelerations by the initial conditions ``keys``."""
    columns = []
    for key in keys:
        sides = []
        for sign in (1.0, -1.0):
            step = 0.01 * sign
            start(aircraft, trim, {**inputs, key: inputs[key] + step})
            sides.append(aircraft.accelerations()[rows])
        columns.append((sides[0] - sides[1]) / 0.02)
    return np.stack(columns, axis=1)


def start(aircraft: Aircraft, trim: Trim, state: dict[str, float]) -> None:
    aircraft.drive([0.0, trim.elevator, 0.0, trim.thrust / 4.4482216, 0.0])
    fdm: Any = aircraft.exec
    fdm["ic/h-sl-ft"] = HEIGHT / FOOT
    for name, value in state.items():
        fdm[f"ic/{name}"] = value / FOOT if name.endswith("fps") else value
    fdm.run_ic()


def level(trim: Trim) -> dict[str, float]:
    still = {"phi-rad": 0.0, "theta-rad": trim.alpha, "psi-true-rad": 0.0}
    speeds = {"u-fps": SPEED * np.cos(trim.alpha), "v-fps": 0.0, "w-fps": SPEED * np.sin(trim.alpha)}
    return still | speeds | {"p-rad_sec": 0.0, "q-rad_sec": 0.0, "r-rad_sec": 0.0}


def longitudinal(trim: Trim, rho: float) -> Array:
    """d(u, w, q, θ)/dt of the written-out equations, by differences."""
    u0, w0 = SPEED * np.cos(trim.alpha), SPEED * np.sin(trim.alpha)

    def rates(state: Array) -> Array:
        u, w, q, theta = state
        x, z, moment = forces(np.arctan2(w, u), trim.elevator, np.hypot(u, w), q, rho)
        u_dot = (x + trim.thrust) / MASS - 9.81 * np.sin(theta) - q * w
        return np.array([u_dot, z / MASS + 9.81 * np.cos(theta) + q * u, moment / JY, q])

    at = np.array([u0, w0, 0.0, trim.alpha])
    return np.stack([(rates(at + d) - rates(at - d)) / 2e-5 for d in 1e-5 * np.eye(4)], axis=1)


def lateral(trim: Trim, rho: float) -> Array:
    """d(v, p, r, φ)/dt: chapter 5 of the book."""
    u, w = SPEED * np.cos(trim.alpha), SPEED * np.sin(trim.alpha)
    force = 0.5 * rho * SPEED * AREA
    damping = SPAN / (2 * SPEED)
    side = force * -0.98 / MASS
    roll = 0.5 * rho * SPEED**2 * AREA * SPAN * np.array([-0.13 / SPEED, -0.51 * damping, 0.25 * damping])
    yaw = 0.5 * rho * SPEED**2 * AREA * SPAN * np.array([0.073 / SPEED, 0.069 * damping, -0.095 * damping])
    inverse = np.linalg.inv(np.array([[JX, -JXZ], [-JXZ, JZ]]))
    angular = inverse @ np.stack([roll, yaw])
    sideways = [side, w, -u, 9.81 * np.cos(trim.alpha)]
    return np.array([sideways, [*angular[0], 0.0], [*angular[1], 0.0], [0.0, 1.0, np.tan(trim.alpha), 0.0]])


def jsbsim_matrices(aircraft: Aircraft, trim: Trim) -> tuple[Array, Array]:
    base = level(trim)
    along = linearised(aircraft, trim, base, ["u-fps", "w-fps", "q-rad_sec", "theta-rad"], [0, 2, 4])
    across = linearised(aircraft, trim, base, ["v-fps", "p-rad_sec", "r-rad_sec", "phi-rad"], [1, 3, 5])
    turning = [0.0, 1.0, np.tan(trim.alpha), 0.0]
    return np.vstack([along, [0.0, 0.0, 1.0, 0.0]]), np.vstack([across, turning])


def modes(matrix: Array) -> Array:
    values = np.linalg.eigvals(matrix)
    return np.asarray(values[np.lexsort((values.imag, -np.abs(values)))])


def test_short_period_and_phugoid(aircraft: Aircraft, trim: Trim) -> None:
    flown = modes(jsbsim_matrices(aircraft, trim)[0])
    np.testing.assert_allclose(flown, modes(longitudinal(trim, density(aircraft))), rtol=0.02, atol=0.004)
    assert abs(flown[0]) > 10 * abs(flown[-1])


def test_roll_dutch_roll_and_spiral(aircraft: Aircraft, trim: Trim) -> None:
    flown = modes(jsbsim_matrices(aircraft, trim)[1])
    np.testing.assert_allclose(flown, modes(lateral(trim, density(aircraft))), rtol=0.02, atol=0.004)
    roll, dutch, spiral = flown[0], flown[1], flown[-1]
    assert roll.imag == 0
    assert roll.real < -10
    assert dutch.imag != 0
    assert dutch.real < 0
    assert abs(spiral) < 0.2


def test_a_small_upset_decays_as_the_linear_model_says(aircraft: Aircraft, trim: Trim) -> None:
    upset = {"w-fps": 0.2, "v-fps": 0.2}
    base = level(trim)
    start(aircraft, trim, {name: value + upset.get(name, 0.0) for name, value in base.items()})
    seconds, names = 3.0, list(STATES)
    rows = []
    for _ in range(round(seconds / FRAME_S)):
        aircraft.run()
        rows.append(aircraft.read().copy())
    flown = np.array(rows)[:, [names.index(axis) for axis in "qpr"]]
    times = (np.arange(flown.shape[0]) + 1) * FRAME_S
    along = longitudinal(trim, density(aircraft))
    across = lateral(trim, density(aircraft))
    q = np.array([(expm(along * t) @ [0, 0.2, 0, 0])[2] for t in times])
    rates = np.array([(expm(across * t) @ [0.2, 0, 0, 0])[1:3] for t in times])
    for column, expected in enumerate((q, rates[:, 0], rates[:, 1])):
        error = np.abs(flown[:, column] - expected).max()
        assert error < 0.1 * np.abs(expected).max(), "qpr"[column]


def test_surfaces_turn_the_aircraft_as_the_coefficients_say(aircraft: Aircraft, trim: Trim) -> None:
    start(aircraft, trim, level(trim))
    pressure = 0.5 * density(aircraft) * SPEED**2 * AREA
    still = aircraft.accelerations()
    inverse = np.linalg.inv(np.array([[JX, -JXZ], [-JXZ, JZ]]))
    for surface, moments in ((0, (0.17, -0.011)), (2, (0.0024, -0.069))):
        inputs = [0.0, trim.elevator, 0.0, trim.thrust / 4.4482216, 0.0]
        inputs[surface] = 0.1
        aircraft.drive(inputs)
        aircraft.exec.run_ic()
        gained = (aircraft.accelerations() - still)[[3, 5]]
        np.testing.assert_allclose(gained, inverse @ np.array(moments) * pressure * SPAN * 0.1, rtol=1e-3)
    aircraft.drive([0.0, trim.elevator + 0.1, 0.0, trim.thrust / 4.4482216, 0.0])
    aircraft.exec.run_ic()
    assert (aircraft.accelerations() - still)[4] == pytest.approx(-0.099 * pressure * CHORD / JY, rel=1e-3)


def test_stall(aircraft: Aircraft) -> None:
    lift = []
    for alpha in (0.3, 0.4, 0.55):
        aircraft.place(HEIGHT, SPEED, alpha)
        lift.append(float(aircraft.exec["aero/coefficient/CLalpha"]))
    assert lift[0] == pytest.approx(0.23 + 5.61 * 0.3, rel=0.01)
    assert lift[2] < lift[1]


def test_turbulence_grows_and_repeats_with_the_seed() -> None:
    def gusts(strength: float, seed: int) -> Array:
        one = Aircraft(seed=seed)
        level_flight = one.trim(HEIGHT, SPEED)
        one.blow(Air(3.0, 90.0, strength))
        one.drive([0.0, level_flight.elevator, 0.0, level_flight.thrust / 4.4482216, 0.0])
        seen = []
        for _ in range(1500):
            one.run()
            seen.append(float(one.exec["atmosphere/turb-down-fps"]) * FOOT)
        return np.array(seen)

    light, moderate = gusts(7.7, 1), gusts(15.4, 1)
    assert gusts(0.0, 1).std() == 0.0
    assert 1.3 * light.std() < moderate.std() < 3.0
    np.testing.assert_array_equal(light, gusts(7.7, 1))
    assert not np.array_equal(light, gusts(7.7, 2))


def test_individuals_differ_and_repeat() -> None:
    assert Dispersion.draw(1) != Dispersion.draw(2)
    weak = Aircraft(Dispersion(aileron=0.5))
    start(weak, Trim(0.05, -0.13, 10.0), level(Trim(0.05, -0.13, 10.0)))
    assert float(weak.exec["dispersion/aileron"]) == 0.5
