"""Flights that training does not know: other commands, masses, gears, loads, noise and rates, as logs.

Each flight has a normal, a degraded and an emergency actuator by friction, and one more of any condition.
Every second flight has a rigid gear (one mass); the others have two masses and a gear of their own. The
surfaces follow steps, sweeps and turbulence that no cyclogram of training has, or a cruise or a preflight
check with another dead band. The log goes through the whole program, with the network as the judge.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mavhums.actuator.profile import load_airframe
from mavhums.app.analysis import analyse
from mavhums.app.settings import Options
from mavhums.core.arrays import Array
from mavhums.learn import Model
from mavhums_sim import EmaParameters, Flight, Gearbox, fly, write_tlog
from mavhums_sim.conditions import Condition
from mavhums_sim.cyclogram import SURFACES, Cyclogram
from mavhums_sim.flight import FlightRecord
from mavhums_sim.manoeuvres import CYCLOGRAMS
from mavhums_sim.motion import CONTROL_PERIOD_S
from mavhums_sim.rates import Rates
from mavhums_sim.sensors import SensorNoise

SEED, LAST_LOOK = 71_000_000, 79_000_000
"""Seeds to develop with, and of the flights that are looked at once, after every choice."""

TIERS = {"instrumented": "instrumented", "esc-signed": "ESC_STATUS", "esc-unsigned": "ESC_TELEMETRY"}
LOOKS = {SEED: "", LAST_LOOK: "last look: "}
COLUMNS = (
    "windows answered",
    "decided",
    "right of the decided",
    "emergency by friction decided as less",
    "actuators with an emergency called normal",
    "normal ones called worse",
)
FRICTION = {"normal": (0.225, 0.375), "degraded": (0.375, 0.875), "emergency": (0.875, 1.3)}
OTHERS = {
    "winding resistance": ("resistance", 0.3, 1.5),
    "torque constant": ("torque_constant", 0.15, 0.4),
    "supply sag": ("supply_sag", 12.0, 22.0),
    "jam": ("jam", 8.0, 12.0),
}
CLASSES = {
    "normal": "normal",
    "degraded": "friction_degraded",
    "emergency": "friction_emergency",
    **{name: name.replace(" ", "_") for name in OTHERS},
}
UNDECIDED = ("abstained", "outside")
DURATION_S = 100.0

Counts = Counter[tuple[str, str, str]]


@dataclass(frozen=True, eq=False)
class Flown:
    """A flight and what each of its actuators is: name of the condition, and severity."""

    record: FlightRecord
    truth: dict[str, tuple[str, float]]


def commands(seed: int) -> Cyclogram:
    """Return a pilot of steps, a sweep or turbulence at any activity, each surface its own."""
    random = np.random.default_rng([seed, 17])
    time = np.arange(1.0, round(DURATION_S / CONTROL_PERIOD_S) + 1, dtype=np.float64) * CONTROL_PERIOD_S

    def noise(period_s: float) -> Array:
        knots = np.arange(0.0, DURATION_S + 2 * period_s, period_s)
        return np.asarray(np.interp(time, knots, random.standard_normal(len(knots))))

    def surface() -> Array:
        amplitude = np.exp(random.uniform(np.log(1.5), np.log(18.0)))
        kind = random.integers(3)
        if kind == 0:
            lasts = np.cumsum(random.uniform(0.8, 6.0, 200))
            return np.asarray(amplitude * random.uniform(-1, 1, 201)[np.searchsorted(lasts, time)])
        if kind == 1:
            low, high = sorted(random.uniform(0.05, 0.8, 2))
            turns = low * time + (high - low) * time**2 / (2 * DURATION_S)
            return np.asarray(amplitude * np.sin(2 * np.pi * turns))
        return np.asarray(
            0.6 * amplitude * (noise(random.uniform(0.4, 2.0)) + noise(random.uniform(3.0, 8.0)))
        )

    dead_band = random.choice([0.0, 0.12, 1.0])
    degrees = {name: surface() + random.uniform(-4, 4) for name in SURFACES}
    if dead_band:
        degrees = {name: np.round(each / dead_band) * dead_band for name, each in degrees.items()}
    airspeed = np.maximum(random.uniform(12.0, 32.0) + random.uniform(0.2, 2.0) * noise(4.0), 0.0)
    incidence = {
        name: np.radians(random.uniform(0, 6) + random.uniform(0.5, 4.0) * noise(0.7)) for name in SURFACES
    }
    still = np.zeros_like(time)
    moves = {name: np.radians(np.clip(each, -25, 25)) for name, each in degrees.items()}
    return Cyclogram("other", time, moves, airspeed, incidence, still, still, still, still + 100.0)


def flights(count: int, seed: int) -> Iterator[Flown]:
    for number in range(count):
        own = seed + number
        random = np.random.default_rng([own, 18])
        kind = ("other", "cruise", "other", "preflight")[number // 2 % 4]
        dead_band = float(random.choice([0.12, 0.8]))
        cyclogram = commands(own) if kind == "other" else CYCLOGRAMS[kind](own, DURATION_S, dead_band)
        parameters = EmaParameters.from_data_sheet()
        if number % 2:
            parameters = parameters.two_masses(
                Gearbox(
                    stiffness=random.uniform(250, 800),
                    backlash=np.radians(random.uniform(0.04, 0.14)),
                    rotor_friction=random.uniform(0.4, 0.8),
                    surface_inertia=random.uniform(0.002, 0.007),
                )
            )
        louder = float(np.exp(random.uniform(np.log(0.5), np.log(2.0))))
        noise = SensorNoise(*(louder * value for value in _values(SensorNoise())))
        rate = float(random.choice([10.0, 20.0, 50.0]))
        truth: dict[str, tuple[str, float]] = {}
        friction, conditions = {}, {}
        names = [*FRICTION, [*OTHERS, *FRICTION][number % (len(OTHERS) + len(FRICTION))]]
        for surface, place in zip(SURFACES, random.permutation(len(SURFACES)).tolist(), strict=True):
            name = names[place]
            torque = random.uniform(*FRICTION.get(name, FRICTION["normal"]))
            friction[surface], truth[surface] = (torque, torque), (name, torque)
            if name in OTHERS:
                fault, low, high = OTHERS[name]
                severity = random.uniform(low, high)
                conditions[surface], truth[surface] = (Condition.constant(fault, severity),), (name, severity)
        flight = Flight(
            seed=own,
            friction_nm=friction,
            rate_hz=rate,
            parameters=parameters,
            noise=noise,
            cyclogram=cyclogram,
            conditions=conditions,
            individuals=own,
            rates=replace(Rates(), esc=rate),
        )
        yield Flown(fly(flight), truth)


def _values(noise: SensorNoise) -> list[float]:
    return [getattr(noise, name) for name in noise.__slots__]


def independent(models: Sequence[Model], count: int, seed: int) -> None:
    """Print, for each tier, what the networks alone say of windows and of actuators; then what is wrong."""
    windows, actuators = Counts(), Counts()
    airframe = load_airframe("paper")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "flight.tlog"
        for flown in flights(count, seed):
            for tier in TIERS:
                said = replace(flown.record.flight, tiers=(tier, "pwm"))
                write_tlog(replace(flown.record, flight=said), log)
                options = Options(airframe=airframe, model=models, decide="network")
                for verdict in analyse(log, options).verdicts:
                    name, _ = flown.truth[str(verdict.actuator)]
                    answer = verdict.network
                    for each, found in (answer.classes if answer else {}).items():
                        windows[tier, name, each] += found.windows
                    actuators[tier, name, answer.condition if answer else "not asked"] += 1
    print(f"| | {' | '.join(COLUMNS)} |")
    print("|---" * (len(COLUMNS) + 1) + "|")
    for tier, name in TIERS.items():
        print(f"| {LOOKS[seed]}{name} | {' | '.join(_cells(windows, actuators, tier))} |")
    for tier, name in TIERS.items():
        wrong = {
            f"{flown} as {said}": n
            for (of, flown, said), n in windows.items()
            if of == tier and said not in (CLASSES[flown], *UNDECIDED)
        }
        print(f"\n{name}, windows decided wrongly: {wrong}")


def _cells(windows: Counts, actuators: Counts, tier: str) -> Iterator[str]:
    said = {name: Counter[str]() for name in CLASSES}
    for (of, name, each), count in windows.items():
        said[name][each] += count * (of == tier)
    answered = sum(counts.total() for counts in said.values())
    decided = answered - sum(counts[each] for counts in said.values() for each in UNDECIDED)
    right = sum(said[name][each] for name, each in CLASSES.items())
    yield from (str(answered), f"{100 * decided / answered:.1f} %", f"{100 * right / decided:.1f} %")
    grave = said["emergency"]
    as_grave = sum(grave[each] for each in (CLASSES["emergency"], "jam", *UNDECIDED))
    yield f"{grave.total() - as_grave} of {grave.total()}"
    for name, wrong in (("emergency", ("normal",)), ("normal", ("degraded", "emergency"))):
        called = sum(actuators[tier, name, each] for each in wrong)
        yield f"{called} of {sum(n for (t, f, _), n in actuators.items() if (t, f) == (tier, name))}"
