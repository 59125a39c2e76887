"""Simulated flights for the health room, each flown once a session, and what a monitor makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks._fleet import compared
from mavhums.actuator.align import Aligned
from mavhums.actuator.derive import Deriver
from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.core.quantities import KEYS, column
from mavhums.engine.events import Event
from mavhums.health.actuator.monitor import ActuatorFindings, Monitor
from mavhums_sim import Flight, FlightRecord, Gearbox, fly
from mavhums_sim.conditions import Condition
from mavhums_sim.ema import EmaParameters
from mavhums_sim.sensors import EscSide

Array = NDArray[np.float64]
TWO_MASSES = EmaParameters.from_data_sheet(gearbox=Gearbox())
SURFACES = ("aileron_left", "aileron_right", "elevator", "rudder")
ESC_KEYS = ("V1", "V4", "V5", "V7")


def actuator_of(surface: str = "elevator", *, esc_side: EscSide = "motor") -> Actuator:
    """Return the paper's actuator on a surface."""
    actuators = load_airframe("paper").actuators
    return next(a for a in actuators if a.name == surface).model_copy(update={"esc_side": esc_side})


@cache
def flown(
    *conditions: Condition,
    cyclogram: str = "gusts",
    rate_hz: float = 50.0,
    seconds: float = 40.0,
    seed: int = 900,
    individuals: int | None = 77,
    esc_side: EscSide = "motor",
) -> dict[str, Telemetry]:
    """Fly two-mass individuals; the conditions are the elevator's."""
    flight = Flight(
        seed=seed,
        duration_s=seconds,
        rate_hz=rate_hz,
        parameters=TWO_MASSES,
        cyclogram=cyclogram,
        individuals=individuals,
        conditions={"elevator": conditions},
        esc_side=esc_side,
    )
    return sensed(fly(flight))


@dataclass(frozen=True, slots=True, eq=False)
class Telemetry:
    """What a monitor is fed: shapes (n,), (n, 12), from an ESC at the bus (n,), without signs (n, 3)."""

    time_s: Array
    values: Array
    bus_v: Array | None = None
    magnitudes: Array | None = None

    def between(self, a: int, b: int) -> Telemetry:
        """Return some of the samples."""
        bus_v, unsigned = (None if all_ is None else all_[a:b] for all_ in (self.bus_v, self.magnitudes))
        return Telemetry(self.time_s[a:b], self.values[a:b], bus_v, unsigned)


def sensed(record: FlightRecord) -> dict[str, Telemetry]:
    """Return what was sensed of each surface, without the motion itself, which is fifty times as large."""
    bus = record.flight.esc_side == "bus"
    return {
        surface: Telemetry(own.time_s.copy(), own.values.copy(), own.esc[:, 0].copy() if bus else None)
        for surface, own in record.actuators.items()
    }


def telemetry(seen: Mapping[str, Telemetry], surface: str = "elevator", *, esc: bool = False) -> Telemetry:
    """Return a copy of what the log says of a surface: all quantities, or those that an ESC gives."""
    own = seen[surface]
    values = own.values.copy()
    if esc:
        there = [column(key) for key in ESC_KEYS]
        values[:, [k for k in range(12) if k not in there]] = np.nan
    return Telemetry(own.time_s, values, own.bus_v)


TIERS: dict[str, tuple[str, ...]] = {"instrumented": KEYS, "esc-signed": ESC_KEYS, "esc-unsigned": ESC_KEYS}
TIERS["csrv"] = ("V1", "V3", "V4", "V5", "V10", "V11")
UNSIGNED = [column(key) for key in ("V4", "V5", "V7")]
QUANTA = np.array([0.01, 0.01, 1.0])


def reported(
    seen: Telemetry, tier: str, actuator: Actuator | None = None
) -> tuple[Telemetry, NDArray[np.bool_]]:
    """Return what a tier reports of a flight, completed as from a log, and what of it is measured."""
    given = np.isin(KEYS, TIERS[tier])
    values = np.where(given, seen.values, np.nan)
    rate = np.gradient(values[:, column("V1")], seen.time_s)
    magnitudes, signed = None, tier != "esc-unsigned"
    if not signed:
        magnitudes = values[:, UNSIGNED] = np.rint(np.abs(values[:, UNSIGNED]) / QUANTA) * QUANTA
        given[UNSIGNED] = False
        rate = np.interp(seen.time_s - 0.05, seen.time_s, rate)
    origin = np.where(np.isfinite(values), 0, -1).astype(np.int8)
    time_us = np.rint(seen.time_s * 1e6).astype(np.int64)
    aligned = Aligned(time_us, values, origin, rate, tier, signed)
    completed = Deriver(actuator or actuator_of()).complete(aligned)
    return Telemetry(seen.time_s, completed, seen.bus_v, magnitudes), given


Watched = tuple[list[Event], ActuatorFindings]


def watch(seen: Telemetry, actuator: Actuator | None = None, **options: Any) -> Watched:
    """Feed a monitor in one block; return its events and findings."""
    return watch_blocks([seen], actuator, **options)


def watch_blocks(blocks: list[Telemetry], actuator: Actuator | None = None, **options: Any) -> Watched:
    """Feed a monitor block by block."""
    networks, baselines = options.pop("networks", ()), options.pop("baselines", {})
    measured = options.pop("measured", None)
    monitor = Monitor(1, actuator or actuator_of(), networks, **options)
    events: list[Event] = []
    for block in blocks:
        gave = None if measured is None else np.tile(measured, (block.time_s.size, 1))
        events.extend(monitor.feed(block.time_s, block.values, gave, block.bus_v, None, block.magnitudes))
    events.extend(monitor.finish())
    findings = monitor.findings()
    return events, compared(findings, monitor.actuator, baselines) if baselines else findings
