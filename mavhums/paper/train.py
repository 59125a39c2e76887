"""Training of a model for an airframe on simulated flights and precedents."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from itertools import count

import numpy as np
from pydantic import JsonValue

from mavhums.actuator.profile import Actuator, Airframe
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import column
from mavhums.learn import (
    Card,
    CommandLeakWarning,
    Model,
    Network,
    PrecedentBase,
    Scheme,
    WindowNetwork,
    check_command,
    train_network,
)
from mavhums.paper.flights import TELEMETRY, friction_range
from mavhums.paper.flown import CALIBRATES, MEASURES, TAUGHT, TRAINS, FlownFlights
from mavhums.paper.samples import (
    Labelled,
    both_classes,
    calibrated,
    middle_of,
    of_precedents,
    training_samples,
    whole_range,
)
from mavhums.paper.windows import flight_counts, train_window_network
from mavhums_sim.manoeuvres import CYCLOGRAMS

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
    place of the simulated ones (:class:`mavhums.paper.flown.FlownFlights`). Without simulated flights they
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
