"""Training of a model for an airframe on simulated flights and precedents; its calibration and metrics."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Airframe, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.learn import (
    Calibration,
    Card,
    CommandLeakWarning,
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
from mavhums.paper.flights import (
    CALIBRATES,
    MEASURES,
    RATES_HZ,
    TAUGHT,
    TELEMETRY,
    TRAINS,
    FlownFlights,
    History,
    Telemetry,
    fly_fleet,
    friction_range,
    moving_samples,
    windows,
)
from mavhums.paper.windows import flight_counts, train_window_network
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
    (:mod:`mavhums.paper.windows`).

    Precedents teach both networks: that of samples takes those that are normal or an emergency by friction,
    that of windows takes all classes. Where enough are there, whole flights of them calibrate and measure in
    place of the simulated ones (:class:`mavhums.paper.flights.FlownFlights`). Without simulated flights they
    train alone, which needs no constants and no limits; without constants there is no network of windows.

    Parameters
    ----------
    airframe
        Airframe profile; all its actuators must have the same constants and limits.
    tier
        The model's telemetry: a name in :data:`mavhums.paper.flights.TELEMETRY`.
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
    by_flown = flown is not None and {*TAUGHT} <= {*flown.held_out}
    step, windows_flown = count(1), flight_counts(flights)
    steps = (2 if by_flown else 6) * flights
    steps += windows_flown[0] if flown and flown.held_out else sum(windows_flown)

    def tick() -> None:
        if progress:
            progress(next(step), steps)

    groups, keys = [], telemetry.keys
    if flights:
        fleet = both_classes(actuator, telemetry, flights, 1_000_000 * seed, tick)
        groups.append(training_samples(fleet, keys, f"{2 * flights} simulated flights", say))
    given, conditions = "", dict[str, JsonValue]()
    if flown and precedents:
        given = f" --precedents {precedents.folder.name} --flown-weight {flown_weight:g}"
        conditions = {"precedent_logs": flown.logs.tolist(), "flown_weight": flown_weight}
        say(f"precedents: {flown.counts()}")
        groups.append(training_samples(of_precedents(flown, TRAINS), (), "precedents", say))
        # An ESC's telemetry leaves some samples without a sign: what most samples carry is learned from.
        carried = 2 * np.isfinite(groups[-1][0]).sum(axis=0) >= max(len(groups[-1][0]), 1)
        keys = tuple(key for key in keys if carried[column(key)])
    samples, classes, flight, keys, leaking = _examples(groups, keys)
    weights = np.where(flight < 0, flown_weight, 1.0)
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
        conditions=_simulated(actuator, flights)
        | conditions
        | {"not_offered": {**telemetry.withheld, **leaking}},
    )

    def flown_or_simulated(part: int) -> Iterator[Labelled]:
        if flown and by_flown:
            return (each for each in of_precedents(flown, part) if each.clear)
        of_part = 1_000_000 * seed + (_CALIBRATION if part == CALIBRATES else _MEASUREMENT)
        return whole_range(actuator, telemetry, 2 * flights, of_part, tick)

    event = (
        "the label friction_emergency, not normal, of precedents"
        if by_flown
        else f"friction above {middle_of(actuator.known_limits()):g} N·m, the middle between the limits"
    )
    parts = map(flown_or_simulated, (CALIBRATES, MEASURES))
    calibration, measured = calibrated(Model(result.network, card, ""), *parts, event=event)
    say(_metrics_text(card.metrics | measured, "precedents" if by_flown else "simulated flights"))
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


_POSITIONS = ("V1", "V2")
"""Quantities that follow the command: they are offered where their distributions show no class."""


def _examples(
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


_ALONE = 4
"""Flights that each class needs where precedents train alone: to train, choose, calibrate and measure."""


def _check_alone(flown: FlownFlights | None) -> None:
    """Refuse a training without simulated flights that has too few precedents."""
    counts = flown.counts() if flown else "no precedents"
    if flown is None or min(map(flown.flights_of, TAUGHT)) < _ALONE or not {*TAUGHT} <= {*flown.held_out}:
        raise MavhumsError(
            f"without simulated flights, normal and friction_emergency need {_ALONE} logs each: {counts}",
            "add logs with `mavhums precedents add`, or simulate too: --flights 24",
        )


def _metrics_text(metrics: dict[str, float], source: str) -> str:
    percent = {name: f"{100 * value:.2f} %" for name, value in metrics.items()}
    text = (
        f"network of samples: right {percent['training_accuracy']} of the samples trained on, "
        f"{percent['validation_accuracy']} of the samples that chose it, on {source} not trained on "
    )
    if "windows_right" not in metrics:
        return f"{text}nothing: it votes too rarely to be measured"
    return (
        f"{text}{percent['samples_in_motion_right']} of the samples in motion "
        f"({percent['samples_in_motion_abstained']} abstained), {percent['windows_right']} of the windows "
        f"({percent['windows_in_motion_abstained']} abstained)"
    )


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
