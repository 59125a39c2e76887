"""A closed-loop flight: the aircraft responds to its surfaces, and the autopilot to the aircraft."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mavhums_sim._arrays import Array
from mavhums_sim.closed_loop.aircraft import FRAME_S, Aircraft, Dispersion
from mavhums_sim.closed_loop.autopilot import Autopilot
from mavhums_sim.closed_loop.emas import Emas
from mavhums_sim.closed_loop.frame import COLUMNS, MEMORY, advance
from mavhums_sim.closed_loop.mission import PHASES, plan, sticks
from mavhums_sim.closed_loop.prepare import Gust, fault_rows, measurement_errors, servo_rows, vehicle_row
from mavhums_sim.closed_loop.scenario import ClosedLoop
from mavhums_sim.closed_loop.surfaces import LAYOUTS
from mavhums_sim.cyclogram import Cyclogram
from mavhums_sim.flight import FlightRecord
from mavhums_sim.motion import CONTROL_PERIOD_S

_LAUNCH_HEIGHT_M, _LAUNCH_SPEED = 8.0, 23.0
_LOWEST_M = 1.0
_AIR_DENSITY = 1.225


@dataclass(frozen=True, slots=True, eq=False)
class FlownLoop:
    """The result of a simulated flight; its log begins at the launch.

    Attributes
    ----------
    log
        One row per frame of 10 ms: :data:`~mavhums_sim.closed_loop.frame.COLUMNS`, then the
        servos' demands, the surfaces' and the shafts' angles, rad.
    errors
        Errors of the autopilot's measurements, at 50 Hz.
    end
        ``complete``, ``landed`` or ``crashed``.
    emas
        Motion and telemetry of the EMAs over the flight; None for servos of reduced order.
    """

    flight: ClosedLoop
    log: Array
    errors: Array
    end: str
    emas: FlightRecord | None = None

    @property
    def time_s(self) -> Array:
        """Times of the rows since power-on, s, shape (n,)."""
        return self.flight.ground_s + np.arange(self.log.shape[0], dtype=np.float64) * FRAME_S

    @property
    def end_s(self) -> float:
        """Time of the last row, s."""
        return float(self.flight.ground_s + (self.log.shape[0] - 1) * FRAME_S)

    def column(self, name: str) -> Array:
        """Return a column of the log, shape (n,)."""
        return self.log[:, COLUMNS[name]]

    def servos(self, what: Literal["demand", "surface", "shaft"]) -> Array:
        """Return demands, surface or shaft angles of all servos, rad, shape (n, servos)."""
        count = len(LAYOUTS[self.flight.layout].surfaces)
        first = len(COLUMNS) + count * ("demand", "surface", "shaft").index(what)
        return self.log[:, first : first + count]


def fly_closed_loop(flight: ClosedLoop) -> FlownLoop:
    """Simulate a flight; the same description gives the same log.

    Examples
    --------
    >>> flown = fly_closed_loop(ClosedLoop(duration_s=40.0))
    >>> flown.end, flown.log.shape[0]
    ('complete', 2800)
    """
    layout = LAYOUTS[flight.layout]
    frames = round((flight.duration_s - flight.ground_s) / FRAME_S)
    count, half = len(layout.surfaces), frames // 2 + 1
    log = np.zeros((frames, len(COLUMNS) + 3 * count))
    errors, stick = measurement_errors(flight.seed, half), sticks(flight.seed, half)
    legs, memory = plan(flight.seed, flight.duration_s - flight.ground_s, flight.mission), np.zeros(1, MEMORY)
    memory["throttle"], memory["nav_pitch"] = 1.0, 0.15
    fixed = (
        vehicle_row(flight),
        _pilot(flight).record(),
        legs,
        memory,
        servo_rows(flight),
        fault_rows(flight),
    )
    out = np.zeros(5)
    matrices = (np.array(layout.mixing), layout.effect(), out)
    gust, aircraft = Gust(flight), _launched(flight)
    emas = _Shafts(flight, fixed[4], log)
    end = "complete"
    for k in range(frames):
        height = advance(aircraft.read(), emas.at(k), log, errors, stick, *fixed, *matrices)
        if not height > _LOWEST_M:
            end, log = "landed" if _approaches(legs, memory) else "crashed", log[:k]
            break
        if k == gust.next:
            aircraft.wind(*gust.step())
        aircraft.drive(out.tolist())
        aircraft.run()
    return FlownLoop(flight, log, errors, end, emas.record(log))


class _Shafts:
    """The shafts of the servos: those of the EMAs, or NaN, which selects the reduced order."""

    def __init__(self, flight: ClosedLoop, servos: NDArray[np.void], log: Array) -> None:
        self._angles = np.full(servos.size, np.nan)
        self._emas = Emas(flight.emas, flight.duration_s, flight.ground_s) if flight.emas else None
        self._log, self._servos = log, servos

    def at(self, k: int) -> Array:
        """Return the angles in frame ``k``, rad, shape (n,), after the demands of frame ``k − 1``."""
        if self._emas is not None:
            row = self._log[max(k - 1, 0)]
            demand = row[len(COLUMNS) : len(COLUMNS) + self._servos.size]
            pressure = 0.5 * _AIR_DENSITY * row[COLUMNS["airspeed"]] ** 2
            streams = self._servos["streams_with_alpha"] * row[COLUMNS["alpha"]]
            streams = streams + self._servos["streams_with_beta"] * row[COLUMNS["beta"]]
            self._emas.step(demand, float(pressure), streams, self._angles)
        return self._angles

    def record(self, log: Array) -> FlightRecord | None:
        return self._emas.record(_as_cyclogram(self._emas, log)) if self._emas else None


def _as_cyclogram(emas: Emas, log: Array) -> Cyclogram:
    """Return the flight as a cyclogram, at standstill before the launch."""
    commands = emas.commands()
    count = next(iter(commands.values())).size
    time_s = (np.arange(count, dtype=np.float64) + 1.0) * CONTROL_PERIOD_S
    frames = np.clip(np.arange(count) // 10 - count // 10 + log.shape[0], 0, log.shape[0] - 1)
    flying = np.arange(count) // 10 >= count // 10 - log.shape[0]

    def at(name: str) -> Array:
        return np.where(flying, log[frames, COLUMNS[name]], 0.0)

    incidence = dict.fromkeys(commands, at("alpha")) | {"rudder": at("beta")}
    state = (at(name) for name in ("roll", "pitch", "yaw", "height"))
    return Cyclogram("closed-loop", time_s, commands, at("airspeed"), incidence, *state)


def _pilot(flight: ClosedLoop) -> Autopilot:
    return Autopilot() if flight.airframe is None else Autopilot.tuned(flight.airframe, flight.flavour)


def _launched(flight: ClosedLoop) -> Aircraft:
    """Return the aircraft at launch, heading into the wind."""
    dispersion = Dispersion() if flight.airframe is None else Dispersion.draw(flight.airframe)
    aircraft = Aircraft(dispersion, flight.seed)
    speed = max(_LAUNCH_SPEED - flight.air.wind, 6.0)
    aircraft.place(_LAUNCH_HEIGHT_M, speed, 0.12, float(np.radians(flight.air.direction_deg)))
    aircraft.blow(flight.air)
    return aircraft


def _approaches(legs: NDArray[np.void], memory: NDArray[np.void]) -> bool:
    return int(legs["phase"][memory["leg"][0]]) == PHASES.index("approach")
