"""Train a model for an airframe on simulated flights; the one place that joins simulator and learning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, Airframe
from mavhums.errors import MavhumsError
from mavhums.learn import Card, Network, train_network
from mavhums.quantities import KEYS
from mavhums_sim.ema import EmaParameters
from mavhums_sim.flight import Flight, fly

__all__ = ["fly_class", "parameters_of", "train_model"]

_HEALTHY_PER_LIMIT = 0.225 / 0.375
_EMERGENCY_PER_LIMIT = 1.025 / 0.875
_SURFACE = "elevator"
_EVERY = 5
_CANDIDATES = KEYS[1:]  # the command V1 says nothing of the condition, and must not be let to seem to

Array = NDArray[np.float64]


def train_model(
    airframe: Airframe,
    *,
    flights: int = 6,
    networks: int = 10,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Network, Card]:
    """Fly both classes, select features, and train.

    As in the paper, the classes are flown at one friction each: 0.6 times the normal limit and
    1.17 times the emergency limit (0.225 and 1.025 N·m for the paper's actuator). Every flight
    has a cyclogram of its own, so the command does not carry the class; every fifth moving sample
    is kept, for a standing actuator shows no friction.

    Parameters
    ----------
    airframe
        All of whose actuators must have the same constants and limits.
    flights
        Number of flights of each class.
    networks, seed, progress
        See :func:`mavhums.learn.train_network`.

    Raises
    ------
    MavhumsError
        If the actuators differ, or the profile leaves their constants or limits open.
    MissingExtraError
        If torch is not installed.
    """
    actuator = airframe.actuators[0]
    if any((other.ema, other.limits) != (actuator.ema, actuator.limits) for other in airframe.actuators):
        raise MavhumsError(
            f"the actuators of {airframe.name} differ", "train one model for each, with profiles of one kind"
        )
    limits = actuator.known_limits()
    healthy = _HEALTHY_PER_LIMIT * limits.normal
    emergency = _EMERGENCY_PER_LIMIT * limits.emergency
    values, labels, numbers = [], [], []
    for number in range(2 * flights):
        is_emergency = number >= flights
        flown = fly_class(actuator, emergency if is_emergency else healthy, seed=1_000_000 * seed + number)
        moving = flown[np.abs(flown[:, 6]) > actuator.moving_speed_rev_min][::_EVERY]
        values.append(moving)
        labels.append(np.full(len(moving), is_emergency))
        numbers.append(np.full(len(moving), number))
    result = train_network(
        np.concatenate(values),
        np.concatenate(labels),
        np.concatenate(numbers),
        seed=seed,
        networks=networks,
        keys=_CANDIDATES,
        progress=progress,
    )
    card = result.card(
        name=f"{airframe.name}-instrumented",
        airframe=airframe.name,
        tier="instrumented",
        command=(
            f"mavhums train --airframe {airframe.name} --flights {flights} --networks {networks} "
            f"--seed {seed} -o MODEL"
        ),
        conditions={
            "cyclogram": "takeoff",
            "flights_per_class": flights,
            "friction_normal_nm": round(healthy, 4),
            "friction_emergency_nm": round(emergency, 4),
            "samples": "every fifth moving sample at 100 Hz",
        },
    )
    return result.network, card


def fly_class(actuator: Actuator, friction_nm: float, *, seed: int) -> Array:
    """Return V1…V12 of one simulated take-off at one friction, shape (n, 12)."""
    flight = Flight(
        seed=seed, friction_nm={_SURFACE: (friction_nm, friction_nm)}, parameters=parameters_of(actuator)
    )
    return fly(flight).actuators[_SURFACE].values


def parameters_of(actuator: Actuator) -> EmaParameters:
    """Return the simulator's parameters for a profile's EMA; what the profile lacks is as in Table 1."""
    table_1 = EmaParameters.from_data_sheet()
    ema = actuator.known_ema()
    return replace(
        table_1,
        gear_ratio=ema.gear_ratio,
        torque_per_ampere=ema.gear_ratio * ema.torque_constant,
        resistance=ema.resistance,
        inertia=actuator.inertia_output,
        current_limit=table_1.supply_voltage / ema.resistance,
    )
