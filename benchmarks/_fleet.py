"""Simulated fleet of individual two-mass actuators, and its verdicts, for ``benchmarks/health.py``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.align import Aligned
from mavhums.actuator.derive import Deriver
from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.actuator.telemetry import tier_named
from mavhums.core.arrays import Array
from mavhums.core.quantities import KEYS
from mavhums.health.actuator.monitor import ActuatorFindings, Monitor
from mavhums.health.actuator.past import compare_with_earlier_flights
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.events import ConditionChanged, Window
from mavhums.health.verdict.actuator import TelemetrySources, verdict_of_actuator
from mavhums_sim import EmaParameters, Flight, FlightRecord
from mavhums_sim.campaign import PAPER_FRICTION_NM, consume
from mavhums_sim.conditions import Condition
from mavhums_sim.flight import ActuatorRecord
from mavhums_sim.individuals import Individual
from mavhums_sim.replay import replay

T = TypeVar("T")

PAPER = EmaParameters.from_data_sheet().two_masses()
ACTUATORS = {actuator.name: actuator for actuator in load_airframe("paper").actuators}
SURFACES = tuple(ACTUATORS)
MODES = ("takeoff", "cruise", "turns", "gusts", "landing")
_CSRV = [0, 2, 9, 10]  # V1, V3, V10, V11
START = datetime(2026, 1, 1, tzinfo=UTC)
_SEED = 70_000_000  # training and the study use seeds below ten million


@dataclass(frozen=True, slots=True)
class DriftingFlight(Flight):
    """A flight after a random drift of the torque constant, up or down by at most this fraction."""

    drift: float = 0.0

    def individual(self, index: int) -> Individual:
        own = Flight.individual(self, index)
        rng = np.random.default_rng([self.seed, 11, index])
        return replace(own, torque_constant=own.torque_constant * (1.0 + self.drift * rng.uniform(-1.0, 1.0)))


# Baselines of each aircraft, surface and fault.
Known = dict[str, dict[str, dict[str, Baseline]]]


class Task(NamedTuple):
    """One flight: its name in the results, and its description."""

    name: str
    flight: Flight


@dataclass(frozen=True, slots=True)
class Judged:
    """The result for one actuator in one flight."""

    surface: str
    findings: ActuatorFindings
    windows: tuple[Window, ...] = ()
    changes: tuple[ConditionChanged, ...] = ()
    truth: dict[str, float] = field(default_factory=dict)


def flight(number: int, aircraft: int, *, rate_hz: float, mode: str = "takeoff", **given: object) -> Flight:
    """Return flight ``number`` of an aircraft with individual actuators."""
    kind = DriftingFlight if "drift" in given else Flight
    return kind(
        seed=_SEED + 100_000 * aircraft + number,
        rate_hz=rate_hz,
        parameters=PAPER,
        individuals=_SEED + aircraft,
        **{"cyclogram": mode, **given},  # type: ignore[arg-type]
    )


def added(fault: str, severity: float) -> dict[str, tuple[Condition, ...]]:
    """Return a constant fault of every surface's actuator."""
    return dict.fromkeys(SURFACES, (Condition.constant(fault, severity),)) if severity else {}


def quantities(record: ActuatorRecord, actuator: Actuator, tier: str) -> tuple[Array, Array]:
    """Return times and V1…V12 as reported by a tier's telemetry.

    ``instrumented`` all twelve as float32; ``without load`` the same but V11 and V12; ``csrv`` what a servo
    reports; ``esc-signed`` V1 in pulses, V4 and V5 as float32, V7 in whole rev/min; ``esc-unsigned`` the same
    as magnitudes, V4 and V5 in hundredths; and what follows from them.
    """
    values = record.values.astype(np.float32).astype(np.float64)
    if tier == "instrumented":
        return record.time_s, values
    if tier == "without load":
        values[:, 10:] = np.nan
        return record.time_s, values
    time_s, sensed = record.time_s, np.full_like(values, np.nan)
    if tier == "csrv":
        sensed[:, _CSRV] = values[:, _CSRV]
        sensed[:, [3, 4]] = record.esc[:, :2].astype(np.float32)
    else:
        sensed[:, 0] = np.rint(values[:, 0] / 0.12) * 0.12
        sensed[:, [3, 4]] = record.esc[:, :2].astype(np.float32)
        sensed[:, 6] = np.rint(record.esc[:, 2])
    rate = np.gradient(sensed[:, 0], time_s)
    if tier == "esc-unsigned":
        sensed[:, 3:7] = np.abs(sensed[:, 3:7])
        sensed[:, [3, 4]] = np.rint(sensed[:, [3, 4]] * 100.0) / 100.0
        after, before = (np.interp(time_s - 0.05 + way * 0.05, time_s, sensed[:, 0]) for way in (1, -1))
        rate = (after - before) / 0.1
    origin = np.where(np.isfinite(sensed), 0, -1).astype(np.int8)
    time_us = np.rint(time_s * 1e6).astype(np.int64)
    aligned = Aligned(time_us, sensed, origin, rate, tier, tier != "esc-unsigned")
    return time_s, Deriver(actuator).complete(aligned)


def measured(tier: str, count: int) -> NDArray[np.bool_] | None:
    """Return which of V1…V12 are measured, not derived, with the tier's telemetry, shape (count, 12)."""
    given = {
        "csrv": ("V1", "V3", "V4", "V5", "V10", "V11"),
        "esc-signed": ("V1", "V4", "V5", "V7"),
        "esc-unsigned": ("V1", "V4", "V5"),  # the sign of the speed is derived
    }
    return np.tile(np.isin(KEYS, given[tier]), (count, 1)) if tier in given else None


def magnitudes(record: ActuatorRecord, tier: str) -> Array | None:
    """Return those of V4, V5 and V7 as ESC_TELEMETRY rounds them, shape (n, 3); None of other tiers."""
    if tier != "esc-unsigned":
        return None
    quanta = np.array([0.01, 0.01, 1.0])
    found: Array = np.rint(np.abs(record.esc) / quanta) * quanta
    return found


def judge(
    name: str,
    record: FlightRecord,
    *,
    tier: str = "instrumented",
    keep_windows: bool = False,
    baselines: Known | None = None,
) -> list[Judged]:
    """Judge every actuator of a flight; ``baselines`` by aircraft (the name's first part) and surface."""
    known = (baselines or {}).get(name.split("/", maxsplit=1)[0], {})
    judged = []
    for surface, flown in record.actuators.items():
        actuator = ACTUATORS[surface]
        monitor = Monitor(1, actuator)
        times, values = quantities(flown, actuator, tier)
        unsigned = magnitudes(flown, tier)
        events = [*monitor.feed(times, values, measured(tier, times.size), magnitudes=unsigned)]
        events += monitor.finish()
        findings = compared(monitor.findings(), actuator, known.get(surface, {}))
        windows = tuple(event for event in events if isinstance(event, Window))
        changes = tuple(event for event in events if isinstance(event, ConditionChanged))
        truth = {
            "friction": float(flown.motion.friction[-1]),
            "torque_constant": flown.individual.torque_constant,
            "moving": flown.motion.moving_fraction,
        }
        judged.append(Judged(surface, findings, windows if keep_windows else (), changes, truth))
    return judged


def compared(
    findings: ActuatorFindings, actuator: Actuator, baselines: Mapping[str, Baseline]
) -> ActuatorFindings:
    """Return the findings of a flight after the comparison with the actuator's own baselines."""
    telemetry = TelemetrySources(1, actuator, tier_named("instrumented"), {})
    verdict = verdict_of_actuator(telemetry, findings, start_utc=START, end_s=findings.last_s)
    found = compare_with_earlier_flights(verdict, baselines, start_utc=START, end_s=findings.last_s)
    return replace(
        findings,
        condition=found.condition,
        worst=found.worst,
        since_s=found.since.flight_time_s if found.since else None,
        suspects=found.suspects,
        evidence=found.evidence,
        indicators=found.indicators,
        coverage=found.coverage,
    )


def fly_all(
    tasks: list[Task], consumer: Callable[[str, FlightRecord], T], workers: int
) -> Iterator[tuple[str, T]]:
    """Simulate and judge flights on all workers, with a progress bar."""
    from rich.console import Console
    from rich.progress import track

    found, title = consume(tasks, consumer, workers), f"{len(tasks)} flights"
    yield from track(found, total=len(tasks), description=title, console=Console(stderr=True))


def baselines_of(flights: list[tuple[str, list[Judged]]]) -> Known:
    """Return baselines by aircraft, surface and fault from healthy flights."""
    shown: dict[tuple[str, str, str], list[object]] = {}
    for name, judged in flights:
        for one in judged:
            for indicator in one.findings.indicators:
                shown.setdefault((name.split("/")[0], one.surface, indicator.fault), []).append(indicator)
    found: dict[str, dict[str, dict[str, Baseline]]] = {}
    for (aircraft, surface, fault), indicators in shown.items():
        baseline = Baseline.of(indicators)  # type: ignore[arg-type]
        if baseline is not None:
            found.setdefault(aircraft, {}).setdefault(surface, {})[fault] = baseline
    return found


def replayed(logs: Path) -> list[object]:
    """Return cyclograms of real logs that carry commands and airspeed, at least 100 s of each."""
    names = ("sitl/plane_hirate.link1.tlog", "sitl/plane_normal.mavproxy.tlog")
    return [replay(logs / name).cyclogram for name in names if (logs / name).exists()]


def frictions(number: int, aircraft: int) -> dict[str, tuple[float, float]]:
    """Return one of the paper's eight frictions for each surface."""
    drawn = np.random.default_rng([number, aircraft, 5]).choice(PAPER_FRICTION_NM, len(SURFACES))
    return {surface: (float(f), float(f)) for surface, f in zip(SURFACES, drawn, strict=True)}


def at_all_frictions(count: int, rate_hz: float, cyclograms: tuple[object, ...] = MODES) -> list[Task]:
    tasks = []
    for k in range(count):
        cyclogram = cyclograms[k % len(cyclograms)]
        flown = flight(k, k, rate_hz=rate_hz, mode=cyclogram, friction_nm=frictions(k, k))  # type: ignore[arg-type]
        tasks.append(Task(f"{k}/{cyclogram if isinstance(cyclogram, str) else cyclogram.name}", flown))  # type: ignore[attr-defined]
    return tasks
