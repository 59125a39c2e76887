"""Precedents from flights: adds logs to the precedent base, and reads training samples from it."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mavhums.actuator.profile import Airframe
from mavhums.app.analysis import analyse
from mavhums.app.settings import Options
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.engine.events import Event, Samples
from mavhums.learn.precedents import Label, Origin, Precedent, PrecedentBase, Provenance

__all__ = ["add_log", "flown_samples"]

_SIMULATED = "4D415648554D5353"
"""Beginning of the unique id of every board that ``mavhums-sim`` flies: MAVHUMSS in ASCII."""


def add_log(
    base: PrecedentBase,
    log: str | os.PathLike[str],
    *,
    label: Label,
    actuators: Sequence[str] = (),
    airframe: Airframe | None = None,
    origin: Origin | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Precedent]:
    """Add the actuators of a log to the base, all in the same condition.

    Parameters
    ----------
    base
        The precedent base.
    log
        A ``.tlog`` file.
    label
        The true condition, known for example from an inspection, never from this program's verdict.
    actuators
        Names of the actuators; all in the log if empty. The label emergency needs names.
    airframe
        Airframe profile; None uses the one that the log names.
    origin
        Whether the log was flown or simulated; None for what its board says: simulated if it is of
        the simulator that comes with mavhums, else flown.
    progress
        Called with the number of bytes read.

    Raises
    ------
    MavhumsError
        If the log cannot be read, names no airframe, or has no data of the actuators.
    """
    if label == "emergency" and not actuators:
        raise MavhumsError("an emergency of every actuator at once is unlikely", "name them with --actuator")
    found: dict[tuple[int, str], list[Samples]] = {}

    def collect(events: Sequence[Event]) -> None:
        for event in events:
            if isinstance(event, Samples):
                found.setdefault((event.vehicle, event.actuator), []).append(event)

    assessment = analyse(log, Options(airframe=airframe), consume=collect, progress=progress)
    carried = sorted({actuator for _, actuator in found})
    absent = sorted(set(actuators) - set(carried))
    if not carried or absent:
        wanted = absent[0] if absent else "any actuator"
        remedy = (
            f"it carries: {', '.join(carried)}" if carried else "see what it holds with `mavhums inspect`"
        )
        raise MavhumsError(f"{log}: does not carry {wanted} of a known airframe", remedy)
    start_us = _start_us(assessment.log.start_utc)
    tiers = {(verdict.vehicle, verdict.actuator): verdict.tier for verdict in assessment.verdicts}
    boards = {flight.vehicle: flight.board or "" for flight in assessment.log.flight}
    added = []
    for (vehicle, actuator), blocks in found.items():
        if actuators and actuator not in actuators:
            continue
        provenance = Provenance(
            log=Path(log).name,
            sha256=assessment.log.sha256 or "",
            vehicle=vehicle,
            actuator=actuator,
            airframe=assessment.airframe or "",
            tier=str(tiers.get((vehicle, actuator))),
            label=label,
            origin=origin or ("simulated" if boards.get(vehicle, "").startswith(_SIMULATED) else "flown"),
        )
        time_s = np.concatenate([block.time_s for block in blocks])
        values = np.concatenate([block.values for block in blocks])
        added.append(base.add(provenance, start_us + np.rint(time_s * 1e6).astype(np.int64), values))
    return added


def flown_samples(base: PrecedentBase, airframe: Airframe, *, every: int) -> tuple[Array, Flags, Integers]:
    """Return the moving samples of an airframe's precedents: values, emergency, flight number.

    All actuators of one log share a flight number, so that splits keep whole flights together.

    Parameters
    ----------
    base
        The precedent base; flown and simulated precedents are treated alike.
    airframe
        The airframe profile whose precedents are read.
    every
        Decimation: every n-th moving sample is kept.

    Returns
    -------
    tuple of NDArray
        Shapes (n, 12), (n,) and (n,).

    Raises
    ------
    MavhumsError
        If the base has no precedent of the airframe.
    """
    values, emergency, flights = [], [], []
    logs: dict[str, int] = {}
    parts = {actuator.name: actuator for actuator in airframe.actuators}
    for precedent in base:
        said = precedent.provenance
        if said.airframe != airframe.name or said.actuator not in parts:
            continue
        history = base.read(precedent)
        moving = history[np.abs(history[:, 6]) > parts[said.actuator].moving_speed_rev_min][::every]
        values.append(moving)
        emergency.append(np.full(len(moving), said.label == "emergency"))
        flights.append(np.full(len(moving), logs.setdefault(said.sha256, len(logs))))
    if not values:
        raise MavhumsError(
            f"{base.folder}: no precedent of the airframe {airframe.name}",
            f"add one with `mavhums precedents add LOG --airframe {airframe.name}`",
        )
    return np.concatenate(values), np.concatenate(emergency), np.concatenate(flights)


def _start_us(start_utc: str | None) -> int:
    from datetime import datetime

    return round(datetime.fromisoformat(start_utc).timestamp() * 1e6) if start_utc else 0
