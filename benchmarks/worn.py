"""Effect of a worn EMA on the aircraft: ``python benchmarks/worn.py`` (closed loop, half a minute).

Each fault of all four EMAs (jam and sensor bias: of the elevator) from 60 s on; way-points, turbulence 9 m/s.
Mean over two flights; one mass, with backlash two.
"""

from __future__ import annotations

import numpy as np

from mavhums_sim import Flight
from mavhums_sim.closed_loop import Air, ClosedLoop, FlownLoop, fly_closed_loop
from mavhums_sim.conditions import FAULTS, Condition
from mavhums_sim.cyclogram import SURFACES

ONSET_S = 60.0
CASES = (
    ("none", 0.0),
    ("friction", 0.8),
    ("friction", 2.0),
    ("friction", 3.5),
    ("backlash", 4.0),
    ("resistance", 1.0),
    ("torque_constant", 0.5),
    ("supply_sag", 15.0),
    ("sensor_bias", 3.0),
    ("jam", 10.0),
)


def fly(fault: str, severity: float, seed: int) -> FlownLoop:
    surfaces = ("elevator",) if fault in {"jam", "sensor_bias"} else SURFACES
    worn = {} if fault == "none" else {s: (Condition.step(fault, severity, ONSET_S),) for s in surfaces}
    parameters = Flight().parameters
    emas = Flight(
        seed=seed, conditions=worn, parameters=parameters.two_masses() if fault == "backlash" else parameters
    )
    air = Air(4.0, 40.0, 9.0)
    return fly_closed_loop(
        ClosedLoop(seed=seed, airframe=None, duration_s=150.0, mission="waypoints", air=air, emas=emas)
    )


def describe(flown: FlownLoop) -> list[float]:
    after = flown.time_s > ONSET_S + 2.0
    roll, pitch = (flown.column(f"nav_{name}") - flown.column(name) for name in ("roll", "pitch"))
    beside = (flown.servos("demand") - flown.servos("surface"))[:, 2]
    degrees = [float(np.degrees(signal[after].std())) for signal in (roll, pitch, beside)]
    return [*degrees, float(flown.column("q")[after].std())]


def main() -> None:
    print("| EMA | roll error, ° | pitch error, ° | q, rad/s | elevator error, ° | end |")
    print("|---|---|---|---|---|---|")
    for fault, severity in CASES:
        flights = [fly(fault, severity, seed) for seed in (1, 2)]
        roll, pitch, beside, q = np.mean([describe(flown) for flown in flights], axis=0)
        name = (
            f"{fault} {severity:g} {FAULTS[fault].unit.replace('1', '')}".rstrip() if severity else "healthy"
        )
        ends = ", ".join(dict.fromkeys(flown.end for flown in flights))
        print(f"| {name} | {roll:.2f} | {pitch:.2f} | {q:.3f} | {beside:.2f} | {ends} |", flush=True)


if __name__ == "__main__":
    main()
