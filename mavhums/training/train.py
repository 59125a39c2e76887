"""Training of a model for an airframe on simulated flights; the only link of simulator and learning."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Airframe, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import column
from mavhums.learn import (
    Calibration,
    Card,
    Model,
    Network,
    PrecedentBase,
    Scheme,
    WindowNetwork,
    brier_score,
    calibrate,
    check_command,
    expected_calibration_error,
    train_network,
)
from mavhums.training.flights import (
    TELEMETRY,
    ActuatorFlight,
    Telemetry,
    flown_samples,
    fly_fleet,
    friction_range,
    moving_samples,
    windows,
)
from mavhums.training.windows import flight_counts, train_window_network
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.manoeuvres import CYCLOGRAMS

_EVERY = 20
_RATES_HZ = (100.0, 50.0, 25.0, 10.0)
_WORKING = 20  # moving samples of a window in which a network is asked at all
_CALIBRATION, _MEASUREMENT = 200_000, 400_000  # added to the seed; seeds of training flights are below both

Progress = Callable[[int, int], None]


def train_model(
    airframe: Airframe,
    *,
    tier: str = "instrumented",
    flights: int = 24,
    seed: int = 1,
    scheme: Scheme | None = None,
    precedents: PrecedentBase | None = None,
    flown_weight: float = 1.0,
    tell: Callable[[str], None] | None = None,
    progress: Progress | None = None,
) -> tuple[Network, Card, WindowNetwork]:
    """Simulate both classes, run the paper's scheme on them, and calibrate and measure on other flights.

    The fleet consists of individual two-mass actuators. The friction of healthy actuators is 0.6 to
    1 times the normal limit, that of worn actuators 1 to 1.17 times the emergency limit: the paper's
    0.225 … 0.375 and 0.875 … 1.025 N·m. The flights take all six cyclograms in turn, each with its own
    command, so the command does not reveal the class. Every twentieth moving sample is kept; a
    stationary actuator gives no evidence of friction.

    Calibration uses twice as many flights as each class has, with frictions over the whole range,
    all cyclograms, and rates of 100, 50, 25 and 10 Hz. The same number of further flights measures
    the network and its calibration; neither training nor any choice has seen them.

    The network of windows comes from the same stages on flights of their own, in which every condition that
    the simulator flies and the telemetry shows is flown over the same commands
    (:mod:`mavhums.training.windows`).
    Precedents have two classes, and supplement only the network of samples.

    Parameters
    ----------
    airframe
        Airframe profile; all its actuators must have the same constants and limits.
    tier
        The model's telemetry: a name in :data:`mavhums.training.flights.TELEMETRY`.
    flights
        Number of flights of each class, of four actuators each.
    seed, scheme, tell
        See :func:`mavhums.learn.train_network`.
    precedents
        Flights that supplement the simulation, as the paper intends. The network omits quantities
        that are missing in any of their samples.
    flown_weight
        Weight of a precedent's sample relative to a simulated one.
    progress
        Called with the number of flights flown and the total.

    Raises
    ------
    MavhumsError
        If the scheme is not possible, the actuators differ, the profile lacks their constants or
        limits, the telemetry is unknown, or the base has no precedent of the airframe.
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
    telemetry, limits, scheme = TELEMETRY[tier], actuator.known_limits(), scheme or Scheme()
    step, steps = count(1), 6 * flights + sum(flight_counts(flights))

    def tick() -> None:
        if progress:
            progress(next(step), steps)

    supplement = None if precedents is None else flown_samples(precedents, airframe, every=_EVERY)
    samples, classes, flight = _both_classes(actuator, telemetry, flights, 1_000_000 * seed, tick)
    weights, keys = np.ones(len(samples)), telemetry.keys
    given, flown_conditions = "", dict[str, JsonValue]()
    if precedents is not None and supplement is not None:
        given = f" --precedents {precedents.folder.name} --flown-weight {flown_weight:g}"
        logs = sorted({precedent.provenance.sha256 for precedent in precedents})
        flown_conditions = {"precedent_logs": [*logs], "flown_weight": flown_weight}
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
        keys=keys,
        scheme=scheme,
        weights=None if precedents is None else weights,
        tell=tell,
    )
    card = result.card(
        name=f"{airframe.name}-{tier}",
        airframe=airframe.name,
        tier=telemetry.gives,
        command=(
            f"mavhums train --airframe {airframe.name} --tier {tier} --flights {flights} "
            f"--seed {seed} {scheme.command}{given} -o MODEL"
        ),
        conditions={
            "cyclograms": [*CYCLOGRAMS],
            "flights_per_class": flights,
            "friction_normal_nm": _rounded(friction_range(limits)[0], limits.normal),
            "friction_emergency_nm": _rounded(limits.emergency, friction_range(limits)[1]),
            "actuators": "individuals with two masses, four a flight",
            "samples": "every twentieth moving sample at 100 Hz",
            **flown_conditions,
        },
    )
    draft = Model(result.network, card, "")
    calibration, measured = _calibration(actuator, telemetry, draft, 2 * flights, 1_000_000 * seed, tick)
    say = tell or (lambda _: None)
    say(_metrics_text(measured))
    window, window_card = train_window_network(
        actuator, telemetry, flights, seed=seed, scheme=scheme, tell=say, tick=tick
    )
    update = {"calibration": calibration, "metrics": card.metrics | measured, "window": window_card}
    return result.network, card.model_copy(update=update), window


def _both_classes(
    actuator: Actuator, telemetry: Telemetry, flights: int, seed: int, tick: Callable[[], None]
) -> tuple[Array, Flags, Integers]:
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
    cyclograms = [[*CYCLOGRAMS][k % len(CYCLOGRAMS)] for k in range(flights)]
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


class _NetworkAnswers:
    """Answers of a network on flights of its own: votes on samples, and shares of votes in windows."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.middle = (limits.normal + limits.emergency) / 2
        self.share: list[float] = []
        self.event: list[bool] = []
        self.clear: list[bool] = []
        self.samples = self.voted = self.right = self.working = 0

    def take(self, actuator: Actuator, model: Model, flown: ActuatorFlight) -> None:
        """Count the samples of the two classes, and the windows of any friction."""
        clear = not self.limits.normal < flown.friction_nm < self.limits.emergency
        event = flown.friction_nm > self.middle
        for vote, moving in windows(actuator, [model], flown):
            self.working += clear and moving >= _WORKING
            if vote:
                self.share.append(vote.p_fault)
                self.event.append(event)
                self.clear.append(clear)
        if clear:
            votes = model.votes(moving_samples(actuator, flown)[0])
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


def _calibration(
    actuator: Actuator,
    telemetry: Telemetry,
    model: Model,
    flights: int,
    seed: int,
    tick: Callable[[], None],
) -> tuple[Calibration | None, dict[str, float]]:
    """Calibrate on some flights and measure on others; nothing if the network votes too rarely."""
    limits = actuator.known_limits()

    def fly_range(seed: int) -> _NetworkAnswers:
        random = np.random.default_rng(seed)
        total = flights * len(SURFACES)
        low, high = friction_range(limits)
        frictions = low + (high - low) * (random.permutation(total) + random.random(total)) / total
        found = _NetworkAnswers(limits)
        fleet = fly_fleet(
            actuator,
            telemetry,
            frictions.reshape(flights, len(SURFACES)),
            seed=seed,
            cyclograms=[*CYCLOGRAMS],
            rates_hz=_RATES_HZ,
        )
        for k, flown in enumerate(fleet):
            found.take(actuator, model, flown)
            if k % len(SURFACES) == 0:
                tick()
        return found

    first, second = fly_range(seed + _CALIBRATION), fly_range(seed + _MEASUREMENT)
    if len(set(first.event)) < 2 or not second.share:
        return None, {}
    fitted = calibrate(first.share, first.event)
    tested, truth = np.array(second.share), np.array(second.event)
    said = np.array([fitted.probability(each) for each in tested])
    calibration = fitted.model_copy(
        update={
            "event": f"friction above {first.middle:g} N·m, the middle between the limits",
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


def _metrics_text(metrics: dict[str, float]) -> str:
    if not metrics:
        return "flights not trained on: the network votes too rarely to be measured"
    percent = {name: f"{100 * value:.2f} %" for name, value in metrics.items()}
    return (
        f"flights not trained on: {percent['samples_in_motion_right']} of the samples in motion right "
        f"({percent['samples_in_motion_abstained']} abstained), {percent['windows_right']} of the windows "
        f"({percent['windows_in_motion_abstained']} abstained)"
    )


def _rounded(low: float, high: float) -> list[JsonValue]:
    return [round(low, 4), round(high, 4)]
