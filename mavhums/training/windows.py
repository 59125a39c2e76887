"""Simulated flights of every fault, for the network of windows: training, calibration and measurement."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue
from sklearn.metrics import confusion_matrix

from mavhums.actuator.profile import Actuator, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import (
    SUMS,
    WINDOW_FEATURES,
    of_window,
    shows_something,
    window_features,
)
from mavhums.health.estimation.motion import motion, window_sums
from mavhums.health.estimation.slots import SlotCutter, Windows, with_extra_columns
from mavhums.health.estimation.thresholds import WINDOW_SLOTS
from mavhums.learn import (
    LabelledWindows,
    Scheme,
    WindowCard,
    WindowNetwork,
    brier_score,
    expected_calibration_error,
    train_windows,
)
from mavhums.learn.evaluation import at_temperature, decides_at
from mavhums.training.flights import Telemetry, friction_range, parameters_of, reported
from mavhums_sim.conditions import Condition
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.flight import ActuatorRecord, Flight, fly
from mavhums_sim.manoeuvres import CYCLOGRAMS

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
_RATES_HZ = (100.0, 50.0, 25.0, 10.0)
_AIRCRAFT = 3
"""Aircraft that fly each cyclogram: their twelve actuators have every condition, so V1 reveals none."""
_CALIBRATION, _MEASUREMENT = 600_000, 800_000  # added to the seed


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
    still
        Number of further windows that show nothing: standing, or a sag that the supply never limits.
    """

    severity: Array
    cyclogram: Integers
    rate_hz: Array
    still: int


def classes_of(telemetry: Telemetry) -> tuple[str, ...]:
    """Return the conditions that a telemetry can show; without two angles there is no play and no bias."""
    return (*_FRICTION, *(name for name in SEVERITIES if not (telemetry.esc and name in _GEAR)))


def keys_of(telemetry: Telemetry) -> tuple[str, ...]:
    """Return the statistics that a telemetry provides."""
    lacks = {"instrumented": set(), "without-load": {"V11"}}.get(telemetry.name, {"V2", "V11"})
    return tuple(key for key, each in WINDOW_FEATURES.items() if not lacks & set(each.needs))


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
        rate = _RATES_HZ[number // len(CYCLOGRAMS) % len(_RATES_HZ)]
        group = _fly_group(actuator, classes, random, mode, rate, seed + 10 * number)
        for label, severity, record, signed in group:
            sums, ends = _sums(actuator, telemetry, record, signed=signed)
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
    return FlownWindows(found, labels, flight, severities, modes, rates, still)


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
    cyclogram = Flight(seed=seed, cyclogram=[*CYCLOGRAMS][mode]).fly_cyclogram()
    for craft in range(_AIRCRAFT):
        mine = labels[craft * len(SURFACES) :][: len(SURFACES)]
        drawn = [_draw(classes[label], actuator.known_limits(), random) for label in mine]
        flight = Flight(
            seed=seed + craft,
            friction_nm={name: (each[1], each[1]) for name, each in zip(SURFACES, drawn, strict=True)},
            rate_hz=rate_hz,
            parameters=parameters_of(actuator).two_masses(),
            cyclogram=cyclogram,
            conditions={name: each[2] for name, each in zip(SURFACES, drawn, strict=True)},
            individuals=seed + craft,
        )
        records = fly(flight).actuators.values()
        for k, (label, (severity, *_), record) in enumerate(zip(mine, drawn, records, strict=True)):
            yield label, severity, record, k % 2 == 0


def _draw(
    name: str, limits: Limits, random: np.random.Generator
) -> tuple[float, float, tuple[Condition, ...]]:
    """Return a severity of a condition, the friction, and the simulator's faults."""
    low, normal = friction_range(limits)[0], limits.normal
    between = dict(
        zip(
            _FRICTION,
            (
                (low, normal),
                (normal, limits.emergency),
                (limits.emergency, _WORST_PER_LIMIT * limits.emergency),
            ),
            strict=True,
        )
    )
    friction = random.uniform(*between.get(name, (low, normal)))
    winding = Condition.constant("resistance", random.uniform(0.0, _RESISTANCE))
    if name in between:
        return friction, friction, (winding,)
    fault, least, most = SEVERITIES[name]
    severity = float(np.exp(random.uniform(np.log(least), np.log(most))))
    signed = severity * random.choice([-1.0, 1.0]) if name == "sensor_bias" else severity
    own = Condition.constant(fault, signed)
    return severity, friction, (own,) if fault == "resistance" else (winding, own)


def _sums(
    actuator: Actuator, telemetry: Telemetry, record: ActuatorRecord, *, signed: bool
) -> tuple[Array, Integers]:
    """Return the sums of windows that do not overlap, shape (n, ``SUMS``), and their ends, s."""
    values = reported(actuator, telemetry, record, signed=signed)
    measured = np.ones(values.shape, dtype=np.bool_)
    if telemetry.esc:
        measured[:, [1, 2]] = False
    cutter, window = SlotCutter(), Windows(SUMS)
    sums, ends = [], []
    for slots in (cutter.feed(record.time_s, with_extra_columns(values, measured)), cutter.finish()):
        if slots is not None:
            found = of_window(window.feed(slots.index, window_sums(actuator, slots, motion(actuator, slots))))
            last = (slots.index + 1) % WINDOW_SLOTS == 0
            sums.append(found[last])
            ends.append(slots.index[last] + 1)
    return np.concatenate(sums), np.concatenate(ends)


def _limited(record: ActuatorRecord, ends: Integers, actuator: Actuator, sag_v: float) -> Flags:
    limit = parameters_of(actuator).supply_voltage - sag_v - _NEAR_V
    at_limit = np.abs(record.values[:, 3]) >= limit
    bounds = np.searchsorted(record.time_s, [ends - WINDOW_SLOTS, ends])
    shares = [at_limit[start:stop].mean() if stop > start else 0.0 for start, stop in bounds.T.tolist()]
    return np.array(shares, dtype=np.float64) >= _LIMITED


def train_window_network(
    actuator: Actuator,
    telemetry: Telemetry,
    flights: int,
    *,
    seed: int,
    scheme: Scheme,
    tell: Callable[[str], None],
    tick: Callable[[], None],
) -> tuple[WindowNetwork, WindowCard]:
    """Train the network of windows, calibrate it on other flights, and measure it on others again."""
    classes = classes_of(telemetry)
    sizes = flight_counts(flights)
    trained_on = fly_windows(actuator, telemetry, sizes[0], seed=1_000_000 * seed, tick=tick)
    result = train_windows(
        trained_on, classes=len(classes), keys=keys_of(telemetry), seed=seed, scheme=scheme, tell=tell
    )
    other = fly_windows(actuator, telemetry, sizes[1], seed=1_000_000 * seed + _CALIBRATION, tick=tick)
    network, temperature = at_temperature(result.network, other.features, other.classes)
    level = decides_at(network, other.features, other.classes, telemetry.goal)
    last = fly_windows(actuator, telemetry, sizes[2], seed=1_000_000 * seed + _MEASUREMENT, tick=tick)
    metrics, confusion = measure(network, last, classes, level)
    tell(
        f"windows of flights not trained on: {100 * metrics['decided_right']:.2f} % of the decided right, "
        f"{100 * metrics['abstained']:.1f} % abstained"
    )
    conditions: dict[str, JsonValue] = {
        "cyclograms": sizes[0],
        "windows": len(trained_on),
        "friction_nm": "normal, degraded, and emergency up to 1.5 times its limit",
        "severities": {name: [low, high] for name, (_, low, high) in SEVERITIES.items() if name in classes},
        "rates_hz": [*_RATES_HZ],
        "temperature": temperature,
        "hidden": len(network.b1),
        "networks": len(result.candidates),
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


def flight_counts(flights: int) -> tuple[int, int, int]:
    """Return the numbers of cyclograms for training, calibration and measurement."""
    return 4 * flights, 2 * flights, 2 * flights


def measure(
    network: WindowNetwork, windows: FlownWindows, classes: tuple[str, ...], level: float
) -> tuple[dict[str, float], dict[str, dict[str, int]]]:
    """Return shares of windows, and how many of each condition are decided as which."""
    found, inside = network.probabilities(windows.features), network.inside(windows.features)
    truth, said = windows.classes, found.argmax(axis=1)
    whole = np.isfinite(found).all(axis=1)
    top = np.where(whole, found.max(axis=1), 0.0)
    decided = inside & (top >= level)
    right = said == truth
    emergency = found[whole, classes.index(_FRICTION[-1])]
    metrics = {
        "windows": float(len(windows)),
        "windows_that_show_nothing": float(windows.still),
        "right": float(right.mean()),
        "decided_right": float(right[decided].mean()) if decided.any() else 0.0,
        "abstained": float(1 - decided.mean()),
        "outside": float(1 - inside.mean()),
        "expected_calibration_error": expected_calibration_error(top[whole], right[whole]),
        "brier_score_of_an_emergency": brier_score(emergency, truth[whole] == 2),
    }
    told = np.where(decided, said, len(classes))
    names = (*classes, "abstained")
    table = confusion_matrix(truth, told, labels=np.arange(len(names)))
    confusion = {
        name: {names[k]: int(count) for k, count in enumerate(row) if count}
        for name, row in zip(classes, table, strict=False)
    }
    return {name: round(value, 6) for name, value in metrics.items()}, confusion
