"""Precedents: labelled actuators of logs, added to a base, and divided by whole flights for training."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from mavhums.actuator.mapping import Samples
from mavhums.actuator.profile import Actuator, Airframe
from mavhums.app.analysis import analyse
from mavhums.app.settings import Options
from mavhums.app.sinks import Events
from mavhums.core.arrays import Array, Flags
from mavhums.core.errors import MavhumsError
from mavhums.engine.events import Event
from mavhums.learn.evaluation import split_flights
from mavhums.learn.precedents import LABELS, Label, Origin, Precedent, PrecedentBase, Provenance

_SIMULATED = "4D415648554D5353"
"""Beginning of the unique id of every board that ``mavhums-sim`` flies: MAVHUMSS in ASCII."""

TRAINS, CALIBRATES, MEASURES = range(3)
PURPOSE = ("train", "calibrate", "measure")
"""What a flight is for."""

_PARTS = 3
"""Flights that a label needs at least, for one of each part."""

TAUGHT: Final[tuple[Label, ...]] = ("normal", "friction_emergency")
"""The conditions that a network of samples distinguishes."""


def add_log(
    base: PrecedentBase,
    log: str | os.PathLike[str],
    labels: Mapping[str, Label],
    *,
    airframe: Airframe | None = None,
    origin: Origin | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Precedent]:
    """Add the labelled actuators of a log to the base.

    Parameters
    ----------
    base
        The precedent base.
    log
        A log.
    labels
        The true condition of each actuator, known for example from an inspection, never from this program's
        verdict; that of "" is for all others. Only normal can be the condition of all.
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
    if labels.get("", "normal") != "normal":
        problem = f"{log}: {labels['']} of every actuator at once is unlikely"
        raise MavhumsError(problem, "name them with --actuator, or in the column actuator of the table")
    found: dict[tuple[int, str], list[Samples]] = {}

    def collect(events: Sequence[Event]) -> None:
        for event in events:
            if isinstance(event, Samples):
                found.setdefault((event.vehicle, event.actuator), []).append(event)

    assessment = analyse(log, Options(airframe=airframe), sinks=[Events(collect)], progress=progress)
    carried = sorted({actuator for _, actuator in found})
    absent = sorted(labels.keys() - {"", *carried})
    if not carried or absent:
        wanted = absent[0] if absent else "any actuator"
        remedy = (
            f"it carries: {', '.join(carried)}" if carried else "list its contents with `mavhums inspect`"
        )
        raise MavhumsError(f"{log}: does not carry {wanted} of a known airframe", remedy)
    start_utc = assessment.log.start_utc
    start_us = round(datetime.fromisoformat(start_utc).timestamp() * 1e6) if start_utc else 0
    tiers = {(verdict.vehicle, verdict.actuator): verdict.tier for verdict in assessment.verdicts}
    boards = {flight.vehicle: flight.board or "" for flight in assessment.log.flight}
    added = []
    for (vehicle, actuator), blocks in found.items():
        label = labels.get(actuator, labels.get(""))
        if label is None:
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
        values, measured = (
            np.concatenate([getattr(block, name) for block in blocks]) for name in ("values", "measured")
        )
        time_us = start_us + np.rint(time_s * 1e6).astype(np.int64)
        added.append(base.add(provenance, time_us, values, measured))
    return added


class FlownActuator(NamedTuple):
    """A labelled actuator of a log: V1…V12 (n, 12) at ``time_s`` (n,), and which of them are measured."""

    actuator: Actuator
    flight: int
    label: Label
    time_s: Array
    values: Array
    measured: Flags


class FlownFlights:
    """The precedents of an airframe, divided by whole flights; their samples are read when asked for.

    A quarter of the flights calibrates the networks and a quarter of the others measures them, if each part
    then has every label. Flights of a label that fewer than three flights have train in any case.

    Parameters
    ----------
    base
        The precedent base; flown and simulated precedents are treated alike.
    airframe
        The profile whose precedents are taken.
    seed
        Of the division.

    Attributes
    ----------
    labels
        The labels that the flights have, in the order of :data:`mavhums.learn.precedents.LABELS`.
    logs
        Hashes of the logs; all actuators of one log are one flight.
    held_out
        The labels of the flights that calibrate and measure; empty if none are held out.

    Raises
    ------
    MavhumsError
        If the base has no precedent of the airframe.
    """

    def __init__(self, base: PrecedentBase, airframe: Airframe, *, seed: int) -> None:
        self._base = base
        self._parts = {actuator.name: actuator for actuator in airframe.actuators}
        self._known = [
            precedent
            for precedent in base
            if precedent.provenance.airframe == airframe.name and precedent.provenance.actuator in self._parts
        ]
        if not self._known:
            raise MavhumsError(
                f"{base.folder}: no precedent of the airframe {airframe.name}",
                f"add one with `mavhums precedents add LOG --airframe {airframe.name}`",
            )
        said = [precedent.provenance for precedent in self._known]
        self.logs, flight = np.unique([each.sha256 for each in said], return_inverse=True)
        label = np.array([LABELS.index(each.label) for each in said])
        self.labels = tuple(LABELS[k] for k in np.unique(label))
        self._flight, self._label = flight, label
        self._part = np.full(len(said), TRAINS)
        own = {k: np.unique(flight[label == k]) for k in np.unique(label).tolist()}
        rare = [flights for flights in own.values() if len(flights) < _PARTS]
        rows = np.flatnonzero(~np.isin(flight, np.concatenate([[-1], *rare])))
        for part in (MEASURES, CALIBRATES):
            divided = split_flights(label[rows], flight[rows], seed=seed) if len(rows) else None
            if divided is None:
                self._part[:] = TRAINS
                break
            self._part[rows[divided[1]]] = part
            rows = rows[divided[0]]
        self.held_out = tuple(LABELS[k] for k in np.unique(label[self._part == MEASURES]))

    def counts(self) -> str:
        """Return how many flights each label has, and what they are for."""
        each = (f"{self.flights_of(label)} {label}" for label in self.labels)
        parts = (f"{len(np.unique(self._flight[self._part == k]))} {what}" for k, what in enumerate(PURPOSE))
        return f"{len(self.logs)} logs ({', '.join(each)}): {', '.join(parts)}"

    def flights_of(self, label: Label) -> int:
        """Return how many flights have a label."""
        return len(np.unique(self._flight[self._label == LABELS.index(label)]))

    def read(self, part: int, labels: Sequence[str] = LABELS) -> Iterator[FlownActuator]:
        """Read the actuators of a part that have one of some labels."""
        for precedent, flight, own in zip(self._known, self._flight.tolist(), self._part, strict=True):
            said = precedent.provenance
            if own == part and said.label in labels:
                history = self._base.read(precedent)
                yield FlownActuator(self._parts[said.actuator], flight, said.label, *history)
