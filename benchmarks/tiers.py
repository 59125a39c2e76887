"""Detection by each telemetry tier: the paper's eight conditions at several rates.

    python benchmarks/tiers.py

For each tier and rate, flights of 100 s with the elevator at each of the paper's frictions; the other
three surfaces are healthy. Counts verdicts that are right, wrong and none, and gives the mean
error and the standard deviation of the friction estimate at the flight's end.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from mavhums import analyse
from mavhums.actuator.profile import load_airframe
from mavhums.app.settings import Options
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.campaign import PAPER_FRICTION_NM
from mavhums_sim.link import Link
from mavhums_sim.rates import Rates

TIERS = {
    "instrumented": ("instrumented",),
    "esc-signed": ("esc-signed", "pwm"),
    "esc-signed, bus side": ("esc-signed", "pwm"),
    "named, MAVLink 1": ("named",),
    "esc-unsigned": ("esc-unsigned", "pwm"),
    "pwm, MAVLink 1": ("pwm",),
}
RATES_HZ = (100.0, 50.0, 25.0, 10.0)
SURFACES = ("aileron_left", "aileron_right", "elevator", "rudder")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=7000)
    parser.add_argument("--all-surfaces", action="store_true", help="every surface at the flight's friction")
    options = parser.parse_args()
    print("| tier | rate | actuators | right | wrong | no verdict | error, N·m | truth within 95 % |")
    print("|---|---|---|---|---|---|---|---|")
    for name in TIERS:
        for rate in RATES_HZ:
            cells = measure(name, rate, options.seed, options.all_surfaces)
            print(f"| {name} | {rate:g} Hz | {' | '.join(cells)} |", flush=True)


def measure(name: str, rate_hz: float, seed: int, all_surfaces: bool) -> list[str]:
    airframe = load_airframe("paper")
    if "bus" in name:
        bus = [a.model_copy(update={"esc_side": "bus", "electronics_a": 0.05}) for a in airframe.actuators]
        airframe = airframe.model_copy(update={"actuators": tuple(bus)})
    right = wrong = undecided = inside = 0
    errors = []
    for k, friction in enumerate(PAPER_FRICTION_NM):
        surfaces = SURFACES if all_surfaces else ("elevator",)
        record = fly(
            Flight(
                seed=seed + k,
                friction_nm=dict.fromkeys(surfaces, (friction, friction)),
                rate_hz=rate_hz,
                rates=Rates(servo_output=min(rate_hz, 50.0), esc=rate_hz),
                tiers=TIERS[name],
                esc_side="bus" if "bus" in name else "motor",
            )
        )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "flight.tlog"
            write_tlog(record, path, Link(mavlink=1) if "MAVLink 1" in name else None)
            assessment = analyse(path, Options(airframe=airframe))
        for verdict in [one for one in assessment.verdicts if one.subject == "actuator"]:
            truth = friction if verdict.actuator in surfaces else 0.225
            wanted = "normal" if truth < 0.6 else "emergency"
            judged = verdict.gravest in ("normal", "degraded", "emergency")
            undecided += not judged
            right += verdict.condition == verdict.worst == wanted
            wrong += judged and not verdict.condition == verdict.worst == wanted
            if verdict.friction_nm:
                errors.append(verdict.friction_nm.estimate - truth)
                inside += verdict.friction_nm.low <= truth <= verdict.friction_nm.high
    counts = [str(count) for count in (right + wrong + undecided, right, wrong, undecided)]
    if not errors:
        return [*counts, "–", "–"]
    spread = f"{np.mean(errors):+.3f} ± {np.std(errors):.3f}".replace("-", "−")
    return [*counts, spread, f"{100 * inside / len(errors):.0f} %"]


if __name__ == "__main__":
    main()
