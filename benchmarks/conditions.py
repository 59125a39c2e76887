"""Effect and detectability of each condition: ``python benchmarks/conditions.py [--picture FILE.png]``.

The elevator of the two-mass EMA flies 40 s of gusts, healthy and degraded, with the same commands.

First table: the shift of V1…V12, the root mean square difference that a condition makes without
sensor noise, over the noise of one sample.

Second table: what an engineer would compute from each tier of telemetry over one such flight, and the
smallest severity that moves it by twice its healthy scatter: between flights of one actuator (its own
baseline is known), and between flights of different healthy individuals (it is not).

The picture needs matplotlib.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from math import inf
from pathlib import Path

import numpy as np

from mavhums.core.arrays import Array
from mavhums_sim import EmaParameters, Flight, fly
from mavhums_sim.conditions import FAULTS, Condition
from mavhums_sim.flight import ActuatorRecord
from mavhums_sim.sensors import ELECTRONICS_A, SensorNoise, sense_esc

Features = dict[str, float]

SURFACE = "elevator"
CLEAR = {
    "friction": 0.15,
    "backlash": 0.3,
    "resistance": 0.2,
    "torque_constant": 0.1,
    "supply_sag": 6.0,
    "sensor_bias": 0.5,
    "jam": 10.0,
}
LARGEST = {"resistance": 1.0, "torque_constant": 0.6, "supply_sag": 24.0, "jam": 10.0}
QUANTITIES = [*(f"V{k}" for k in range(1, 13)), "V3−V2/N"]
PAPER = EmaParameters.from_data_sheet().two_masses()
RESISTANCE, CONSTANT = PAPER.resistance, PAPER.torque_per_ampere
REV_MIN = np.pi / 30.0 / PAPER.gear_ratio  # of the rotor, as the output shaft's rad/s
HEALTHY = Flight(seed=2, duration_s=40.0, cyclogram="gusts", parameters=PAPER)
QUIET = replace(HEALTHY, noise=SensorNoise.none())


def degraded(flight: Flight, fault: str, severity: float) -> Flight:
    return replace(flight, conditions={SURFACE: (Condition.constant(fault, severity),)})


@cache
def quantities(fault: str, severity: float, noisy: bool = False) -> Array:
    """V1…V12 and V3−V2/N of the one flight, shape (n, 13)."""
    flight = HEALTHY if noisy else QUIET
    record = fly(degraded(flight, fault, severity)).actuators[SURFACE]
    apart = record.values[:, 2] - record.values[:, 1] / PAPER.gear_ratio
    return np.column_stack([record.values, apart])


def shifts(fault: str, severity: float) -> Array:
    """Shift of each quantity over the noise of one sample; V1 has none. Shape (13,)."""
    healthy = quantities("friction", 0.0)
    noise = np.sqrt(np.mean((quantities("friction", 0.0, noisy=True) - healthy) ** 2, axis=0))
    shift = np.sqrt(np.mean((quantities(fault, severity) - healthy) ** 2, axis=0))
    ratio: Array = np.divide(shift, noise, out=np.zeros_like(shift), where=noise > 0)
    return ratio


def shift_table() -> Iterator[str]:
    """Yield the shifts but for V1, which never changes, and V8, which is V5 in other units."""
    shown = [k for k, name in enumerate(QUANTITIES) if name not in ("V1", "V8")]
    names = [QUANTITIES[k].replace("V5", "V5, V8") for k in shown]
    yield f"| condition | {' | '.join(names)} |"
    yield "|---" * (len(names) + 1) + "|"
    for fault, severity in CLEAR.items():
        cells = " | ".join(f"{shifts(fault, severity)[k]:.1f}" for k in shown)
        name = f"{fault} {severity:g} {FAULTS[fault].unit.replace('1', '')}".rstrip()
        yield f"| {name} | {cells} |"


def balance(time: Array, amperes: Array, speed: Array, load: list[Array]) -> float:
    """T_c, N·m, from k·I = T_c·sgn ω + J·dω/dt + load over moving samples."""
    moving = np.abs(speed) > 0.05
    terms = np.column_stack([np.sign(speed), np.gradient(speed, time), *load])
    return float(np.linalg.lstsq(terms[moving], CONSTANT * amperes[moving], rcond=None)[0][0])


def following(time: Array, command: Array, speed: Array) -> float:
    """Speed divided by commanded speed: 1 if the shaft follows, 0 if it does not move."""
    wanted = np.interp(time - 0.05, time, np.gradient(command, time))
    return float(wanted @ speed / (wanted @ wanted))


def instrumented(record: ActuatorRecord) -> Features:
    time, v = record.time_s, record.values
    speed = v[:, 6] * REV_MIN
    (resistance, constant), *_ = np.linalg.lstsq(np.column_stack([v[:, 4], speed]), v[:, 3], rcond=None)
    apart = v[:, 2] - v[:, 1] / PAPER.gear_ratio
    low, high = np.percentile(apart, [5, 95])
    torque = balance(time, v[:, 4] - v[:, 10] / CONSTANT, speed, [np.ones_like(time)])
    return {
        "T_c": torque,
        "R": float(resistance),
        "k_e": float(constant),
        "spread of V3−V2/N": float(high - low),
        "mean of V3−V2/N": float(np.mean(apart)),
        "highest V4": float(np.percentile(np.abs(v[:, 3]), 99.8)),
        "following": following(time, np.radians(v[:, 0]), speed),
    }


def _esc(record: ActuatorRecord) -> tuple[Array, Array, Array, Array, Array]:
    """Time, command, and volts, amperes, rad/s of every fifth sample: 20 Hz."""
    volts, amperes, speed = record.esc[::5].T
    command = np.radians(record.values[::5, 0])
    return record.time_s[::5], command, volts, amperes, speed * REV_MIN


def _from_esc(time: Array, command: Array, volts: Array, amperes: Array, speed: Array) -> Features:
    (resistance, constant), *_ = np.linalg.lstsq(np.column_stack([amperes, speed]), volts, rcond=None)
    return {
        "T_c": balance(time, amperes, speed, [np.ones_like(time), command]),
        "R": float(resistance),
        "k_e": float(constant),
        "highest V4": float(np.percentile(np.abs(volts), 99.8)),
        "following": following(time, command, speed),
    }


def esc_signed(record: ActuatorRecord) -> Features:
    return _from_esc(*_esc(record))


def esc_unsigned(record: ActuatorRecord) -> Features:
    """Magnitudes; the sign of the motion is the command's, that of the current follows from the voltage."""
    time, command, volts, amperes, speed = _esc(record)
    direction = np.sign(np.interp(time - 0.05, time, np.gradient(command, time)))
    volts, amperes = (np.abs(np.round(signal, 2)) for signal in (volts, amperes))
    speed = np.abs(np.round(speed / REV_MIN) * REV_MIN)
    drop, back_emf = RESISTANCE * amperes, CONSTANT * speed
    braking = np.abs(volts - np.abs(drop - back_emf)) < np.abs(volts - drop - back_emf)
    current = amperes * np.where(braking, -direction, direction)
    voltage = volts * np.where(braking, np.sign(back_emf - drop), 1.0) * direction
    return _from_esc(time, command, voltage, current, speed * direction)


def esc_bus(record: ActuatorRecord) -> Features:
    """Bus voltage and current: the motor's current is the root of R·I² + k·ω·I = P nearest the load."""
    rng = np.random.default_rng(record.time_s.size)
    bus = sense_esc(record.motion, PAPER, record.time_s, record.values, rng, SensorNoise(), "bus")
    time, command, volts, amperes, speed = _esc(replace(record, esc=bus))
    power = volts * (amperes - ELECTRONICS_A)
    root = np.sqrt(np.maximum((CONSTANT * speed) ** 2 + 4 * RESISTANCE * power, 0.0))
    roots = (np.stack([root, -root]) - CONSTANT * speed) / (2 * RESISTANCE)
    loaded = np.argmin(np.abs(roots - 0.3 * np.sign(command)), axis=0)
    current = np.take_along_axis(roots, loaded[None], axis=0)[0]
    return {
        "T_c": balance(time, current, speed, [np.ones_like(time), command]),
        "V_bus": float(np.mean(volts)),
        "following": following(time, command, speed),
    }


TIERS = {
    "instrumented, named": instrumented,
    "esc-signed": esc_signed,
    "esc-unsigned": esc_unsigned,
    "esc, bus side": esc_bus,
}
SEEDS = range(20, 28)


@cache
def features(fault: str, severity: float, seed: int, individual: int | None = None) -> dict[str, Features]:
    flight = degraded(replace(HEALTHY, seed=seed, individuals=individual), fault, severity)
    record = fly(flight).actuators[SURFACE]
    return {tier: compute(record) for tier, compute in TIERS.items()}


def smallest(fault: str, tier: str, *, baseline: bool) -> tuple[float, str]:
    """Smallest severity that shifts a feature by twice its healthy scatter, and the feature."""
    found, by = inf, ""
    severities = np.geomspace(0.01, 1.0, 13) * LARGEST.get(fault, 1.0)
    for name in features("friction", 0.0, SEEDS[0])[tier]:
        flights = [features("friction", 0.0, s, None if baseline else s)[tier][name] for s in SEEDS]
        scatter = 2.0 * float(np.std(flights, ddof=1))
        for severity in severities:
            moved = [
                features(fault, float(severity), s)[tier][name] - features("friction", 0.0, s)[tier][name]
                for s in SEEDS[:2]
            ]
            if abs(np.mean(moved)) > scatter and severity < found:
                found, by = float(severity), name
    return found, by


def severity_table() -> Iterator[str]:
    yield f"| condition, unit | {' | '.join(TIERS)} |"
    yield "|---" * (len(TIERS) + 1) + "|"
    for fault in CLEAR:
        cells = []
        for tier in TIERS:
            both = [smallest(fault, tier, baseline=known) for known in (True, False)]
            least = 0.01 * LARGEST.get(fault, 1.0)
            said = [f"{'≤ ' if x <= least else ''}{x:.2g} ({by})" if x < inf else "never" for x, by in both]
            cells.append("; ".join(said) if said[0] != said[1] else said[0])
        yield f"| {fault}, {FAULTS[fault].unit.replace('1', 'share')} | {' | '.join(cells)} |"


def picture(path: Path) -> None:
    """Plot an informative quantity under each condition, and the shifts of all quantities."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(4, 2, figsize=(11, 9), layout="constrained")
    time = fly(QUIET).actuators[SURFACE].time_s
    shown = (time > 10.0) & (time < 14.0)
    informative = dict(zip(CLEAR, ("V5", "V3−V2/N", "V4", "V5", "V4", "V3−V2/N", "V3"), strict=True))
    units = {"V3": "°", "V3−V2/N": "°", "V4": "V", "V5": "A"}
    for axis, (fault, severity) in zip(axes.flat, CLEAR.items(), strict=False):
        name = informative[fault]
        column = QUANTITIES.index(name)
        axis.plot(time[shown], quantities("friction", 0.0)[shown, column], color="0.6", label="healthy")
        worn = quantities(fault, severity)[shown, column]
        axis.plot(
            time[shown], worn, color="tab:red", lw=1, label=f"{fault} {severity:g} {FAULTS[fault].unit}"
        )
        axis.set_ylabel(f"{name}, {units[name]}")
        axis.legend(loc="upper right", fontsize=7)
    last = axes.flat[-1]
    table = np.stack([shifts(fault, severity) for fault, severity in CLEAR.items()])
    image = last.imshow(np.log10(np.maximum(table, 0.1)), cmap="viridis", aspect="auto", vmin=-1, vmax=2)
    last.set_xticks(range(len(QUANTITIES)), QUANTITIES, rotation=60, fontsize=7)
    last.set_yticks(range(len(CLEAR)), list(CLEAR), fontsize=7)
    bar = figure.colorbar(image, ax=last, ticks=[-1, 0, 1, 2])
    bar.ax.set_yticklabels(["≤0.1", "1", "10", "≥100"])
    bar.set_label("shift / noise of a sample", fontsize=7)
    figure.supxlabel("flight time, s")
    figure.savefig(path, dpi=90)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path, metavar="FILE.png")
    picture_file = parser.parse_args().picture
    print("Shift over the noise of one sample, all quantities measured:\n")
    print("\n".join(shift_table()))
    print("\nSmallest severity shown in 40 s, with own baseline; without it:\n")
    print("\n".join(severity_table()))
    if picture_file:
        picture(picture_file)


if __name__ == "__main__":
    main()
