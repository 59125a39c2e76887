"""Train a model for an airframe on simulated flights; the one place that joins simulator and learning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Airframe
from mavhums.errors import MavhumsError
from mavhums.learn import Card, Network, PrecedentBase, check_command, train_network
from mavhums.precedents import flown_samples
from mavhums.quantities import KEYS, column
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
    precedents: PrecedentBase | None = None,
    flown_weight: float = 1.0,
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
    precedents
        Flights that supplement the simulation, as the paper intends. Quantities that not all of
        their samples carry are left out of the network.
    flown_weight
        How many simulated samples one of a precedent counts for.

    Raises
    ------
    MavhumsError
        If the actuators differ, the profile leaves their constants or limits open, or the precedents
        hold none of the airframe.
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
    supplement = None if precedents is None else flown_samples(precedents, airframe, every=_EVERY)
    values, labels, numbers = [], [], []
    for number in range(2 * flights):
        is_emergency = number >= flights
        flown = fly_class(actuator, emergency if is_emergency else healthy, seed=1_000_000 * seed + number)
        moving = flown[np.abs(flown[:, 6]) > actuator.moving_speed_rev_min][::_EVERY]
        values.append(moving)
        labels.append(np.full(len(moving), is_emergency))
        numbers.append(np.full(len(moving), number))
    samples, classes, flight = (np.concatenate(parts) for parts in (values, labels, numbers))
    check_command(samples[:, 0], classes, flight)
    weights, keys = np.ones(len(samples)), _CANDIDATES
    if supplement is not None:
        flown, flown_classes, flown_flights = supplement
        keys = tuple(key for key in keys if np.isfinite(flown[:, column(key)]).all())
        samples, classes = np.concatenate([samples, flown]), np.concatenate([classes, flown_classes])
        flight = np.concatenate([flight, 2 * flights + flown_flights])
        weights = np.concatenate([weights, np.full(len(flown), flown_weight)])
    result = train_network(
        samples,
        classes,
        flight,
        seed=seed,
        networks=networks,
        keys=keys,
        weights=None if precedents is None else weights,
        progress=progress,
    )
    card = result.card(
        name=f"{airframe.name}-instrumented",
        airframe=airframe.name,
        tier="instrumented",
        command=(
            f"mavhums train --airframe {airframe.name} --flights {flights} --networks {networks} "
            f"--seed {seed}{_given(precedents, flown_weight)} -o MODEL"
        ),
        conditions={
            "cyclogram": "takeoff",
            "flights_per_class": flights,
            "friction_normal_nm": round(healthy, 4),
            "friction_emergency_nm": round(emergency, 4),
            "samples": "every fifth moving sample at 100 Hz",
            **_supplement(precedents, flown_weight),
        },
    )
    return result.network, card


def _given(precedents: PrecedentBase | None, flown_weight: float) -> str:
    if precedents is None:
        return ""
    return f" --precedents {precedents.folder.name} --flown-weight {flown_weight:g}"


def _supplement(precedents: PrecedentBase | None, flown_weight: float) -> dict[str, JsonValue]:
    if precedents is None:
        return {}
    logs = {precedent.provenance.sha256 for precedent in precedents}
    return {"precedent_logs": [*sorted(logs)], "flown_weight": flown_weight}


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
