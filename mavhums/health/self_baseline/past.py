"""The data of earlier flights that one own-scale equation needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from typing import NamedTuple

from mavhums.health.estimation.equations import OWN_EQUATIONS, STROKE_EQUATIONS
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.wear import shows
from mavhums.health.self_baseline.thresholds import ALIKE_RATE_RATIO, REFERENCE_FLIGHTS
from mavhums.results.verdict import OwnRecord


class PastRecord(NamedTuple):
    """The records of the own-scale equations of an earlier flight.

    Attributes
    ----------
    records
        One record for each equation.
    date
        Date of its start, as in the report.
    healthy
        Whether it has no findings and can be part of a baseline.
    """

    records: tuple[OwnRecord, ...]
    date: str
    healthy: bool


PastSource = Callable[[str | None, datetime | None], Mapping[tuple[int, str], Sequence[PastRecord]]]
"""What gives the flights before by vehicle and actuator, of an airframe and the time when a flight begins."""


def record_of(records: Sequence[OwnRecord], name: str) -> OwnRecord | None:
    """Return the record of one equation."""
    return next((record for record in records if record.equation == name), None)


def compared(
    equation: OwnEquation, own: OwnRecord, past: Sequence[PastRecord]
) -> tuple[list[tuple[int, str, OwnRecord]], list[tuple[int, str, OwnRecord]]]:
    """Return the reference flights and the later ones, all with the same set-up as this flight.

    Each comes with its number among all flights, from 1, and its date.
    """
    alike = [
        (number, flight.date, flight.healthy, record)
        for number, flight in enumerate(past, 1)
        if (record := record_of(flight.records, equation.name)) and _alike(own, record) and shows(record)
    ]
    healthy = [number for number, _, sound, _ in alike if sound]
    # The first healthy ones for good: a baseline that follows would learn slow wear.
    last = healthy[:REFERENCE_FLIGHTS][-1] if healthy else 0
    reference = [(number, date, record) for number, date, sound, record in alike if sound and number <= last]
    after = [(number, date, record) for number, date, _, record in alike if number > last]
    return reference, after


def _alike(one: OwnRecord, other: OwnRecord) -> bool:
    faster, slower = max(one.rate_hz, other.rate_hz), min(one.rate_hz, other.rate_hz)
    # Estimates depend on the rate and on what measured the angle.
    return one.setup == other.setup and faster <= ALIKE_RATE_RATIO * slower


def comparable(records: Sequence[OwnRecord]) -> bool:
    """Return whether records contain the wear of an equation, and not only motor identification data."""
    names = {equation.name for equation in (*OWN_EQUATIONS, *STROKE_EQUATIONS)}
    return any(record.equation in names for record in records)
