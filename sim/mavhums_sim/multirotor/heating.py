"""How the ESCs of a multirotor heat: transistors on a board in the wash of the rotor, and what hinders them.

Losses go with the phase current, its square, and a constant; the current drives the torque of the propeller
and of the bearing. Two masses, the transistors and the board, store the heat; the air carries it away the
better, the faster the rotor turns and the aircraft flies, on each arm otherwise.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums_sim.multirotor.flight import LOGGED_HZ, Flown
from mavhums_sim.multirotor.vibration import FULL_RPM, Thermometer, rotor_rpm

Array = NDArray[np.float64]
_STEP: Final = LOGGED_HZ // 5  # of the record: the masses are slow
_INWARD_K: Final = 0.2  # resistance from the transistors to the board by that to still air


class Escs(NamedTuple):
    """The ESCs of one aircraft, shape (motors,) each.

    Attributes
    ----------
    rise_k
        What the squared current of a full thrust heats the board by in still air, K.
    exposed
        What airspeed adds to the cooling of each arm, s/m.
    offset_k
        Error of the sensor.
    small_s, large_s
        Heat capacity of the transistors and of the board by the conductance of a board to still air.
    """

    rise_k: Array
    exposed: Array
    offset_k: Array
    small_s: float
    large_s: float


def draw_escs(rng: np.random.Generator, motors: int) -> Escs:
    """Return ESCs of one type, which their places cool otherwise; in a real flight the air does most."""
    rise_k = rng.uniform(150.0, 400.0) * rng.normal(1.0, 0.08, motors)
    exposed, offset_k = rng.uniform(0.05, 0.2, motors), rng.normal(0.0, 1.5, motors)
    return Escs(rise_k, exposed, offset_k, rng.uniform(3.0, 20.0), rng.uniform(30.0, 200.0))


def temperatures(
    flown: Flown, escs: Escs, seed: int, *, blocked: Array | float = 1.0, drag: Array | float = 0.0
) -> Thermometer:
    """Return what the ESCs report, anew each second.

    ``blocked`` is by how many times the air carries away less, ``drag`` the torque of each bearing by that of
    its propeller at full thrust. The day's air, what is left of the flight before and the sun are drawn.
    """
    rng, motors = np.random.default_rng([seed, 15]), escs.rise_k.size
    speed = rotor_rpm(flown)[::_STEP] / FULL_RPM
    airspeed = np.linalg.norm(flown.velocity[::_STEP, :2] - flown.plan.wind, axis=1)[:, None]
    current = speed**2 + drag
    heat = escs.rise_k * (current**2 + 0.15 * current * speed + 0.01)
    cooling = (1.0 + 2.0 * speed + escs.exposed * airspeed) / blocked
    air = rng.uniform(-5.0, 38.0)
    left = rng.choice([0.0, rng.uniform(0.0, 0.6)])  # of the flight before, by what this one would settle at
    settled = escs.rise_k * 0.01 + left * (heat / cooling).mean(axis=0)
    board = air + settled + rng.normal(0.0, 1.0, motors)
    small, dt, shown = board.copy(), _STEP / LOGGED_HZ, np.empty_like(heat)
    for k in range(len(heat)):
        inward = (small - board) / _INWARD_K
        small += (heat[k] - inward) * dt / escs.small_s
        board += (inward - cooling[k] * (board - air)) * dt / escs.large_s
        shown[k] = small
    sensed = shown[:: LOGGED_HZ // _STEP] + escs.offset_k
    whole = np.rint(sensed + rng.normal(0.0, 0.3, sensed.shape))
    return lambda time_s: whole[np.clip(time_s.astype(np.int64), 0, len(whole) - 1)]
