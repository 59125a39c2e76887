"""Simulated flights of every fault, for the network of windows: training, calibration and measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np
from pydantic import JsonValue
from sklearn.metrics import confusion_matrix

from mavhums.actuator.profile import Actuator, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import (
    SUMS,
    WINDOW_FEATURES,
    WINDOW_KEYS,
    of_window,
    shows_something,
    window_features,
)
from mavhums.health.estimation.motion import motion, window_sums
from mavhums.health.estimation.slots import SlotCutter, Windows, with_extra_columns
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.learn import (
    LabelledWindows,
    WindowCard,
    WindowNetwork,
    brier_score,
    expected_calibration_error,
    train_windows,
)
from mavhums.learn.evaluation import at_temperature, decides_at
from mavhums.paper.flights import (
    RATES_HZ,
    Telemetry,
    Training,
    friction_range,
    parameters_of,
    reported,
)
from mavhums.paper.flown import CALIBRATES, MEASURES, PURPOSE, TRAINS, FlownFlights
from mavhums_sim.conditions import Condition
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.ema import EmaParameters, Gearbox
from mavhums_sim.flight import ActuatorRecord, Flight, fly
from mavhums_sim.manoeuvres import CYCLOGRAMS
from mavhums_sim.sensors import SensorNoise

SEVERITIES = {
    "winding_resistance": ("resistance", 0.2, 2.0),
    "torque_constant": ("torque_constant", 0.15, 0.5),
    "backlash": ("backlash", 0.15, 1.5),
    "supply_sag": ("supply_sag", 12.0, 24.0),
    "sensor_bias": ("sensor_bias", 0.5, 5.0),
    "jam": ("jam", 8.0, 12.0),
}
"""Fault of the simulator and range of its severity, by class; severities are drawn log-uniformly."""

_FRICTION = ("normal", "friction_degraded", "friction_emergency")
_WORST_PER_LIMIT = 1.5
_RESISTANCE = 0.08
"""Largest gain of a winding's resistance that is no fault: every actuator without that fault has less."""

_GEAR = ("backlash", "sensor_bias")
"""What two angles show that are measured apart."""

_LIMITED = 0.05
"""Share of the samples at the supply's limit from which a window shows a sag; below it nothing differs."""
_NEAR_V = 0.6
_TRAVEL = np.radians(25.0)
_AIRCRAFT = 3
"""Aircraft that fly each cyclogram: their twelve actuators have every condition, so V1 reveals none."""
_SEEDS = (0, 600_000, 800_000)
"""Added to the seed of flights that train, calibrate and measure."""


@dataclass(frozen=True, eq=False)
class FlownWindows(LabelledWindows):
    """Windows of simulated flights, and what is known of each; arrays of shape (n,).

    Attributes
    ----------
    severity
        Friction, N·m, or severity of the fault in its unit.
    cyclogram
        Index of the cyclogram.
    rate_hz
        Rate of the log.
    """

    severity: Array
    cyclogram: Integers
    rate_hz: Array


def classes_of(telemetry: Telemetry) -> tuple[str, ...]:
    """Return the conditions that a telemetry can show; without two angles there is no play and no bias."""
    return (*_FRICTION, *(name for name in SEVERITIES if not (telemetry.esc and name in _GEAR)))


def keys_of(telemetry: Telemetry) -> tuple[str, ...]:
    """Return the statistics that a telemetry provides."""
    lacks = {"instrumented": set(), "without-load": {"V11"}}.get(telemetry.name, {"V2", "V11"})
    return tuple(key for key, needs in WINDOW_FEATURES.items() if not lacks & set(needs))


def fly_windows(
    actuator: Actuator,
    telemetry: Telemetry,
    cyclograms: int,
    *,
    seed: int,
    tick: Callable[[], None] = lambda: None,
) -> FlownWindows:
    """Fly every condition over each of several cyclograms; return windows of 10 s that do not overlap.

    Parameters
    ----------
    actuator, telemetry
        The actuator's type, and how it is reported.
    cyclograms
        Number of cyclograms, of all modes in turn and at 100, 50, 25 and 10 Hz in turn.
    seed
        Of the first cyclogram and its three aircraft.
    tick
        Called after each cyclogram.
    """
    classes, parts, still = classes_of(telemetry), [], 0
    for number in range(cyclograms):
        random = np.random.default_rng([seed, number])
        mode = number % len(CYCLOGRAMS)
        rate = RATES_HZ[number // len(CYCLOGRAMS) % len(RATES_HZ)]
        group = _fly_group(actuator, classes, random, mode, rate, seed + 10 * number)
        for label, severity, record, signed in group:
            seen = reported(actuator, telemetry, record, signed=signed)
            sums, ends = _sums_of(actuator, record.time_s, *seen)
            asked = shows_something(sums)
            if classes[label] == "supply_sag":
                asked &= _limited(record, ends, actuator, severity)
            features = window_features(sums[asked])
            kept = len(features)
            still += len(sums) - kept
            rows = (label, number, severity, mode, rate)
            parts.append((features, *(np.full(kept, value) for value in rows)))
        tick()
    found, labels, flight, severities, modes, rates = map(np.concatenate, zip(*parts, strict=True))
    return FlownWindows(found, labels, flight, severities, modes, rates, still=still)


def _fly_group(
    actuator: Actuator,
    classes: tuple[str, ...],
    random: np.random.Generator,
    mode: int,
    rate_hz: float,
    seed: int,
) -> Iterator[tuple[int, float, ActuatorRecord, bool]]:
    """Fly one cyclogram with several aircraft: every condition once, and those of friction again."""
    total = _AIRCRAFT * len(SURFACES)
    labels = random.permutation(np.resize([*range(len(classes)), 0, 1, 2], total)).tolist()
    flown = Flight(seed=seed, cyclogram=[*CYCLOGRAMS][mode]).fly_cyclogram()
    moved, faster = _spread(random, 2)
    moves = {name: np.clip(moved * each, -_TRAVEL, _TRAVEL) for name, each in flown.commands.items()}
    cyclogram = replace(flown, commands=moves, airspeed=faster**0.5 * flown.airspeed)
    for craft in range(_AIRCRAFT):
        mine = labels[craft * len(SURFACES) :][: len(SURFACES)]
        names = [classes[label] for label in mine]
        drawn = [_draw(name, actuator.known_limits(), random) for name in names]
        flight = Flight(
            seed=seed + craft,
            friction_nm={name: (each[1], each[1]) for name, each in zip(SURFACES, drawn, strict=True)},
            rate_hz=rate_hz,
            noise=SensorNoise(*_spread(random) * astuple(SensorNoise())),
            parameters=_geared(parameters_of(actuator), random, rigid="backlash" not in names),
            cyclogram=cyclogram,
            conditions={name: each[2] for name, each in zip(SURFACES, drawn, strict=True)},
            individuals=seed + craft,
        )
        records = fly(flight).actuators.values()
        for k, (label, (severity, *_), record) in enumerate(zip(mine, drawn, records, strict=True)):
            yield label, severity, record, k % 2 == 0


def _spread(random: np.random.Generator, count: int = 1) -> Array:
    """Return factors between a half and twice: of what differs between aircraft, pilots and sensors."""
    return np.exp2(random.uniform(-1.0, 1.0, count))


def _geared(parameters: EmaParameters, random: np.random.Generator, *, rigid: bool) -> EmaParameters:
    """Return the actuator with a gear of its own: every third is rigid, where its play is no fault."""
    if rigid and random.random() < 1 / 3:
        return parameters
    gear, (stiff, play, surface) = Gearbox(), _spread(random, 3)
    return parameters.two_masses(
        replace(
            gear,
            stiffness=stiff * gear.stiffness,
            backlash=play * gear.backlash,
            surface_inertia=surface * gear.surface_inertia,
        )
    )


def _draw(
    name: str, limits: Limits, random: np.random.Generator
) -> tuple[float, float, tuple[Condition, ...]]:
    """Return a severity of a condition, the friction, and the simulator's faults."""
    low, normal = friction_range(limits)[0], limits.normal
    between = {
        "normal": (low, normal),
        "friction_degraded": (normal, limits.emergency),
        "friction_emergency": (limits.emergency, _WORST_PER_LIMIT * limits.emergency),
    }
    friction = random.uniform(*between.get(name, (low, normal)))
    winding = Condition.constant("resistance", random.uniform(0.0, _RESISTANCE))
    if name in between:
        return friction, friction, (winding,)
    fault, least, most = SEVERITIES[name]
    severity = float(np.exp(random.uniform(np.log(least), np.log(most))))
    signed = severity * random.choice([-1.0, 1.0]) if name == "sensor_bias" else severity
    own = Condition.constant(fault, signed)
    return severity, friction, (own,) if fault == "resistance" else (winding, own)


def _sums_of(
    actuator: Actuator, time_s: Array, values: Array, measured: Flags, magnitudes: Array | None = None
) -> tuple[Array, Integers]:
    """Return the sums of windows that do not overlap, shape (n, ``SUMS``), and their ends, s."""
    cutter, window = SlotCutter(), Windows(SUMS)
    sums, ends = [np.empty((0, SUMS))], [np.empty(0, dtype=np.int64)]
    columns = with_extra_columns(values, measured, magnitudes=magnitudes)
    for slots in (cutter.feed(time_s, columns), cutter.finish()):
        if slots is not None:
            found = of_window(window.feed(slots.index, window_sums(actuator, slots, motion(actuator, slots))))
            last = (slots.index + 1) % WINDOW_S == 0
            sums.append(found[last])
            ends.append(slots.index[last] + 1)
    return np.concatenate(sums), np.concatenate(ends)


def _limited(record: ActuatorRecord, ends: Integers, actuator: Actuator, sag_v: float) -> Flags:
    limit = parameters_of(actuator).supply_voltage - sag_v - _NEAR_V
    at_limit = np.abs(record.values[:, 3]) >= limit
    bounds = np.searchsorted(record.time_s, [ends - WINDOW_S, ends])
    shares = [at_limit[start:stop].mean() if stop > start else 0.0 for start, stop in bounds.T.tolist()]
    return np.array(shares, dtype=np.float64) >= _LIMITED


def flown_windows(flown: FlownFlights, part: int, classes: Sequence[str]) -> LabelledWindows:
    """Return those windows of precedents that show something; a label that is no class is left out."""
    features, rows, still = [np.empty((0, len(WINDOW_KEYS)))], [np.empty((0, 2), dtype=np.int64)], 0
    for each in flown.read(part, classes):
        sums, _ = _sums_of(each.actuator, each.time_s, each.values, each.measured)
        asked = shows_something(sums)
        still += len(sums) - int(asked.sum())
        features.append(window_features(sums[asked]))
        # Below zero: no simulated flight has such a number.
        rows.append(np.tile((classes.index(each.label), -1 - each.flight), (len(features[-1]), 1)))
    label, flight = np.concatenate(rows).T
    return LabelledWindows(np.concatenate(features), label, flight, still=still)


def train_window_network(training: Training) -> tuple[WindowNetwork, WindowCard]:
    """Train the network of windows, calibrate it on other flights, and measure it on others again.

    Precedents train beside the simulated flights, or alone if no flights are simulated; if some are held out,
    they calibrate and measure in place of simulated flights.
    """
    options, telemetry, flown = training.options, training.telemetry, training.flown
    classes = classes_of(telemetry) if options.flights or flown is None else flown.labels
    trained_on = _windows_of(training, TRAINS, classes)
    by_flown = trained_on.flights < 0
    known = ~np.isnan(trained_on.features[by_flown]) if flown else np.ones((1, len(WINDOW_KEYS)), dtype=bool)
    # Of what the precedents mostly lack, no window of this aircraft would be asked.
    carried = 2 * known.sum(axis=0) >= len(known)
    keys = tuple(key for key in keys_of(telemetry) if carried[WINDOW_KEYS.index(key)])
    weights = np.where(by_flown, options.flown_weight, 1.0)
    result = train_windows(trained_on, len(classes), training.stages(keys), weights=weights)
    other = _windows_of(training, CALIBRATES, classes)
    network = WindowNetwork(keys=result.inputs, **result.network.tensors)
    network, temperature = at_temperature(network, other.features, other.classes)
    level = decides_at(network, other.features, other.classes, telemetry.goal)
    metrics, confusion = measure(network, _windows_of(training, MEASURES, classes), classes, level)
    training.report(
        f"network of windows, on {'precedents' if _held_out(flown) else 'simulated flights'} not trained on: "
        f"{100 * metrics['decided_right']:.2f} % of the decided windows right, "
        f"{100 * metrics['abstained']:.1f} % abstained"
    )
    conditions: dict[str, JsonValue] = {
        "cyclograms": flight_counts(options.flights)[TRAINS],
        "windows": len(trained_on),
        "temperature": temperature,
        "hidden": len(network.b1),
        "networks": len(result.candidates),
    }
    if options.flights:
        conditions |= {
            "friction_nm": "normal, degraded, and emergency up to 1.5 times its limit",
            "severities": {
                name: [low, high] for name, (_, low, high) in SEVERITIES.items() if name in classes
            },
            "rates_hz": [*RATES_HZ],
        }
    return network, WindowCard(
        features=network.keys,
        classes=classes,
        decides_at=level,
        conditions=conditions,
        metrics=metrics,
        confusion=confusion,
        selection=result.selection,
    )


def _held_out(flown: FlownFlights | None) -> bool:
    return flown is not None and bool(flown.held_out)


def _windows_of(training: Training, part: int, classes: tuple[str, ...]) -> LabelledWindows:
    """Return the windows of a part's flights, simulated and flown."""
    groups: list[LabelledWindows] = []
    simulated, flown = training.sources(part, held_out=_held_out(training.flown))
    if simulated:
        size, seed = flight_counts(training.options.flights)[part], 1_000_000 * training.options.seed
        groups.append(
            fly_windows(
                training.actuator, training.telemetry, size, seed=seed + _SEEDS[part], tick=training.tick
            )
        )
    if flown:
        groups.append(flown_windows(flown, part, classes))
    names = ("features", "classes", "flights")
    joined = (np.concatenate([getattr(each, name) for each in groups]) for name in names)
    windows = LabelledWindows(*joined, still=sum(each.still for each in groups))
    own = np.count_nonzero(windows.flights < 0)
    training.report(
        f"windows that {PURPOSE[part]}: {len(windows) - own} of simulated flights, {own} of precedents"
    )
    if not len(windows):
        raise MavhumsError(
            f"no window of the flights that {PURPOSE[part]} shows anything",
            "add logs of flights in which the surfaces move both ways for twenty seconds or more",
        )
    return windows


def flight_counts(flights: int) -> tuple[int, int, int]:
    """Return the numbers of cyclograms for training, calibration and measurement."""
    return 8 * flights, 2 * flights, 2 * flights


def measure(
    network: WindowNetwork, windows: LabelledWindows, classes: tuple[str, ...], level: float
) -> tuple[dict[str, float], dict[str, dict[str, int]]]:
    """Return shares of windows, and how many of each condition are decided as which."""
    found, inside = network.probabilities(windows.features), network.inside(windows.features)
    truth, said = windows.classes, found.argmax(axis=1)
    whole = np.isfinite(found).all(axis=1)
    top = np.where(whole, found.max(axis=1), 0.0)
    decided = inside & (top >= level)
    right = said == truth
    gravest = classes.index(_FRICTION[-1])
    metrics = {
        "windows": float(len(windows)),
        "windows_that_show_nothing": float(windows.still),
        "right": float(right.mean()),
        "decided_right": float(right[decided].mean()) if decided.any() else 0.0,
        "abstained": float(1 - decided.mean()),
        "outside": float(1 - inside.mean()),
        "expected_calibration_error": expected_calibration_error(top[whole], right[whole]),
        "brier_score_of_an_emergency": brier_score(found[whole, gravest], truth[whole] == gravest),
    }
    answers = np.where(decided, said, len(classes))
    names = (*classes, "abstained")
    table = confusion_matrix(truth, answers, labels=np.arange(len(names)))
    confusion = {
        name: {names[k]: int(count) for k, count in enumerate(row) if count}
        for name, row in zip(classes, table, strict=False)
    }
    return {name: round(value, 6) for name, value in metrics.items()}, confusion
