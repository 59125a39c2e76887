"""Simulated flights and precedents for training; windows for calibration and measurement.

The fleet consists of individual two-mass actuators; each telemetry tier reports them with the
noise and quantisation of its messages.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from mavhums.actuator.align import Aligned
from mavhums.actuator.derive import Deriver
from mavhums.actuator.mapping import MAGNITUDES, Samples
from mavhums.actuator.profile import Actuator, Airframe, Limits
from mavhums.app.analysis import analyse
from mavhums.app.settings import Options
from mavhums.app.sinks import Events
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.engine.events import Event
from mavhums.health.actuator.votes import Classifier, VoteOutcome, count_votes, network_inputs, outcome
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.learn.evaluation import split_flights
from mavhums.learn.precedents import LABELS, Label, Origin, Precedent, PrecedentBase, Provenance
from mavhums_sim.conditions import Condition
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.ema import EmaParameters
from mavhums_sim.flight import ActuatorRecord, Flight, fly

_SIMULATED = "4D415648554D5353"
"""Beginning of the unique id of every board that ``mavhums-sim`` flies: MAVHUMSS in ASCII."""

TRAINS, CALIBRATES, MEASURES = range(3)
PURPOSE = ("train", "calibrate", "measure")
"""What a flight is for."""

_PARTS = 3
"""Flights that a label needs at least, for one of each part."""

TAUGHT: Final[tuple[Label, ...]] = ("normal", "friction_emergency")
"""The conditions that a network of samples tells apart."""


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


_HEALTHY_PER_LIMIT = 0.225 / 0.375
_EMERGENCY_PER_LIMIT = 1.025 / 0.875
_SLOPE_S = 0.04
_ESC_QUANTA = (0.01, 0.01, 1.0)  # V, A, rev/min of ESC_TELEMETRY


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The telemetry that a model is trained for.

    Attributes
    ----------
    name
        Name on the command line and in the model's name.
    gives
        Description for users.
    keys
        Quantities to choose from; V1 and V2 only while their distribution is the same in both classes.
    withheld
        Why the others are not offered.
    goal
        Share of its decided windows that a network of windows shall have right; it sets the probability from
        which it decides.
    esc
        Whether ESCs report: half of the actuators by ESC_STATUS and half by ESC_TELEMETRY.
    """

    name: str
    gives: str
    keys: tuple[str, ...]
    withheld: Mapping[str, str]
    goal: float
    esc: bool = False


TELEMETRY = {
    each.name: each
    for each in (
        Telemetry("instrumented", "instrumented", KEYS, {}, 0.995),
        Telemetry(
            "without-load",
            "instrumented, the load torque not measured",
            KEYS[:10],
            {"V11 V12": "not measured"},
            0.99,
        ),
        # The voltage is R·I + k·ω: of friction it shows what current and speed show. Where V4 and V7 were
        # chosen, a winding that gained 60 to 150 % made 39 % of the healthy windows an emergency; with V5 and
        # V7 2 %.
        Telemetry(
            "esc",
            "ESC",
            ("V1", "V5", "V7", "V8", "V9", "V10"),
            {
                "V2 V3": "integrals of the speed, which drift",
                "V4 V6": "they change with the winding's resistance",
                "V11 V12": "not measured",
            },
            0.98,
            esc=True,
        ),
    )
}
"""Telemetry by name; the one with the most quantities comes first."""


class ActuatorFlight(NamedTuple):
    """One actuator's flight: V1…V12 (n, 12) at ``time_s`` (n,), and which of them are measured."""

    flight: int
    cyclogram: str
    friction_nm: float
    time_s: Array
    values: Array
    measured: Flags


History = ActuatorFlight | FlownActuator
"""An actuator's flight, simulated or from a log."""

RATES_HZ = (100.0, 50.0, 25.0, 10.0)
"""Of the logs that calibrate and measure, in turn."""


def fly_fleet(
    actuator: Actuator,
    telemetry: Telemetry,
    frictions_nm: Array,
    *,
    seed: int,
    cyclograms: Sequence[str],
    rates_hz: Sequence[float] = (100.0,),
    conditions: tuple[Condition, ...] = (),
) -> Iterator[ActuatorFlight]:
    """Simulate flights, and yield each actuator as the telemetry reports it.

    Parameters
    ----------
    actuator
        The actuator's type.
    frictions_nm
        Coulomb friction of the four actuators of each flight, shape (flights, 4).
    seed
        Seed of the first flight and of its individuals; later flights use the next seeds.
    cyclograms, rates_hz
        Cyclograms, repeated in turn, and sample rates, one for each round of cyclograms.
    conditions
        Additional faults of every actuator.
    """
    parameters = parameters_of(actuator).two_masses()
    for number, row in enumerate(frictions_nm):
        cyclogram = cyclograms[number % len(cyclograms)]
        flight = Flight(
            seed=seed + number,
            friction_nm={name: (float(f), float(f)) for name, f in zip(SURFACES, row, strict=True)},
            rate_hz=rates_hz[number // len(cyclograms) % len(rates_hz)],
            parameters=parameters,
            cyclogram=cyclogram,
            conditions=dict.fromkeys(SURFACES, conditions),
            individuals=seed + number,
        )
        records = fly(flight).actuators.values()
        for k, (record, friction) in enumerate(zip(records, row, strict=True)):
            values, measured, _ = reported(actuator, telemetry, record, signed=k % 2 == 0)
            yield ActuatorFlight(number, cyclogram, float(friction), record.time_s, values, measured)


def reported(
    actuator: Actuator, telemetry: Telemetry, record: ActuatorRecord, *, signed: bool
) -> tuple[Array, Flags, Array | None]:
    """Return V1…V12 of a flight as the telemetry reports them, and which are measured, shape (n, 12) each.

    An ESC that is ``signed`` sends ESC_STATUS; of another the third are magnitudes of V4, V5 and V7, (n, 3).
    """
    if telemetry.esc:
        return _by_esc(actuator, record, signed=signed)
    values: Array = record.values.astype(np.float32).astype(np.float64)
    if telemetry.name == "without-load":
        values[:, [column("V11"), column("V12")]] = np.nan
    return values, np.isfinite(values), None


def _by_esc(actuator: Actuator, record: ActuatorRecord, *, signed: bool) -> tuple[Array, Flags, Array | None]:
    """Return what :func:`reported` does from an ESC's voltage, current and speed, as mapping does."""
    values = np.full(record.values.shape, np.nan)
    esc = record.esc.copy()
    esc[:, 2] = np.rint(esc[:, 2])
    if not signed:
        esc = np.rint(np.abs(esc) / _ESC_QUANTA) * _ESC_QUANTA
    values[:, [column("V4"), column("V5"), column("V7")]] = esc
    values[:, 0] = _command(record, record.time_s)
    middle = record.time_s - actuator.response_lag_s
    rate = (_command(record, middle + _SLOPE_S) - _command(record, middle - _SLOPE_S)) / (2 * _SLOPE_S)
    aligned = Aligned(
        utc_us=np.rint(record.time_s * 1e6).astype(np.int64),
        values=values,
        origin=np.zeros(values.shape, dtype=np.int8),
        command_rate=rate,
        tier="esc-signed" if signed else "esc-unsigned",
        signed=signed,
    )
    measured = np.isfinite(values)
    measured[:, MAGNITUDES] &= signed
    return Deriver(actuator).complete(aligned), measured, None if signed else esc


def _command(record: ActuatorRecord, time_s: Array) -> Array:
    return np.interp(time_s, record.motion.time_s, np.degrees(record.motion.command))


def friction_range(limits: Limits) -> tuple[float, float]:
    """Return the smallest and the largest simulated friction, N·m; the paper's for its limits."""
    return _HEALTHY_PER_LIMIT * limits.normal, _EMERGENCY_PER_LIMIT * limits.emergency


def parameters_of(actuator: Actuator) -> EmaParameters:
    """Return the simulator's parameters for a profile's EMA; missing ones are those of Table 1."""
    table_1 = EmaParameters.from_data_sheet()
    ema = actuator.known_ema()
    return replace(
        table_1,
        gear_ratio=ema.gear_ratio,
        torque_per_ampere=ema.gear_ratio * ema.torque_constant,
        resistance=ema.resistance,
        inertia=actuator.inertia_output,
        current_limit=table_1.supply_voltage / ema.resistance,
    )


def moving_samples(actuator: Actuator, flown: History) -> tuple[Array, Integers]:
    """Return what networks are asked of a flight's moving samples, (n, 12), and the second of each, (n,)."""
    cutter = SlotCutter()
    parts = [cutter.feed(flown.time_s, with_extra_columns(flown.values, flown.measured)), cutter.finish()]
    values, seconds = [], []
    for slots in parts:
        if slots is not None:
            seen = motion(actuator, slots)
            values.append(network_inputs(seen.values, seen.angles)[seen.moving])
            seconds.append(np.repeat(slots.index, slots.count())[seen.moving])
    return np.concatenate(values), np.concatenate(seconds)


def windows(
    actuator: Actuator, networks: Sequence[Classifier], flown: History
) -> Iterator[tuple[VoteOutcome | None, int]]:
    """Yield the network's result and the samples of each complete, non-overlapping ten-second window."""
    moving, seconds = moving_samples(actuator, flown)
    count = int(flown.time_s[-1] + 0.5) // WINDOW_S * WINDOW_S
    bounds = np.searchsorted(seconds, np.arange(count + 1))
    counts = count_votes(networks, moving, bounds)
    for start in range(0, count, WINDOW_S):
        window = counts[start : start + WINDOW_S]
        yield outcome(networks, window), int(bounds[start + WINDOW_S] - bounds[start])
