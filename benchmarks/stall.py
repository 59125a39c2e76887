"""Share of stall and torque reserve against the truth: ``python benchmarks/stall.py [--first 20]``.

Flights of 100 s at 50 Hz by two-mass individuals, written as .tlog with ESC_STATUS and analysed with a
profile that knows the supply's voltage and nothing else. Tuned on aircraft 0–2;
the seeds of aircraft from ``--first`` on were never used.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import mavhums
from benchmarks._fleet import MODES
from mavhums.health.estimation.motor_identification import identified
from mavhums.health.self_baseline.motor import friction_current, shares
from mavhums.results.verdict import STALL_SHARES, Interval, OwnRecord
from mavhums_sim import Flight, Gearbox, fly
from mavhums_sim.ema import EmaParameters
from mavhums_sim.telemetry import write_tlog

PARAMETERS = EmaParameters.from_data_sheet(gearbox=Gearbox())
STALL_A = PARAMETERS.supply_voltage / PARAMETERS.resistance
SURFACES = ("aileron_left", "aileron_right", "elevator", "rudder")
SETTLED_S = 1.0  # the simulated servo jumps to its first command
FRICTION, TORQUE = STALL_SHARES
Shown = tuple[Interval, float]
"""An estimate, and the truth."""


def profile() -> str:
    servos = (
        f'[[actuators]]\nname = "{surface}"\nservo = {k + 1}\nesc = {k}\npwm_us = [1000, 1500, 2000]\n'
        f"supply_voltage = {PARAMETERS.supply_voltage:g}\n"
        for k, surface in enumerate(SURFACES)
    )
    return "".join(['name = "blank"\n', *servos])


def row(name: str, shown: dict[str, list[Shown]], volts: list[float]) -> str:
    cells = [name, f"{np.mean(volts):.0%} ({min(volts):.0%}–{max(volts):.0%})"]
    for fault in STALL_SHARES:
        errors = [value.estimate / truth - 1.0 for value, truth in shown[fault]]
        inside = np.mean([value.low <= truth <= value.high for value, truth in shown[fault]])
        truths = np.mean([truth for _, truth in shown[fault]])
        cells += [f"{truths:.1%}", f"{np.mean(errors):+.1%} ± {np.std(errors):.1%}", f"{inside:.0%}"]
    return f"| {' | '.join(cells)} |"


def table(args: argparse.Namespace, folder: Path) -> Iterator[str]:
    titles = (f"{name}, {cell}" for name in ("friction", "torque") for cell in ("truth", "error", "inside"))
    yield f"| flight | V4 of the supply's | {' | '.join(titles)} |\n{'|---' * 8}|"
    kept: dict[tuple[int, str], list[OwnRecord]] = defaultdict(list)
    known: dict[tuple[int, str], list[float]] = defaultdict(list)
    blank, path = folder / "blank.toml", folder / "flight.tlog"
    blank.write_text(profile(), encoding="utf-8")
    for number, mode in enumerate(MODES):
        shown: dict[str, list[Shown]] = defaultdict(list)
        volts: list[float] = []
        for aircraft in range(args.first, args.first + args.aircraft):
            flight = Flight(
                seed=97_000 + 100 * aircraft + number,
                duration_s=100.0,
                rate_hz=50.0,
                parameters=PARAMETERS,
                individuals=aircraft,
                cyclogram=mode,
                tiers=("esc-signed", "pwm"),
            )
            record = fly(flight)
            write_tlog(record, path)
            for verdict in mavhums.analyse(path, mavhums.Options(airframe=blank)).verdicts:
                if verdict.subject != "actuator":
                    continue
                flown = record.actuators[verdict.actuator]
                per_ampere = PARAMETERS.torque_per_ampere * flown.individual.torque_constant
                settled = flown.motion.time_s > SETTLED_S
                truth = {
                    FRICTION: float(flown.motion.friction.mean()) / per_ampere / STALL_A,
                    TORQUE: float(np.quantile(np.abs(flown.motion.current[settled]), 0.999)) / STALL_A,
                }
                for one in verdict.indicators:
                    if one.fault in truth:
                        shown[one.fault].append((one.value, truth[one.fault]))
                peaks = [own.peak_v for own in verdict.own if own.peak_v]
                volts += [peak / PARAMETERS.supply_voltage for peak in peaks]
                kept[aircraft, verdict.actuator] += verdict.own
                known[aircraft, verdict.actuator].append(truth[FRICTION])
        yield row(mode, shown, volts)
    yield together(kept, known)


def together(kept: dict[tuple[int, str], list[OwnRecord]], known: dict[tuple[int, str], list[float]]) -> str:
    """Return the row of all flights of an actuator taken together, as ``profile identify`` does."""
    told: list[Shown] = []
    for key, records in kept.items():
        found = identified(records)
        of_stall = shares(records, found, friction_current(records)) if found else None
        if of_stall and of_stall.friction:
            told.append((of_stall.friction, float(np.mean(known[key]))))
    errors = [value.estimate / truth - 1.0 for value, truth in told]
    inside = np.mean([value.low <= truth <= value.high for value, truth in told])
    truths = np.mean([truth for _, truth in told])
    error = f"{np.mean(errors):+.1%} ± {np.std(errors):.1%}"
    return f"| all five | – | {truths:.1%} | {error} | {inside:.0%} | – | – | – |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=20, help="first aircraft")
    parser.add_argument("--aircraft", type=int, default=6, help="number of aircraft, of four actuators each")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for line in table(args, Path(folder)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
