"""Labelled flights, simulated or from logs, for a network of samples: to train, calibrate and measure it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from mavhums.actuator.profile import Actuator, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, column
from mavhums.health.actuator.votes import carries
from mavhums.learn import (
    Calibration,
    Model,
    brier_score,
    calibrate,
    check_command,
    expected_calibration_error,
)
from mavhums.paper.flights import (
    RATES_HZ,
    History,
    Telemetry,
    fly_fleet,
    friction_range,
    moving_samples,
    windows,
)
from mavhums.paper.flown import TAUGHT, FlownFlights
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.manoeuvres import CYCLOGRAMS

_EVERY = 20
_WORKING = 20  # moving samples of a window in which a network is asked at all


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


def both_classes(
    actuator: Actuator, telemetry: Telemetry, flights: int, seed: int, tick: Callable[[], None]
) -> Iterator[Labelled]:
    """Fly so many flights of each class, over the same cyclograms."""
    limits, random = actuator.known_limits(), np.random.default_rng(seed)
    low, high = friction_range(limits)
    healthy = random.uniform(low, limits.normal, (flights, len(SURFACES)))
    worn = random.uniform(limits.emergency, high, (flights, len(SURFACES)))
    cyclograms = 2 * [[*CYCLOGRAMS][k % len(CYCLOGRAMS)] for k in range(flights)]
    frictions = np.concatenate([healthy, worn])
    return _fly(actuator, telemetry, frictions, tick, seed=seed, cyclograms=cyclograms)


def whole_range(
    actuator: Actuator, telemetry: Telemetry, flights: int, seed: int, tick: Callable[[], None]
) -> Iterator[Labelled]:
    """Fly frictions over the whole range, all cyclograms and rates."""
    random, total = np.random.default_rng(seed), flights * len(SURFACES)
    low, high = friction_range(actuator.known_limits())
    frictions = low + (high - low) * (random.permutation(total) + random.random(total)) / total
    options = {"seed": seed, "cyclograms": [*CYCLOGRAMS], "rates_hz": RATES_HZ}
    return _fly(actuator, telemetry, frictions.reshape(flights, len(SURFACES)), tick, **options)


def _fly(
    actuator: Actuator, telemetry: Telemetry, frictions: Array, tick: Callable[[], None], **options: Any
) -> Iterator[Labelled]:
    limits = actuator.known_limits()
    for k, flown in enumerate(fly_fleet(actuator, telemetry, frictions, **options)):
        clear = not limits.normal < flown.friction_nm < limits.emergency
        yield Labelled(actuator, flown, flown.flight, flown.friction_nm > middle_of(limits), clear)
        if k % len(SURFACES) == 0:
            tick()


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
        # An angle that was divided from the rotor's is not measured: no network would be asked with it.
        moving[~carries(moving, each.actuator.ema.gear_ratio if each.actuator.ema else None)] = np.nan
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


class _NetworkAnswers:
    """Answers of a network on flights of its own: votes on samples, and shares of votes in windows."""

    def __init__(self, model: Model, flights: Iterable[Labelled]) -> None:
        self.share: list[float] = []
        self.event: list[bool] = []
        self.clear: list[bool] = []
        self.samples = self.voted = self.right = self.working = 0
        for each in flights:
            self._take(model, each)

    def _take(self, model: Model, flight: Labelled) -> None:
        """Count the samples of the two classes, and the windows of any friction."""
        actuator, history, _, event, clear = flight
        for vote, moving in windows(actuator, [model], history):
            self.working += clear and moving >= _WORKING
            if vote:
                self.share.append(vote.p_fault)
                self.event.append(event)
                self.clear.append(clear)
        if clear:
            votes = model.votes(moving_samples(actuator, history)[0])
            self.samples += len(votes)
            self.voted += int(np.count_nonzero(votes >= 0))
            self.right += int(np.count_nonzero(votes == event))

    def metrics(self, calibration: Calibration) -> dict[str, float]:
        """Return shares of samples and windows of the two classes, on flights not trained on."""
        clear, event = np.array(self.clear), np.array(self.event)
        said = np.array([calibration.probability(share) > 0.5 for share in self.share])
        return {
            "samples_in_motion_right": round(self.right / max(self.voted, 1), 6),
            "samples_in_motion_abstained": round(1 - self.voted / max(self.samples, 1), 6),
            "windows_right": round(float(np.mean((said == event)[clear])) if clear.any() else 0.0, 6),
            "windows_in_motion_abstained": round(1 - float(clear.sum()) / max(self.working, 1), 6),
        }


def calibrated(
    model: Model, first_flights: Iterable[Labelled], other_flights: Iterable[Labelled], *, event: str
) -> tuple[Calibration | None, dict[str, float]]:
    """Calibrate on some flights and measure on others; nothing if the network votes too rarely."""
    first, second = _NetworkAnswers(model, first_flights), _NetworkAnswers(model, other_flights)
    if len(set(first.event)) < 2 or not second.share:
        return None, {}
    fitted = calibrate(first.share, first.event)
    tested, truth = np.array(second.share), np.array(second.event)
    said = np.array([fitted.probability(each) for each in tested])
    calibration = fitted.model_copy(
        update={
            "event": event,
            "metrics": {
                "windows_calibrated_with": len(first.share),
                "windows_measured": len(tested),
                "brier_score_of_the_share": round(brier_score(tested, truth), 6),
                "brier_score": round(brier_score(said, truth), 6),
                "expected_calibration_error_of_the_share": round(
                    expected_calibration_error(tested, truth), 6
                ),
                "expected_calibration_error": round(expected_calibration_error(said, truth), 6),
            },
        }
    )
    return calibration, second.metrics(calibration)
