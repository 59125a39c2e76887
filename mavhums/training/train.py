"""Training of a model for an airframe on simulated flights and precedents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import count
from typing import NamedTuple

import numpy as np
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Airframe, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.health.actuator.votes import carries
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
    History,
    Telemetry,
    fly_fleet,
    friction_range,
    moving_samples,
    windows,
)
from mavhums.training.flown import CALIBRATES, MEASURES, TAUGHT, TRAINS, FlownFlights
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
) -> tuple[Network, Card, WindowNetwork | None]:
    """Run the paper's scheme on simulated flights and precedents, and calibrate and measure on other flights.

    The simulated fleet consists of individual two-mass actuators. The friction of healthy actuators is 0.6 to
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

    Precedents teach both networks: that of samples takes those that are normal or an emergency by friction,
    that of windows takes all classes. Where enough are there, whole flights of them calibrate and measure in
    place of the simulated ones (:class:`mavhums.training.flown.FlownFlights`). Without simulated flights they
    train alone, which needs no constants and no limits; without constants there is no network of windows.

    Parameters
    ----------
    airframe
        Airframe profile; all its actuators must have the same constants and limits.
    tier
        The model's telemetry: a name in :data:`mavhums.training.flights.TELEMETRY`.
    flights
        Number of simulated flights of each class, of four actuators each; 0 for precedents alone.
    seed, scheme, tell
        See :func:`mavhums.learn.train_network`.
    precedents
        Labelled flights, as the paper intends. The networks omit quantities that they lack.
    flown_weight
        Weight of a precedent's sample or window relative to a simulated one.
    progress
        Called with the number of flights flown and the total.

    Raises
    ------
    MavhumsError
        If the scheme is not possible, the actuators differ, the profile lacks the constants or limits of a
        simulation, the telemetry is unknown, the base has no precedent of the airframe or, alone, too few,
        or a network contradicts the flights that calibrate it.
    MissingExtraError
        If torch is not installed.

    Warns
    -----
    CommandLeakWarning
        If the command distinguishes the classes.
    """
    actuator = airframe.actuators[0]
    if any((other.ema, other.limits) != (actuator.ema, actuator.limits) for other in airframe.actuators):
        raise MavhumsError(
            f"the actuators of {airframe.name} differ", "train one model for each, with profiles of one kind"
        )
    if tier not in TELEMETRY:
        raise MavhumsError(f"no model is for telemetry {tier!r}", f"name one of: {', '.join(TELEMETRY)}")
    telemetry, scheme, say = TELEMETRY[tier], scheme or Scheme(), tell or (lambda _: None)
    flown = FlownFlights(precedents, airframe, seed=seed) if precedents else None
    if not flights:
        _check_alone(flown)
    elif actuator.blanks:
        raise MavhumsError(
            f"{airframe.name}: a simulation needs {' and '.join(actuator.blanks)} in the profile",
            "fill them in, or train on labelled logs alone: --flights 0 --precedents DIR",
        )
    held_out = flown is not None and flown.held_out
    step, windows_flown = count(1), flight_counts(flights)
    steps = (2 if held_out else 6) * flights + (windows_flown[0] if held_out else sum(windows_flown))

    def tick() -> None:
        if progress:
            progress(next(step), steps)

    groups, keys = [], telemetry.keys
    if flights:
        groups.append(_both_classes(actuator, telemetry, flights, 1_000_000 * seed, tick))
        say(f"samples of {2 * flights} simulated flights: {_classes_text(groups[0][1])}")
    given, conditions = "", dict[str, JsonValue]()
    if flown and precedents:
        given = f" --precedents {precedents.folder.name} --flown-weight {flown_weight:g}"
        conditions = {"precedent_logs": flown.logs.tolist(), "flown_weight": flown_weight}
        say(f"precedents: {flown.counts()}")
        own = flown_samples(flown, say)
        # An ESC's telemetry leaves some samples without a sign: what most samples carry is learned from.
        keys = tuple(key for key in keys if 2 * np.isfinite(own[0][:, column(key)]).sum() >= len(own[0]))
        whole = np.isfinite(own[0][:, [column(key) for key in keys]]).all(axis=1)
        own = (own[0][whole], own[1][whole], own[2][whole])
        say(f"samples of precedents: {_classes_text(own[1])}")
        groups.append(own)
    samples, classes, flight = (np.concatenate(parts) for parts in zip(*groups, strict=True))
    weights = np.where(flight < 0, flown_weight, 1.0)
    if not keys or len(np.unique(classes)) < 2:
        raise MavhumsError(
            "the samples in motion carry no quantity in common, or are all of one class",
            "add logs with the same telemetry, normal ones and ones labelled friction_emergency",
        )
    result = train_network(
        samples, classes, flight, seed=seed, keys=keys, scheme=scheme, weights=weights, tell=tell
    )
    card = result.card(
        name=f"{airframe.name}-{tier}",
        airframe=airframe.name,
        tier=telemetry.gives,
        command=(
            f"mavhums train --airframe {airframe.name} --tier {tier} --flights {flights} "
            f"--seed {seed} {scheme.command}{given} -o MODEL"
        ),
        conditions=_simulated(actuator, flights) | conditions,
    )
    draft = Model(result.network, card, "")

    def asked(part: int) -> Iterator[_Asked]:
        if flown and held_out:
            return _ask_flown(flown, part)
        of_part = 1_000_000 * seed + (_CALIBRATION if part == CALIBRATES else _MEASUREMENT)
        return _ask_simulated(actuator, telemetry, 2 * flights, of_part, tick)

    event = (
        "the label friction_emergency, not normal, of precedents"
        if held_out
        else f"friction above {_middle(actuator.known_limits()):g} N·m, the middle between the limits"
    )
    calibration, measured = _calibration(draft, asked, event)
    say(_metrics_text(card.metrics | measured, "precedents" if held_out else "simulated flights"))
    update = {"calibration": calibration, "metrics": card.metrics | measured}
    if actuator.ema is None:
        say("no network of windows: its statistics need the gear ratio, in [actuators.ema] of the profile")
        return result.network, card.model_copy(update=update), None
    window, window_card = train_window_network(
        actuator,
        telemetry,
        flights,
        seed=seed,
        scheme=scheme,
        tell=say,
        tick=tick,
        flown=flown,
        flown_weight=flown_weight,
    )
    return result.network, card.model_copy(update=update | {"window": window_card}), window


_ALONE = 4
"""Flights that each class needs where precedents train alone: to train, choose, calibrate and measure."""


def _check_alone(flown: FlownFlights | None) -> None:
    """Refuse a training without simulated flights that has too few precedents."""
    counts = flown.counts() if flown else "no precedents"
    if flown is None or not flown.held_out or min(map(flown.flights_of, TAUGHT)) < _ALONE:
        raise MavhumsError(
            f"without simulated flights, normal and friction_emergency need {_ALONE} logs each: {counts}",
            "add logs with `mavhums precedents add`, or simulate too: --flights 24",
        )


def flown_samples(flown: FlownFlights, say: Callable[[str], None]) -> tuple[Array, Flags, Integers]:
    """Return samples, classes and flights, below zero, of the precedents that train; check their command."""
    values, classes, flights, unit = [np.empty((0, len(KEYS)))], [], [], []
    for number, each in enumerate(flown.read(TRAINS, TAUGHT)):
        moving, ema = moving_samples(each.actuator, each)[0][::_EVERY], each.actuator.ema
        values.append(np.where(carries(moving, ema.gear_ratio if ema else None), moving, np.nan))
        count_ = len(values[-1])
        classes.append(np.full(count_, each.label != "normal"))
        flights.append(np.full(count_, -1 - each.flight))
        unit.append(np.full(count_, number))
    samples, emergency = np.concatenate(values), np.concatenate([np.empty(0, dtype=np.bool_), *classes])
    if not len(samples):
        raise MavhumsError(
            "no precedent that trains has a sample in motion",
            "add logs in which the surfaces move; without [actuators.ema] they must carry V10",
        )
    of = np.concatenate(unit)
    commanded = np.isfinite(samples[:, 0])
    if len(np.unique(emergency[commanded])) == 2:
        leak = check_command(samples[commanded, 0], emergency[commanded], of[commanded])
        chance = "" if leak.p_value is None else f" (p {leak.p_value:.2g})"
        say(f"command of the precedents: Cramér's V {leak.cramers_v:.2f} between the classes{chance}")
    return samples, emergency, np.concatenate(flights)


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


class _Asked(NamedTuple):
    """An actuator's flight, whether it is an emergency, and whether it has a class or lies between."""

    actuator: Actuator
    flown: History
    event: bool
    clear: bool


class _NetworkAnswers:
    """Answers of a network on flights of its own: votes on samples, and shares of votes in windows."""

    def __init__(self, model: Model, asked: Iterable[_Asked]) -> None:
        self.share: list[float] = []
        self.event: list[bool] = []
        self.clear: list[bool] = []
        self.samples = self.voted = self.right = self.working = 0
        for each in asked:
            self._take(model, each)

    def _take(self, model: Model, asked: _Asked) -> None:
        """Count the samples of the two classes, and the windows of any friction."""
        actuator, flown, event, clear = asked
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


def _ask_flown(flown: FlownFlights, part: int) -> Iterator[_Asked]:
    for each in flown.read(part, TAUGHT):
        yield _Asked(each.actuator, each, each.label != "normal", clear=True)


def _ask_simulated(
    actuator: Actuator, telemetry: Telemetry, flights: int, seed: int, tick: Callable[[], None]
) -> Iterator[_Asked]:
    """Fly frictions over the whole range; those between the limits are of no class."""
    limits, random = actuator.known_limits(), np.random.default_rng(seed)
    total = flights * len(SURFACES)
    low, high = friction_range(limits)
    frictions = low + (high - low) * (random.permutation(total) + random.random(total)) / total
    fleet = fly_fleet(
        actuator,
        telemetry,
        frictions.reshape(flights, len(SURFACES)),
        seed=seed,
        cyclograms=[*CYCLOGRAMS],
        rates_hz=_RATES_HZ,
    )
    for k, flown in enumerate(fleet):
        clear = not limits.normal < flown.friction_nm < limits.emergency
        yield _Asked(actuator, flown, flown.friction_nm > _middle(limits), clear)
        if k % len(SURFACES) == 0:
            tick()


def _middle(limits: Limits) -> float:
    return (limits.normal + limits.emergency) / 2


def _calibration(
    model: Model, asked: Callable[[int], Iterator[_Asked]], event: str
) -> tuple[Calibration | None, dict[str, float]]:
    """Calibrate on some flights and measure on others; nothing if the network votes too rarely."""
    first, second = (_NetworkAnswers(model, asked(part)) for part in (CALIBRATES, MEASURES))
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


def _metrics_text(metrics: dict[str, float], source: str) -> str:
    percent = {name: f"{100 * value:.2f} %" for name, value in metrics.items()}
    text = (
        f"network of samples: right {percent['training_accuracy']} of the vectors trained on, "
        f"{percent['validation_accuracy']} of the samples that chose it, on {source} not trained on "
    )
    if "windows_right" not in metrics:
        return f"{text}nothing: it votes too rarely to be measured"
    return (
        f"{text}{percent['samples_in_motion_right']} of the samples in motion "
        f"({percent['samples_in_motion_abstained']} abstained), {percent['windows_right']} of the windows "
        f"({percent['windows_in_motion_abstained']} abstained)"
    )


def _classes_text(emergency: Flags) -> str:
    worn = int(emergency.sum())
    return f"{len(emergency) - worn} normal, {worn} friction_emergency"


def _simulated(actuator: Actuator, flights: int) -> dict[str, JsonValue]:
    """Return the training conditions of simulated flights."""
    if not flights:
        return {}
    limits = actuator.known_limits()
    return {
        "cyclograms": [*CYCLOGRAMS],
        "flights_per_class": flights,
        "friction_normal_nm": _rounded(friction_range(limits)[0], limits.normal),
        "friction_emergency_nm": _rounded(limits.emergency, friction_range(limits)[1]),
        "actuators": "individuals with two masses, four a flight",
        "samples": "every twentieth moving sample at 100 Hz",
    }


def _rounded(low: float, high: float) -> list[JsonValue]:
    return [round(low, 4), round(high, 4)]
