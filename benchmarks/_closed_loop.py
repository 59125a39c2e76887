"""Flights in closed loop for the benchmarks: tlogs in memory with their labels.

python benchmarks/_closed_loop.py OUT [--hours H]     # write some of each kind, and labels.csv
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from mavhums_sim.closed_loop import Air, ClosedLoop, Confounder, FlownLoop, SurfaceFault, fly_closed_loop
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.reports import Streams, report
from mavhums_sim.closed_loop.truth import truth
from mavhums_sim.link import Link

RATES = (2.0, 4.0, 10.0, 25.0, 50.0)
TURBULENCE = (0.0, 4.0, 9.0, 15.0)
FAULT_AT = (150.0, 240.0)
JITTER_S = (0.002, 0.02, 0.05)
LOSS = (0.0, 0.0, 0.02)
LABELS = (
    *("file", "kind", "surface", "t_fault_boot_s", "t_clear_boot_s", "t_end_boot_s", "servos"),
    *("demand_at_fault", "wind", "turb", "streams_hz", "flight_s", "model", "modes"),
    *("value", "phase", "airframe", "seed", "autopilot", "end"),
)
_SURFACES = ("aileron_left", "aileron_right", "elevator", "rudder")


@dataclass(frozen=True)
class Planned:
    """One flight to be flown: what, at which stream rate, under which name; and what its judge accepts.

    ``airspeed`` is whether its log has that of a sensor.
    """

    name: str
    flight: ClosedLoop
    rate: float
    false_alarms: float = 1.0
    airspeed: bool = True

    def fly(self) -> Labelled:
        """Fly it; about 0.002 s of CPU per second of flight."""
        flown = fly_closed_loop(self.flight)
        streams = Streams(rate=self.rate, status=min(2.0, self.rate), airspeed=self.airspeed)
        tables = report(flown, streams)
        rng = np.random.default_rng([self.flight.seed, 46])
        link = Link(jitter_s=float(rng.choice(JITTER_S)), loss=float(rng.choice(LOSS)))
        return Labelled(self.name, encode(tables, self.flight.seed, link), _labels(self, flown), flown)


@dataclass(frozen=True)
class Labelled:
    """A flight: its tlog, its labels (columns of ``labels.csv``), and what truly happened."""

    name: str
    tlog: bytes
    labels: tuple[dict[str, str], ...]
    flown: FlownLoop


def healthy(hours: float, seed: int = 0, minutes: float = 15.0) -> Iterator[Planned]:
    """Yield healthy flights of many airframes, airs, missions, layouts, autopilots and stream rates."""
    for k in range(round(hours * 60.0 / minutes)):
        rng = np.random.default_rng([seed, 41, k])
        flight = _drawn(rng, seed, k, 60.0 * minutes)
        flight = replace(
            flight, layout=str(rng.choice(["conventional", "elevon", "vtail"], p=[0.7, 0.15, 0.15]))
        )
        yield Planned(f"healthy_{seed}_{k:05d}", flight, float(rng.choice(RATES)))


def jams(seed: int = 0, repeats: int = 1) -> Iterator[Planned]:
    """Yield surfaces that freeze in place, at a deflection and hard over, by rate, turbulence and phase."""
    deflections = (nan, 0.0, 3.0, 6.0, 10.0, 17.0, 25.0)
    missions = ("waypoints", "loiter", "heading", "manual")
    cases = product(_SURFACES, deflections, RATES, TURBULENCE, range(repeats))
    for k, (surface, deflection, rate, turbulence, _) in enumerate(cases):
        rng = np.random.default_rng([seed, 42, k])
        value = deflection * float(rng.choice([-1.0, 1.0]))
        fault = SurfaceFault(surface, "freeze", value, float(rng.uniform(*FAULT_AT)))
        flight = _drawn(rng, seed, 10_000 + k, 360.0, mission=missions[k % 4], turbulence=turbulence)
        yield Planned(f"freeze_{surface}_{k:05d}", replace(flight, faults=(fault,)), rate)


def losses(seed: int = 0, repeats: int = 1) -> Iterator[Planned]:
    """Yield surfaces that lose 20…100 % of their effect; ``ailerons`` is both of them."""
    cases = product((*_SURFACES, "ailerons"), (0.2, 0.4, 0.6, 0.8, 1.0), RATES, TURBULENCE, range(repeats))
    for k, (surface, lost, rate, turbulence, _) in enumerate(cases):
        rng = np.random.default_rng([seed, 43, k])
        at = float(rng.uniform(*FAULT_AT))
        names = _SURFACES[:2] if surface == "ailerons" else (surface,)
        faults = tuple(SurfaceFault(name, "gain", 1.0 - lost, at) for name in names)
        flight = _drawn(rng, seed, 20_000 + k, 360.0, turbulence=turbulence)
        yield Planned(f"gain_{surface}_{k:05d}", replace(flight, faults=faults), rate)


def others(seed: int = 0, repeats: int = 1) -> Iterator[Planned]:
    """Yield slow servos, floating, offset and loose surfaces."""
    kinds = {
        "slow": (0.3, 0.6, 1.0),
        "slow_rate": (5.0, 15.0),
        "float": (nan,),
        "bias": (3.0, 8.0),
        "backlash": (2.0, 5.0),
    }
    cases = [(kind, value) for kind, values in kinds.items() for value in values]
    for k, ((kind, value), surface, rate, _) in enumerate(product(cases, _SURFACES, RATES, range(repeats))):
        rng = np.random.default_rng([seed, 44, k])
        fault = SurfaceFault(surface, kind, value, float(rng.uniform(*FAULT_AT)))
        flight = _drawn(rng, seed, 30_000 + k, 360.0)
        yield Planned(f"{kind}_{surface}_{k:05d}", replace(flight, faults=(fault,)), rate)


def mixed(seed: int = 0, repeats: int = 4) -> Iterator[Planned]:
    """Yield elevons and halves of a V-tail that lose effect or freeze, left and right in turn."""
    cases = (("gain", 0.0), ("gain", 0.25), ("gain", 0.5), ("freeze", nan), ("gain", 0.5))
    surfaces = product(range(repeats), cases, ("left", "right"), ("elevon", "vtail"))
    for k, (_, (kind, value), side, layout) in enumerate(surfaces):
        rng = np.random.default_rng([seed, 77, k])
        fault = SurfaceFault(f"{layout}_{side}", kind, value, float(rng.uniform(*FAULT_AT)))
        flight = _drawn(rng, seed, 50_000 + k, 360.0)
        flight = replace(flight, layout=layout, faults=(fault,))
        yield Planned(f"{kind}_{fault.surface}_{k:05d}", flight, float(rng.choice(RATES)))


def confounders(seed: int = 0, repeats: int = 4) -> Iterator[Planned]:
    """Yield engine failures, lying airspeed sensors, fronts of wind and lost GPS: no surface fails."""
    kinds = {"engine": (0.0, 0.5), "airspeed": (0.0, 0.8, 1.25), "wind": (5.0, 10.0), "gps": (1.5,)}
    cases = [(kind, value) for kind, values in kinds.items() for value in values]
    for k, ((kind, value), rate, _) in enumerate(product(cases, RATES, range(repeats))):
        rng = np.random.default_rng([seed, 45, k])
        met = Confounder(kind, value, float(rng.uniform(*FAULT_AT)))
        flight = _drawn(rng, seed, 40_000 + k, 360.0)
        yield Planned(f"{kind}_{k:05d}", replace(flight, confounders=(met,)), rate)


KINDS: dict[str, Callable[..., Iterator[Planned]]] = {
    "healthy": healthy,
    "jams": jams,
    "losses": losses,
    "others": others,
    "mixed": mixed,
    "confounders": confounders,
}


def write(flights: Iterable[Planned], folder: Path) -> Path:
    """Fly, write each tlog into the folder, and the labels of all into ``labels.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "labels.csv"
    with path.open("w", newline="") as file:
        rows = csv.DictWriter(file, LABELS)
        rows.writeheader()
        for planned in flights:
            labelled = planned.fly()
            (folder / f"{labelled.name}.tlog").write_bytes(labelled.tlog)
            rows.writerows(labelled.labels)
    return path


def _drawn(rng: np.random.Generator, seed: int, k: int, duration_s: float, **fixed: Any) -> ClosedLoop:
    """Draw airframe, air, mission and autopilot."""
    wind, turbulence = float(rng.uniform(0.0, 9.0)), float(rng.choice(TURBULENCE))
    air = Air(wind, float(rng.uniform(0.0, 360.0)), fixed.get("turbulence", turbulence))
    return ClosedLoop(
        seed=seed * 100_000 + k,
        airframe=int(rng.integers(1, 200)),
        duration_s=duration_s,
        flavour="px4" if rng.random() < 0.3 else "ardupilot",
        mission=fixed.get("mission", "mixed"),
        air=air,
    )


def _labels(planned: Planned, flown: FlownLoop) -> tuple[dict[str, str], ...]:
    known: dict[str, Any] = truth(flown)
    flight = flown.flight
    shared = {
        "file": f"{planned.name}.tlog",
        "t_end_boot_s": f"{known['end_boot_s']:.2f}",
        "wind": f"{flight.air.wind:.1f}",
        "turb": f"{flight.air.turbulence:.1f}",
        "streams_hz": f"{planned.rate:g}",
        "flight_s": f"{known['end_boot_s'] - known['launch_boot_s']:.0f}",
        "model": f"aerosonde-{flight.layout}",
        "modes": " ".join(f"{p['phase']}@{p['boot_s']:.0f}" for p in known["phases"]),
        "airframe": str(flight.airframe),
        "seed": str(flight.seed),
        "autopilot": flight.flavour,
        "end": flown.end,
    }
    events: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for event in (*known["faults"], *known["confounders"]):
        events.setdefault((event["kind"], event["begin_boot_s"]), []).append(event)
    rows = [shared | _span(several[0]) | _what(several) for several in events.values()]
    return tuple(rows) or (shared | {"kind": "none", "surface": "none", "demand_at_fault": "{}"},)


def _what(several: list[dict[str, Any]]) -> dict[str, str]:
    """Return what happened at one moment: one fault, or the same fault of several surfaces."""
    event = several[0]
    failed = [one for one in several if "surface" in one]
    return {
        "kind": event["kind"],
        "surface": event.get("surface", "none").split("_")[0],
        "servos": "+".join(f"{one['surface']}(SERVO{one['servo']})" for one in failed),
        "demand_at_fault": json.dumps({str(one["servo"]): one["demand_us"] for one in failed}).replace(
            ",", ";"
        ),
        "value": "" if event["value"] is None else f"{event['value']:g}",
        "phase": event.get("phase", ""),
    }


def _span(event: dict[str, Any]) -> dict[str, str]:
    end = event["end_boot_s"]
    return {
        "t_fault_boot_s": f"{event['begin_boot_s']:.2f}",
        "t_clear_boot_s": "" if end is None else f"{end:.2f}",
    }


def _some(hours: float) -> Iterator[Planned]:
    yield from healthy(hours)
    for kind in ("jams", "losses", "others", "mixed", "confounders"):
        planned = list(KINDS[kind]())
        yield from planned[:: max(1, len(planned) // 8)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hours", type=float, default=0.5, help="of healthy flight")
    arguments = parser.parse_args()
    print(write(_some(arguments.hours), arguments.folder))


if __name__ == "__main__":
    main()
