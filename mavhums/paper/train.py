"""Training of a model for an airframe on simulated flights and precedents; its calibration and metrics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import count

import numpy as np
from pydantic import JsonValue

from mavhums.actuator.profile import Airframe
from mavhums.core.arrays import Array
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import column
from mavhums.learn import (
    Calibration,
    Card,
    Model,
    Network,
    PrecedentBase,
    TrainingResult,
    WindowNetwork,
    brier_score,
    calibrate,
    expected_calibration_error,
    train_network,
)
from mavhums.paper.flights import TELEMETRY, ModelOptions, Training, moving_samples, windows
from mavhums.paper.flown import CALIBRATES, MEASURES, TAUGHT, TRAINS, FlownFlights
from mavhums.paper.samples import (
    Labelled,
    both_classes,
    examples_of,
    middle_of,
    of_precedents,
    simulated_conditions,
    training_samples,
    whole_range,
)
from mavhums.paper.windows import flight_counts, train_window_network

_WORKING = 20
"""Moving samples of a window in which a network is asked at all."""


class _Answers:
    """Answers of a network on flights of its own: votes on samples, and shares of votes in windows."""

    def __init__(self, model: Model, flights: Iterable[Labelled]) -> None:
        windows_of, votes, right = [np.empty((0, 4))], [np.empty(0, dtype=np.int8)], [np.empty(0, dtype=bool)]
        for actuator, history, _, event, clear in flights:
            for vote, moving in windows(actuator, [model], history):
                share = vote.p_fault if vote else np.nan
                windows_of.append(np.array([[share, event, clear, moving >= _WORKING]], dtype=np.float64))
            if clear:
                votes.append(model.votes(moving_samples(actuator, history)[0]))
                right.append(votes[-1] == event)
        found = np.concatenate(windows_of)
        decided = np.isfinite(found[:, 0])
        self.share, self.event, self.clear = found[decided, 0], found[decided, 1] > 0, found[decided, 2] > 0
        self.working = np.count_nonzero(found[:, 2:].all(axis=1))
        self.voted, self.right = np.concatenate(votes) >= 0, np.concatenate(right)

    def metrics(self, said: Array) -> dict[str, float]:
        """Return shares of samples and windows of the two classes, by the windows' probabilities."""
        right = ((said > 0.5) == self.event)[self.clear]
        found = {
            "samples_in_motion_right": self.right.sum() / max(self.voted.sum(), 1),
            "samples_in_motion_abstained": 1 - self.voted.sum() / max(len(self.voted), 1),
            "windows_right": right.mean() if right.size else 0.0,
            "windows_in_motion_abstained": 1 - right.size / max(self.working, 1),
        }
        return {name: round(float(value), 6) for name, value in found.items()}


def calibrated(
    model: Model, first_flights: Iterable[Labelled], other_flights: Iterable[Labelled], *, event: str
) -> tuple[Calibration | None, dict[str, float]]:
    """Calibrate on some flights and measure on others; nothing if the network votes too rarely."""
    first, second = _Answers(model, first_flights), _Answers(model, other_flights)
    if len(set(first.event)) < 2 or not len(second.share):
        return None, {}
    fitted = calibrate(first.share, first.event)
    said = np.array([fitted.probability(each) for each in second.share])
    metrics: dict[str, float] = {
        "windows_calibrated_with": len(first.share),
        "windows_measured": len(second.share),
    }
    for score in (brier_score, expected_calibration_error):
        metrics[f"{score.__name__}_of_the_share"] = round(score(second.share, second.event), 6)
        metrics[score.__name__] = round(score(said, second.event), 6)
    return fitted.model_copy(update={"event": event, "metrics": metrics}), second.metrics(said)


Progress = Callable[[int, int], None]


def train_model(
    airframe: Airframe,
    options: ModelOptions | None = None,
    *,
    precedents: PrecedentBase | None = None,
    report: Callable[[str], None] | None = None,
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
    place of the simulated ones (:class:`mavhums.paper.flown.FlownFlights`). Without simulated flights they
    train alone, which needs no constants and no limits; without constants there is no network of windows.

    Parameters
    ----------
    airframe
        Airframe profile; all its actuators must have the same constants and limits.
    options
        Telemetry, number of flights, seed, scheme, and weight of the precedents.
    precedents
        Labelled flights, as the paper intends. The networks omit quantities that they lack.
    report
        Called with a line about each stage when it is done.
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
    options, actuator, step = options or ModelOptions(), airframe.actuators[0], count(1)
    if any((other.ema, other.limits) != (actuator.ema, actuator.limits) for other in airframe.actuators):
        raise MavhumsError(
            f"the actuators of {airframe.name} differ", "train one model for each, with profiles of one kind"
        )
    if options.tier not in TELEMETRY:
        raise MavhumsError(
            f"no model is for telemetry {options.tier!r}", f"name one of: {', '.join(TELEMETRY)}"
        )
    flown = FlownFlights(precedents, airframe, seed=options.seed) if precedents else None
    if not options.flights:
        _check_alone(flown)
    elif actuator.blanks:
        raise MavhumsError(
            f"{airframe.name}: a simulation needs {' and '.join(actuator.blanks)} in the profile",
            "fill them in, or train on labelled logs alone: --flights 0 --precedents DIR",
        )
    by_flown = flown is not None and {*TAUGHT} <= {*flown.held_out}
    windows_flown = flight_counts(options.flights)
    steps = (2 if by_flown else 6) * options.flights
    steps += windows_flown[0] if flown and flown.held_out else sum(windows_flown)

    def tick() -> None:
        if progress:
            progress(next(step), steps)

    training = Training(actuator, options, flown, report or (lambda _: None), tick)
    given, conditions = "", simulated_conditions(actuator, options.flights)
    if flown and precedents:
        given = f" --precedents {precedents.folder.name} --flown-weight {options.flown_weight:g}"
        conditions |= {"precedent_logs": flown.logs.tolist(), "flown_weight": options.flown_weight}
        training.report(f"precedents: {flown.counts()}")
    result, not_offered = _sample_network(training)
    card = result.card(
        name=f"{airframe.name}-{options.tier}",
        airframe=airframe.name,
        tier=training.telemetry.gives,
        command=(
            f"mavhums train --airframe {airframe.name} --tier {options.tier} --flights {options.flights} "
            f"--seed {options.seed} {options.scheme.command}{given} -o MODEL"
        ),
        conditions=conditions | {"not_offered": not_offered},
    )

    def labelled(part: int) -> Iterator[Labelled]:
        _, own = training.sources(part, held_out=by_flown)
        if own is None:
            return whole_range(training, part)
        return (each for each in of_precedents(own, part) if each.clear)

    event = (
        "the label friction_emergency, not normal, of precedents"
        if by_flown
        else f"friction above {middle_of(actuator.known_limits()):g} N·m, the middle between the limits"
    )
    model = Model(result.network, card, "")
    calibration, measured = calibrated(model, labelled(CALIBRATES), labelled(MEASURES), event=event)
    training.report(_metrics_text(card.metrics | measured, "precedents" if by_flown else "simulated flights"))
    update: dict[str, object] = {"calibration": calibration, "metrics": card.metrics | measured}
    window = None
    if actuator.ema is None:
        training.report(
            "no network of windows: its statistics need the gear ratio, in [actuators.ema] of the profile"
        )
    else:
        window, update["window"] = train_window_network(training)
    return result.network, card.model_copy(update=update), window


def _sample_network(training: Training) -> tuple[TrainingResult[Network], dict[str, JsonValue]]:
    """Train the network of samples; return also why quantities are not offered to it."""
    groups, keys, flights = [], training.telemetry.keys, training.options.flights
    simulated, flown = training.sources(TRAINS, held_out=False)
    if simulated:
        source = f"{2 * flights} simulated flights"
        groups.append(training_samples(both_classes(training), keys, source, training.report))
    if flown:
        groups.append(training_samples(of_precedents(flown, TRAINS), (), "precedents", training.report))
        # An ESC's telemetry leaves some samples without a sign: what most samples carry is learned from.
        carried = 2 * np.isfinite(groups[-1][0]).sum(axis=0) >= max(len(groups[-1][0]), 1)
        keys = tuple(key for key in keys if carried[column(key)])
    samples, classes, flight, keys, leaking = examples_of(groups, keys)
    weights = np.where(flight < 0, training.options.flown_weight, 1.0)
    result = train_network(samples, classes, flight, training.stages(keys), weights=weights)
    return result, {**training.telemetry.withheld, **leaking}


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
