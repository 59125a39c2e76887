"""Labelled flights and their samples, for the network of samples: training, calibration and measurement."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.learn import CommandLeakWarning, check_command
from mavhums.paper.flights import (
    RATES_HZ,
    Fleet,
    History,
    Training,
    fly_fleet,
    friction_range,
    moving_samples,
)
from mavhums.paper.flown import CALIBRATES, MEASURES, TAUGHT, FlownFlights
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.manoeuvres import CYCLOGRAMS

_EVERY = 20
_SEEDS = {CALIBRATES: 200_000, MEASURES: 400_000}
"""Added to the seed; seeds of training flights are below both."""


class Labelled(NamedTuple):
    """An actuator's flight, whether it is an emergency, and whether that is sure.

    It is not of a friction between the limits, and of a fault that is none of the friction.
    """

    actuator: Actuator
    history: History
    flight: int
    emergency: bool
    clear: bool = True


def of_precedents(flown: FlownFlights, part: int) -> Iterator[Labelled]:
    """Read the precedents of a part; their flights are below zero, and two labels are classes of samples."""
    for each in flown.read(part):
        faulty, clear = each.label != "normal", each.label in TAUGHT
        yield Labelled(each.actuator, each, -1 - each.flight, faulty, clear)


def both_classes(training: Training) -> Iterator[Labelled]:
    """Fly the flights of each class, over the same cyclograms."""
    limits, flights = training.actuator.known_limits(), training.options.flights
    low, high = friction_range(limits)
    fleet = Fleet(training.actuator, training.telemetry, 1_000_000 * training.options.seed)
    random, size = np.random.default_rng(fleet.seed), (flights, len(SURFACES))
    healthy, worn = random.uniform(low, limits.normal, size), random.uniform(limits.emergency, high, size)
    cyclograms = 2 * [fleet.cyclograms[k % len(fleet.cyclograms)] for k in range(flights)]
    return _fly(training, replace(fleet, cyclograms=cyclograms), np.concatenate([healthy, worn]))


def whole_range(training: Training, part: int) -> Iterator[Labelled]:
    """Fly frictions over the whole range, all cyclograms and rates."""
    seed = 1_000_000 * training.options.seed + _SEEDS[part]
    shape = (2 * training.options.flights, len(SURFACES))
    random, total = np.random.default_rng(seed), shape[0] * shape[1]
    low, high = friction_range(training.actuator.known_limits())
    frictions = low + (high - low) * (random.permutation(total) + random.random(total)) / total
    fleet = Fleet(training.actuator, training.telemetry, seed, rates_hz=RATES_HZ)
    return _fly(training, fleet, frictions.reshape(shape))


def _fly(training: Training, fleet: Fleet, frictions: Array) -> Iterator[Labelled]:
    limits = fleet.actuator.known_limits()
    for k, flown in enumerate(fly_fleet(fleet, frictions)):
        clear = not limits.normal < flown.friction_nm < limits.emergency
        yield Labelled(fleet.actuator, flown, flown.flight, flown.friction_nm > middle_of(limits), clear)
        if k % len(SURFACES) == 0:
            training.tick()


def middle_of(limits: Limits) -> float:
    """Return the friction between the limits from which on a simulated actuator is an emergency, N·m."""
    return (limits.normal + limits.emergency) / 2


def training_samples(
    flights: Iterable[Labelled], keys: Sequence[str], source: str, say: Callable[[str], None]
) -> tuple[Array, Flags, Integers]:
    """Return every twentieth sample in motion that carries some quantities; check the command for a leak.

    Parameters
    ----------
    flights
        Flights; those that are neither of the two classes surely count for the leak alone.
    keys
        The quantities that a sample must carry.
    source, say
        What the flights are, and what is called with a line about them.

    Returns
    -------
    tuple of NDArray
        V1…V12 (n, 12), whether each sample is of an emergency (n,), and its flight (n,).

    Warns
    -----
    CommandLeakWarning
        If the command leaks the class.
    """
    inputs = [column(key) for key in keys]
    values, facts = [np.empty((0, len(KEYS)))], [np.empty((0, 4), dtype=np.int64)]
    for number, each in enumerate(flights):
        moving, _ = moving_samples(each.actuator, each.history)
        values.append(moving[np.isfinite(moving[:, inputs]).all(axis=1)][::_EVERY])
        facts.append(np.tile((each.emergency, each.flight, number, each.clear), (len(values[-1]), 1)))
    samples, (faulty, flight, unit, clear) = np.concatenate(values), np.concatenate(facts).T
    commanded = np.isfinite(samples[:, 0])
    leak = ""
    if len(np.unique(faulty[commanded])) == 2:
        # Whole flights are relabelled; single actuators only where those of one flight differ in their class.
        alike = len(np.unique([flight, faulty], axis=1).T) == len(np.unique(flight))
        units = flight if alike else unit
        found = check_command(samples[commanded, 0], faulty[commanded], units[commanded])
        chance = "" if found.p_value is None else f" (p {found.p_value:.2g})"
        leak = f"; their command has Cramér's V {found.cramers_v:.2f} with the class{chance}"
    taught = clear > 0
    worn = int(faulty[taught].sum())
    say(f"samples of {source}: {taught.sum() - worn} normal, {worn} friction_emergency{leak}")
    return samples[taught], faulty[taught] > 0, flight[taught]


_POSITIONS = ("V1", "V2")
"""Quantities that follow the command: they are offered where their distributions show no class."""


def examples_of(
    groups: Sequence[tuple[Array, Flags, Integers]], keys: tuple[str, ...]
) -> tuple[Array, Flags, Integers, tuple[str, ...], dict[str, str]]:
    """Return samples, classes and flights that carry all keys, the keys on offer, and why others are not."""
    samples, classes, flight = (np.concatenate(parts) for parts in zip(*groups, strict=True))
    whole = np.isfinite(samples[:, [column(key) for key in keys]]).all(axis=1)
    samples, classes, flight = samples[whole], classes[whole], flight[whole]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CommandLeakWarning)
        leaking = {
            key: "its distribution differs between the classes"
            for key in _POSITIONS
            if key in keys and check_command(samples[:, column(key)], classes, flight).leaks
        }
    keys = tuple(key for key in keys if key not in leaking)
    if not keys or len(np.unique(classes)) < 2:
        raise MavhumsError(
            "the samples in motion carry no quantity in common, or are all of one class",
            "add logs with the same telemetry, normal ones and ones labelled friction_emergency; without "
            "[actuators.ema] they must carry V10",
        )
    return samples, classes, flight, keys, leaking


def simulated_conditions(actuator: Actuator, flights: int) -> dict[str, JsonValue]:
    """Return the training conditions of simulated flights."""
    if not flights:
        return {}
    limits = actuator.known_limits()
    low, high = friction_range(limits)
    return {
        "cyclograms": [*CYCLOGRAMS],
        "flights_per_class": flights,
        "friction_normal_nm": [round(low, 4), round(limits.normal, 4)],
        "friction_emergency_nm": [round(limits.emergency, 4), round(high, 4)],
        "actuators": "individuals with two masses, four a flight",
        "samples": "every twentieth moving sample at 100 Hz",
    }
