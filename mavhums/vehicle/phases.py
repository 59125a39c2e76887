"""Where a vehicle is: on the ground, in the air, in level flight, in contact with something.

No single signal shows it. A copter at rest runs its motors, a land detector of a manual mode says "in the
air" as soon as the pilot gives throttle, a barometer moves in the wash of propellers, and many logs lack
altitude or arming. So each signal adds to one sum, second by second, as much as it can be trusted: log odds
of flight against rest, bounded, so that later evidence can turn it. No state is kept but sums, and a
second is decided by what came up to its end: the result depends neither on blocks nor on what follows.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.results.reasons import Reason
from mavhums.vehicle.facts import FIXED_WING, IN_AIR, ON_GROUND
from mavhums.vehicle.grid import RATE_HZ, Seconds, lengths
from mavhums.vehicle.rotors import Rotors, mean_thrust
from mavhums.vehicle.signals import DERIVED, all_outputs

TAKE_OFF, LANDING, CONTACT = "take-off", "landing", "contact"

# Log odds that a second adds. Signals repeat themselves, so none is worth as much as its noise alone gives.
_DISARMED: Final = -8.0  # motors that are off carry nothing
_REPORTED: Final = {float(ON_GROUND): -4.0, float(IN_AIR): 1.0}
"""Of the landed state. Manual modes of ArduPilot report flight as soon as there is throttle."""
_HEIGHT_M, _CLIMB_M_S, _SPEED_M_S = 0.3, 0.2, 2.5
"""Noise of what a vehicle at rest measures: height in the wash of its propellers, vertical speed of GPS,
speed over ground. Twice as much is no evidence, three times is some."""
_NOTHING, _SURE = 2.0, 3.0
_CARRIES: Final = (-3.0, 2.0, 2.0, 2.0)
_MAY_CARRY: Final = (-3.0, 1.0, 1.0, 3.0)
"""Of outputs at these shares of its own hover, and of the least usual one before its own is known: what would
carry some vehicles is less than any other evidence, twice as much as most need is some."""
_RESTS, _FLIES, _LIFTS = 0.3, 0.7, 1.5
_USUAL_HOVER: Final = 0.12
"""Share of full thrust: the least of usual copters, before the own hover is known."""
_LEAST, _MOST, _TAKES_OFF, _LANDS = -3.0, 3.0, 1.0, 0.0
"""Bounds of the sum, and where the state turns."""

_HIGH_M, _FAST_M_S, _CARRIED_S = 5.0, 5.0, 10
"""A flight that was as high, as fast or carried by its motors for as many seconds is certain: vehicles at
rest, with a drifting barometer, show 2 m for 20 s."""

STOPS_S: Final = 4
"""Seconds in which a wing that lands rolls or slides: in 45 landings it sank by 2.7 m at most in them."""
_RECALLED_S: Final = 30

_LEAP_M: Final = 30.0  # in a second: an altitude from another origin, not a climb
_GROUND_SHARE: Final = 0.2  # of a second in the mean altitude of the ground: slower than a lift-off
_LEVEL_M_S: Final = 0.5
_LEVEL_COS: Final = np.cos(np.radians(20.0))
_DIPS: Final = 0.5  # of the hover thrust: less is a dip or a touch-down, and more may be the end of a climb
_HOVER_S: Final = 40.0  # memory of the hover thrust: the battery sags over minutes

_JUMPS_RAD_S2: Final[Array] = np.array([70.0, 70.0, 20.0])
"""Angular acceleration that no motor makes: one that stops turns a small quad by 70 in roll and pitch; all
of the effort about yaw makes 20."""
_COUPLED: Final = 0.5  # yaw acceleration by roll rate times pitch rate of a body that tumbles
_TUMBLES_COS: Final = 0.5
_UNWINDS_S: Final = 3.0
"""For as long after contact the effort unwinds and nothing is known of what it meant."""
_PRESSED_DEG: Final = 10.0
_PRESSED_RAD_S: Final = 0.15
_PRESSED_S: Final = 1.0
"""An attitude that stays off its demand by more, at rates below, for as long: something holds the craft. A
motor that fails turns it, and one that weakens is answered sooner."""


class PhaseEvent(NamedTuple):
    """A take-off, a landing, or a knock by a contact: its kind and its flight time, s.

    ``certain`` is whether the flight that a landing ends left no doubt: a drifting altitude looks like one.
    ``sank_m`` is how far a wing sank in the last :data:`STOPS_S` before it came to rest.
    """

    kind: str
    time_s: float
    certain: bool = True
    sank_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PhaseRows:
    """The phases of whole seconds, row by row.

    Attributes
    ----------
    airborne
        Where it flies, shape (n,).
    level
        Where it flies without climbing, sinking or leaning much: there its thrust is that of a hover.
    hover
        Thrust in the level flight since take-off, a share of full thrust; NaN before there is any.
    knocked
        Where it turns as no motor turns it, or did so up to 3 s before.
    held
        Where an obstacle holds it, or did so up to 3 s before.
    thrusts
        Thrust asked of each motor, a share of its full thrust, shape (n, motors); no motors if unknown.
    events
        What begins in these seconds, in order of time.
    """

    airborne: Flags
    level: Flags
    hover: Array
    knocked: Flags
    held: Flags
    thrusts: Array
    events: tuple[PhaseEvent, ...]


class Phases:
    """Follows the phases of one vehicle in constant memory.

    Examples
    --------
    >>> Phases().airborne
    False
    """

    def __init__(self) -> None:
        self.airborne = self.certain = False
        self._odds = 0.0
        self._since_s: float | None = None
        self._ground_m, self._altitude_m = np.nan, np.nan
        self._source = -1
        self._heights: deque[tuple[int, float]] = deque(maxlen=_RECALLED_S)
        self._hover, self._hovered = _USUAL_HOVER, 0
        self._rates = np.full((1, 3), np.nan)
        self._next, self._pressed = 0, 0
        self._knocked_ago = self._held_ago = 1 << 30  # rows

    @property
    def turning(self) -> bool:
        """Whether the latest second speaks against the present state."""
        return self._since_s is not None

    def feed(self, seconds: Seconds, rotors: Rotors | Reason | None = None) -> PhaseRows:
        """Take settled seconds that follow each other.

        Parameters
        ----------
        rotors
            Its motors; anything else where they are not known.
        """
        rows = len(seconds.index) * RATE_HZ
        thrusts, thrust = np.empty((rows, 0)), np.full(rows, np.nan)
        if isinstance(rotors, Rotors):
            flat = seconds.rows
            shape = len(seconds.index), RATE_HZ, -1
            pulses, mixer = all_outputs(flat).reshape(shape), flat["mixer"].reshape(shape)
            thrusts = rotors.thrusts(pulses, mixer).reshape(rows, -1)
            thrust = mean_thrust(thrusts, flat["mixer"])
        asked = _means(thrust.reshape(-1, RATE_HZ))
        measured = _Measured.of(seconds, hovers=rotors is not None)
        airborne, level = np.zeros((2, len(asked)), dtype=bool)
        hover = np.full(len(asked), np.nan)
        events = []
        for k, second in enumerate(seconds.index.tolist()):
            climb = self._climb(measured, k)
            self._heights.append((second, float(measured.altitude[k])))
            if self._step(second, climb, measured, k, float(asked[k])):
                kind = TAKE_OFF if self.airborne else LANDING
                began_s = self._since_s or 0.0
                sank_m = self._sunk(began_s) if measured.still_wing[k] else 0.0
                events.append(PhaseEvent(kind, began_s, self.airborne or self.certain, sank_m))
                self._since_s = None  # what spoke for this state does not speak for the next one
            airborne[k] = self.airborne
            height, speed = abs(self._altitude_m - self._ground_m), float(measured.speed[k])
            sure = height > _HIGH_M or speed > _FAST_M_S or self._hovered >= _CARRIED_S
            self.certain = self.airborne and (self.certain or sure)
            level[k] = self.airborne and not climb > _LEVEL_M_S and measured.upright[k] > _LEVEL_COS
            if self._hovered:
                hover[k] = self._hover
            if level[k] and asked[k] > _DIPS * self._hover:
                self._hovered += 1
                share = max(1.0 / self._hovered, 1.0 / _HOVER_S)
                self._hover += share * (float(asked[k]) - self._hover)
        knocked, held, contacts = self._contacts(seconds)
        return PhaseRows(
            np.repeat(airborne, RATE_HZ),
            np.repeat(level, RATE_HZ),
            np.repeat(hover, RATE_HZ),
            knocked,
            held,
            thrusts,
            tuple(sorted([*events, *contacts], key=lambda event: event.time_s)),
        )

    def _sunk(self, second: float) -> float:
        """Return how far it sank up to a second, m; zero where that is not known."""
        heights = dict(self._heights)
        sunk = heights.get(int(second) - STOPS_S, np.nan) - heights.get(int(second), np.nan)
        return max(sunk, 0.0) if np.isfinite(sunk) else 0.0

    def _climb(self, measured: _Measured, k: int) -> float:
        """Return the vertical speed of a second, m/s; NaN if unknown. Follow the origin of the altitude."""
        altitude, source = float(measured.altitude[k]), int(measured.source[k])
        change = altitude - self._altitude_m
        if np.isfinite(altitude):
            if source != self._source or abs(change) > _LEAP_M:
                self._ground_m += change
                change = np.nan
                self._heights.clear()
            self._altitude_m, self._source = altitude, source
        climb = float(measured.climb[k])
        return abs(climb if np.isfinite(climb) else change)

    def _step(self, second: int, climb: float, measured: _Measured, k: int, asked: float) -> bool:
        """Weigh the evidence of a second; return whether the state turns."""
        height = abs(self._altitude_m - self._ground_m)
        known = self._hovered > 0
        share = asked / self._hover
        # What only flies forward and does not move is at rest, also where it landed higher than it took off.
        at_rest = bool(measured.still_wing[k])
        found = [
            _DISARMED if measured.armed[k] == 0.0 else np.nan,
            _REPORTED.get(float(measured.landed[k]), np.nan),
            np.nan if at_rest else _beyond(height, _HEIGHT_M),
            max(_beyond(climb, _CLIMB_M_S), 0.0),
            max(_beyond(float(measured.speed[k]), _SPEED_M_S), -_NOTHING if at_rest else 0.0),
            np.interp(share, (_RESTS, _FLIES, _LIFTS, 2 * _LIFTS), _CARRIES if known else _MAY_CARRY),
        ]
        before = self._odds
        self._odds = float(np.clip(before + np.nansum(found), _LEAST, _MOST))
        towards = self._odds < before if self.airborne else self._odds > before
        self._since_s = (self._since_s if self._since_s is not None else second) if towards else None
        # Outputs that could carry it freeze the ground: a slow lift-off would take it along.
        if not self.airborne and np.isfinite(self._altitude_m) and not share > _RESTS:
            off = self._altitude_m - self._ground_m
            self._ground_m = self._ground_m + _GROUND_SHARE * off if np.isfinite(off) else self._altitude_m
        turned = self._odds <= _LANDS if self.airborne else self._odds >= _TAKES_OFF
        if turned:
            self.airborne = not self.airborne
            self._hovered = 0
        return turned

    def _contacts(self, seconds: Seconds) -> tuple[Flags, Flags, list[PhaseEvent]]:
        """Return where something knocks the vehicle or holds it, and the knocks that begin."""
        start = int(seconds.index[0])
        if start != self._next:
            self._rates, self._pressed = np.full((1, 3), np.nan), 0
        self._next = start + len(seconds.index)
        rates = seconds.signals["rates"].reshape(-1, 3)
        # The change of the attitude is smooth: it shows no knock, and where it replaces them there is a step.
        derived = np.repeat(seconds.ranks["rates"] == DERIVED, RATE_HZ)
        rates = np.where(derived[:, None], np.nan, rates)
        turned = np.abs(np.diff(rates, axis=0, prepend=self._rates))
        self._rates = rates[-1:]
        most = np.tile(_JUMPS_RAD_S2 / RATE_HZ, (len(rates), 1))
        most[:, 2] += _COUPLED * np.abs(rates[:, 0] * rates[:, 1]) / RATE_HZ
        attitude = seconds.signals["attitude"].reshape(-1, 3)
        # A craft that tumbles turns in every way without any contact.
        upright = np.cos(attitude[:, 0]) * np.cos(attitude[:, 1]) > _TUMBLES_COS
        knocks = np.asarray((turned > most).any(axis=1) & upright)
        off = np.abs(attitude[:, :2] - seconds.signals["demand"].reshape(-1, 2)).max(axis=1)
        pressed = (off > np.radians(_PRESSED_DEG)) & (np.abs(rates).max(axis=1) < _PRESSED_RAD_S)
        run = lengths(pressed, self._pressed)
        self._pressed = int(run[-1])
        knocked, self._knocked_ago, first = _lasting(knocks, self._knocked_ago)
        held, self._held_ago, _ = _lasting(run >= _PRESSED_S * RATE_HZ, self._held_ago)
        times = (start + np.flatnonzero(first) / RATE_HZ).tolist()
        return knocked, held, [PhaseEvent(CONTACT, time_s) for time_s in times]


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """What the seconds show, shape (k,), NaN where unknown."""

    armed: Array
    landed: Array
    altitude: Array
    source: Integers
    climb: Array
    speed: Array
    still_wing: Flags
    upright: Array

    @classmethod
    def of(cls, seconds: Seconds, *, hovers: bool) -> _Measured:
        """Return what phases need; ``hovers`` is whether rotors may carry the vehicle."""
        signals = seconds.signals
        roll, pitch = (signals["attitude"][:, :, axis] for axis in range(2))
        over_ground, airspeed = (_means(signals[name][:, :, 0]) for name in ("groundspeed", "airspeed"))
        wing = (signals["state"][:, -1, 0] == FIXED_WING) & ~(signals["vtol"][:, -1, 0] > 0) & (not hovers)
        return cls(
            signals["state"][:, -1, 2],
            signals["landed"][:, -1, 0],
            _means(signals["altitude"][:, :, 0]),
            seconds.ranks["altitude"],
            _means(signals["velocity"][:, :, 2]),
            over_ground,
            wing & (over_ground < _SPEED_M_S) & ~(airspeed >= _SPEED_M_S),  # against the wind it may fly
            _means(np.cos(roll) * np.cos(pitch)),
        )


def _means(values: Array) -> Array:
    """Return the mean of each second over the rows with a number, shape (k,); NaN without any."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    total = np.where(known, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _beyond(value: float, noise: float) -> float:
    """Return the log odds of flight that a value adds, whose noise on the ground is known."""
    return float(np.clip(0.5 * (value / noise) ** 2 - _NOTHING, -_NOTHING, _SURE))


def _lasting(rows: Flags, ago: int) -> tuple[Flags, int, Flags]:
    """Return where it lasts after rows, for how many rows it is over at the end, and where it begins."""
    place = np.arange(len(rows))
    last = np.where(rows, place, -(1 << 30))
    last[0] = max(last[0], -ago)
    since = place - np.maximum.accumulate(last)
    lasts = since <= _UNWINDS_S * RATE_HZ
    before = np.append(ago <= _UNWINDS_S * RATE_HZ, lasts[:-1])
    return lasts, int(since[-1]) + 1, rows & ~before
