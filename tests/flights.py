"""Assessments of flights that nobody flew, for what reads many of them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from mavhums.core.conditions import Condition
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.sections import FlightIdentity
from mavhums.results.standing import FlightsLeft, Growth, Standing, Step
from mavhums.results.verdict import Indicator, Interval, Suspect, Verdict
from tests.fleet.stores import write_store

START = datetime(2026, 3, 1, 9, tzinfo=UTC)


def shown(value: float, *, fault: str = "friction", error: float = 0.002, windows: int = 10) -> Indicator:
    return Indicator(
        fault=fault,
        quantity="Coulomb friction" if fault == "friction" else fault,
        unit="N·m",
        value=Interval(estimate=value, low=value - 2 * error, high=value + 2 * error),
        windows=windows,
        scatter=error * windows**0.5,
        limit=0.375,
        emergency=0.875 if fault == "friction" else None,
    )


def verdict(
    *indicators: Indicator,
    actuator: str = "elevator",
    vehicle: int | None = 1,
    condition: Condition = "normal",
    suspect: str | None = None,
) -> Verdict:
    return Verdict(
        vehicle=vehicle,
        actuator=actuator,
        condition=condition,
        worst=condition,
        suspects=(Suspect(fault=suspect, confidence=0.9),) if suspect else (),
        indicators=indicators,
    )


def left(estimate: float, low: float = 0.0, high: float | None = None) -> FlightsLeft:
    return FlightsLeft(estimate=estimate, low=low, high=high)


def growth(degraded: FlightsLeft | None = None, emergency: FlightsLeft | None = None) -> Growth:
    return Growth(
        fault="friction",
        quantity="friction",
        unit="N·m",
        since_flight=3,
        since_utc="2026-03-03T09:00:00+00:00",
        per_flight=Interval(estimate=0.005, low=0.004, high=0.006),
        to_degraded=degraded,
        to_emergency=emergency,
    )


def standing(condition: Condition, grows: Growth | None = None, found: Step | None = None) -> Standing:
    return Standing(
        vehicle=1,
        actuator="elevator",
        airframe="paper",
        condition=condition,
        last="normal",
        growth=grows,
        step=found,
        flights=9,
        last_utc="2026-03-01T00:00:00+00:00",
        log=None,
    )


def flown(
    *verdicts: Verdict,
    day: float = 0,
    name: str | None = None,
    airframe: str | None = "paper",
    identities: Sequence[FlightIdentity] = (),
) -> Assessment:
    """Return the assessment of a flight of ten minutes, so many days after the first of March."""
    name = name or f"flight-{day:g}"
    return Assessment(
        log=LogSummary(
            path=f"{name}.tlog",
            sha256=hashlib.sha256(name.encode()).hexdigest(),
            start_utc=(START + timedelta(days=day)).isoformat(),
            duration_s=600.0,
            vehicles=(1,),
            losses=Losses(),
            flight=tuple(identities),
        ),
        airframe=airframe,
        model=None,
        verdicts=verdicts,
    )


def identity(
    *,
    board: str | None = "0A",
    boot_s: float = -60.0,
    begin_s: float = 0.0,
    end_s: float = 600.0,
    day: float = 0,
) -> FlightIdentity:
    """Return the identity of a flight; the times are seconds after :func:`flown`'s start."""
    start = START + timedelta(days=day)
    boot, begin, end = ((start + timedelta(seconds=s)).isoformat() for s in (boot_s, begin_s, end_s))
    return FlightIdentity(vehicle=1, board=board, boot_utc=boot, start_utc=begin, end_utc=end)


def write_wear(
    store: Path,
    *,
    flights: int = 40,
    growth: Sequence[tuple[str, float]] = (("elevator", 0.005), ("rudder", 0.0)),
    seed: int = 1,
) -> None:
    """Write flights in which actuators' friction grows by so much, N·m, each time."""
    rng = np.random.default_rng(seed)
    worn = []
    for day in range(flights):
        verdicts = []
        for actuator, slope in growth:
            value = 0.225 + slope * day + 0.006 * rng.standard_normal()
            condition: Condition = "normal" if value < 0.375 else "degraded"
            verdicts.append(verdict(shown(value), actuator=actuator, condition=condition))
        worn.append(flown(*verdicts, day=day, identities=[identity(day=day)]))
    write_store(store, {"D-A": worn})
