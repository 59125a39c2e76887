"""Training of a model for an airframe on simulated flights; the only link of simulator and learning."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Airframe, Limits
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import column
from mavhums.learn import (
    Calibration,
    Card,
    Model,
    Network,
    PrecedentBase,
    brier_score,
    calibrate,
    check_command,
    expected_calibration_error,
    train_network,
)
from mavhums.training.flights import TELEMETRY, Telemetry, fly_fleet, moving_samples, windows
from mavhums.training.precedents import flown_samples
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.manoeuvres import CYCLOGRAMS

__all__ = ["friction_range", "train_model"]

_HEALTHY_PER_LIMIT = 0.225 / 0.375
_EMERGENCY_PER_LIMIT = 1.025 / 0.875
_EVERY = 20
_RATES_HZ = (100.0, 50.0, 25.0, 10.0)
_CALIBRATION, _MEASUREMENT = 200_000, 400_000  # added to the seed; seeds of training flights are below both

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


def train_model(
    airframe: Airframe,
    *,
    tier: str = "instrumented",
    flights: int = 12,
    networks: int = 10,
    seed: int = 1,
    precedents: PrecedentBase | None = None,
    flown_weight: float = 1.0,
    progress: Progress | None = None,
) -> tuple[Network, Card]:
    """Simulate both classes, select features, train a network, and calibrate it on other flights.

    The fleet consists of individual two-mass actuators. The friction of healthy actuators is 0.6 to
    1 times the normal limit, that of worn actuators 1 to 1.17 times the emergency limit: the paper's
    0.225 … 0.375 and 0.875 … 1.025 N·m. Every flight has its own cyclogram, so the command does not
    reveal the class. Every twentieth moving sample is kept; a stationary actuator gives no evidence
    of friction.

    Calibration uses four times as many flights as each class has, with frictions over the whole range,
    all cyclograms, and rates of 100, 50, 25 and 10 Hz. The same number of further flights measures the
    calibration.

    Parameters
    ----------
    airframe
        Airframe profile; all its actuators must have the same constants and limits.
    tier
        The model's telemetry: a name in :data:`mavhums.training.flights.TELEMETRY`.
    flights
        Number of flights of each class, of four actuators each.
    networks, seed
        See :func:`mavhums.learn.train_network`.
    precedents
        Flights that supplement the simulation, as the paper intends. The network omits quantities
        that are missing in any of their samples.
    flown_weight
        Weight of a precedent's sample relative to a simulated one.
    progress
        Called with the number of steps (flights and networks) done and the total.

    Raises
    ------
    MavhumsError
        If the actuators differ, the profile lacks their constants or limits, the telemetry is
        unknown, or the base has no precedent of the airframe.
    MissingExtraError
        If torch is not installed.
    """
    actuator = airframe.actuators[0]
    if any((other.ema, other.limits) != (actuator.ema, actuator.limits) for other in airframe.actuators):
        raise MavhumsError(
            f"the actuators of {airframe.name} differ", "train one model for each, with profiles of one kind"
        )
    if tier not in TELEMETRY:
        raise MavhumsError(f"no model is for telemetry {tier!r}", f"name one of: {', '.join(TELEMETRY)}")
    telemetry, limits = TELEMETRY[tier], actuator.known_limits()
    step, steps = count(1), 10 * flights + networks

    def tick() -> None:
        if progress:
            progress(next(step), steps)

    supplement = None if precedents is None else flown_samples(precedents, airframe, every=_EVERY)
    samples, classes, flight = _both_classes(actuator, telemetry, flights, 1_000_000 * seed, tick)
    weights, keys = np.ones(len(samples)), telemetry.keys
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
        features=telemetry.features and tuple(key for key in telemetry.features if key in keys),
        weights=None if precedents is None else weights,
        progress=lambda *_: tick(),
    )
    card = result.card(
        name=f"{airframe.name}-{tier}",
        airframe=airframe.name,
        tier=telemetry.gives,
        command=(
            f"mavhums train --airframe {airframe.name} --tier {tier} --flights {flights} "
            f"--networks {networks} --seed {seed}{_given(precedents, flown_weight)} -o MODEL"
        ),
        conditions={
            "cyclograms": [*telemetry.cyclograms],
            "flights_per_class": flights,
            "friction_normal_nm": _rounded(friction_range(limits)[0], limits.normal),
            "friction_emergency_nm": _rounded(limits.emergency, friction_range(limits)[1]),
            "actuators": "individuals with two masses, four a flight",
            "samples": "every twentieth moving sample at 100 Hz",
            "inputs": "selected" if telemetry.features is None else "given",
            **_supplement(precedents, flown_weight),
        },
    )
    draft = Model(result.network, card, "")
    calibration = _calibration(actuator, telemetry, draft, 4 * flights, 1_000_000 * seed, tick)
    return result.network, card.model_copy(update={"calibration": calibration})


def friction_range(limits: Limits) -> tuple[float, float]:
    """Return the smallest and the largest simulated friction, N·m; the paper's for its limits."""
    return _HEALTHY_PER_LIMIT * limits.normal, _EMERGENCY_PER_LIMIT * limits.emergency


def _both_classes(
    actuator: Actuator, telemetry: Telemetry, flights: int, seed: int, tick: Callable[[], None]
) -> tuple[Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Return samples, classes and flight numbers for training."""
    limits = actuator.known_limits()
    low, high = friction_range(limits)
    random = np.random.default_rng(seed)
    frictions = np.concatenate(
        [
            random.uniform(low, limits.normal, (flights, len(SURFACES))),
            random.uniform(limits.emergency, high, (flights, len(SURFACES))),
        ]
    )
    inputs = [column(key) for key in telemetry.keys]
    values, numbers = [], []
    cyclograms = [telemetry.cyclograms[k % len(telemetry.cyclograms)] for k in range(flights)]
    fleet = fly_fleet(actuator, telemetry, frictions, seed=seed, cyclograms=2 * cyclograms)
    for k, flown in enumerate(fleet):
        moving, _ = moving_samples(actuator, flown)
        kept = moving[np.isfinite(moving[:, inputs]).all(axis=1)][::_EVERY]
        values.append(kept)
        numbers.append(np.full(len(kept), flown.flight))
        if k % len(SURFACES) == 0:
            tick()
    samples, number = np.concatenate(values), np.concatenate(numbers)
    classes = number >= flights
    check_command(samples[:, 0], classes, number)
    return samples, classes, number


def _calibration(
    actuator: Actuator,
    telemetry: Telemetry,
    model: Model,
    flights: int,
    seed: int,
    tick: Callable[[], None],
) -> Calibration | None:
    """Calibrate on some flights and measure on others; None if the network votes too rarely."""
    limits = actuator.known_limits()
    middle = (limits.normal + limits.emergency) / 2

    def fly_range(seed: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return shares of votes, and whether the friction exceeded the middle of the limits."""
        random = np.random.default_rng(seed)
        total = flights * len(SURFACES)
        low, high = friction_range(limits)
        frictions = low + (high - low) * (random.permutation(total) + random.random(total)) / total
        share: list[float] = []
        event: list[bool] = []
        for k, flown in enumerate(
            fly_fleet(
                actuator,
                telemetry,
                frictions.reshape(flights, len(SURFACES)),
                seed=seed,
                cyclograms=[*CYCLOGRAMS],
                rates_hz=_RATES_HZ,
            )
        ):
            found = [vote.p_emergency for vote, _ in windows(actuator, [model], flown) if vote]
            share += found
            event += [flown.friction_nm > middle] * len(found)
            if k % len(SURFACES) == 0:
                tick()
        return np.array(share), np.array(event, dtype=np.bool_)

    share, event = fly_range(seed + _CALIBRATION)
    tested, truth = fly_range(seed + _MEASUREMENT)
    if len(set(event.tolist())) < 2 or not len(tested):
        return None
    fitted = calibrate(share, event)
    said = np.array([fitted.probability(each) for each in tested])
    return fitted.model_copy(
        update={
            "event": f"friction above {middle:g} N·m, the middle between the limits",
            "metrics": {
                "windows_calibrated_with": len(share),
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


def _rounded(low: float, high: float) -> list[JsonValue]:
    return [round(low, 4), round(high, 4)]


def _given(precedents: PrecedentBase | None, flown_weight: float) -> str:
    if precedents is None:
        return ""
    return f" --precedents {precedents.folder.name} --flown-weight {flown_weight:g}"


def _supplement(precedents: PrecedentBase | None, flown_weight: float) -> dict[str, JsonValue]:
    if precedents is None:
        return {}
    logs = {precedent.provenance.sha256 for precedent in precedents}
    return {"precedent_logs": [*sorted(logs)], "flown_weight": flown_weight}
