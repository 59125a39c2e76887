"""Simulated flights for training, calibration and measurement; windows of flights.

The fleet consists of individual two-mass actuators; each telemetry tier reports them with the
noise and quantisation of its messages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mavhums.actuator.align import Aligned
from mavhums.actuator.derive import Deriver
from mavhums.actuator.mapping import MAGNITUDES
from mavhums.actuator.profile import Actuator, Limits
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, column
from mavhums.health.actuator.votes import Classifier, VoteOutcome, count_votes, network_inputs, outcome
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.learn import Scheme, TrainingOptions
from mavhums.paper.flown import TRAINS, FlownActuator, FlownFlights
from mavhums_sim.conditions import Condition
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.ema import EmaParameters
from mavhums_sim.flight import ActuatorRecord, Flight, fly
from mavhums_sim.manoeuvres import CYCLOGRAMS

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


@dataclass(frozen=True)
class ModelOptions:
    """What a model is trained for, and on how much.

    Attributes
    ----------
    tier
        The model's telemetry: a name in :data:`TELEMETRY`.
    flights
        Number of simulated flights of each class, of four actuators each; 0 for precedents alone.
    seed, scheme
        Seed of all draws, and options of the stages.
    flown_weight
        Weight of a precedent's sample or window relative to a simulated one.
    """

    tier: str = "instrumented"
    flights: int = 24
    seed: int = 1
    scheme: Scheme = field(default_factory=Scheme)
    flown_weight: float = 1.0


@dataclass(frozen=True)
class Training:
    """What both networks of a model have in common.

    Attributes
    ----------
    actuator, options, flown
        The actuator's type, the options, and the precedents, if there are any.
    report, tick
        Called with a line about each step, and with nothing after each simulated flight.
    """

    actuator: Actuator
    options: ModelOptions
    flown: FlownFlights | None
    report: Callable[[str], None]
    tick: Callable[[], None]

    @property
    def telemetry(self) -> Telemetry:
        """The telemetry that the model is for."""
        return TELEMETRY[self.options.tier]

    def stages(self, keys: tuple[str, ...]) -> TrainingOptions:
        """Return how the stages run on the quantities, or statistics, on offer."""
        return TrainingOptions(self.options.seed, keys, self.options.scheme, self.report)

    def sources(self, part: int, *, held_out: bool) -> tuple[bool, FlownFlights | None]:
        """Return whether flights of a part are simulated, and the precedents that are in it.

        Both train; those ``held_out`` calibrate and measure in place of simulated flights.
        """
        simulated = self.options.flights > 0 and (part == TRAINS or not held_out)
        return simulated, self.flown if part == TRAINS or held_out else None


@dataclass(frozen=True)
class Fleet:
    """Flights of simulated actuators of one type, and how their telemetry reports them.

    Attributes
    ----------
    actuator, telemetry
        The actuator's type, and what reports it.
    seed
        Seed of the first flight and of its individuals; later flights use the next seeds.
    cyclograms, rates_hz
        Cyclograms, repeated in turn, and sample rates, one for each round of cyclograms.
    conditions
        Additional faults of every actuator.
    """

    actuator: Actuator
    telemetry: Telemetry
    seed: int
    cyclograms: Sequence[str] = tuple(CYCLOGRAMS)
    rates_hz: Sequence[float] = (100.0,)
    conditions: tuple[Condition, ...] = ()


def fly_fleet(fleet: Fleet, frictions_nm: Array) -> Iterator[ActuatorFlight]:
    """Simulate flights, and yield each actuator as the telemetry reports it.

    Parameters
    ----------
    fleet
        What is flown.
    frictions_nm
        Coulomb friction of the four actuators of each flight, shape (flights, 4).
    """
    parameters = parameters_of(fleet.actuator).two_masses()
    for number, row in enumerate(frictions_nm):
        rounds, place = divmod(number, len(fleet.cyclograms))
        flight = Flight(
            seed=fleet.seed + number,
            friction_nm={name: (float(f), float(f)) for name, f in zip(SURFACES, row, strict=True)},
            rate_hz=fleet.rates_hz[rounds % len(fleet.rates_hz)],
            parameters=parameters,
            cyclogram=fleet.cyclograms[place],
            conditions=dict.fromkeys(SURFACES, fleet.conditions),
            individuals=fleet.seed + number,
        )
        records = fly(flight).actuators.values()
        for k, (record, friction) in enumerate(zip(records, row, strict=True)):
            values, measured, _ = reported(fleet.actuator, fleet.telemetry, record, signed=k % 2 == 0)
            cyclogram = fleet.cyclograms[place]
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
