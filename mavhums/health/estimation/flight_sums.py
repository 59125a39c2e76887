"""The record of one flight for the comparison with others: sums of its windows, in bounded memory."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import column
from mavhums.core.statistics import AIR_DENSITY
from mavhums.health.estimation.equations.interface import (
    OwnEquation,
    ServoSpeed,
    SlotLoad,
    friction_with_load,
)
from mavhums.health.estimation.equations.own_scale import CURRENT, VOLTAGE
from mavhums.health.estimation.least_squares import Groups, Prior, eliminated, packed, sums_of_slots
from mavhums.health.estimation.motion import angle_speed, central_slope, lasting, longest_gap_s
from mavhums.health.estimation.slots import AIRSPEED, SENSED, SHAFT, Slots
from mavhums.health.estimation.thresholds import (
    ANGLE_SPEED_S,
    COARSE_SPEED_SHARE,
    LONGEST_GAP_PERIODS,
    OWN_RATE_HZ,
)
from mavhums.results.reasons import Reason
from mavhums.results.verdict import OwnRecord

KEPT = ("sign", "speed", "acceleration", "load", "angle", "loaded", "left")
"""The columns whose sums of products a record holds."""
TERMS = ("sign", "speed", "acceleration", "load", "angle", "pressure", "one", "loaded")
LOAD, ANGLE, PRESSURE, ONE, LOADED = 3, 4, 5, 6, 7
_COLUMNS = [0, 1, 2, LOAD, ANGLE, LOADED, len(TERMS)]
_LINEAR_TERMS = LOADED
_V7, _V10 = column("V7"), column("V10")
_BY_SPEED = (CURRENT.name, VOLTAGE.name)
"""Equations of the motor's speed; the position error has the angle's."""
_HALF_DENSITY = 0.5 * AIR_DENSITY


class OwnSums:
    """Collects the sums of one equation over one flight.

    Parameters
    ----------
    equation, actuator
        The equation, and the actuator of the flight.
    """

    def __init__(self, equation: OwnEquation, actuator: Actuator) -> None:
        self._equation, self._actuator = equation, actuator
        self._turned = AngleIntegrator(longest_gap_s(actuator))
        free = np.full(_LINEAR_TERMS, np.inf)
        self._load = SlotLoad(Prior(np.zeros(_LINEAR_TERMS), free), (LOAD, ANGLE, PRESSURE, ONE))
        self._groups = Groups(len(TERMS), self._in_window)
        self._span, self._samples = 0.0, 0
        self._pressure = False

    def feed(self, slots: Slots) -> None:
        """Process the samples of several slots."""
        found = terms(self._equation, self._actuator, slots, self._turned)
        time_s = slots.time_s[slots.judged]
        # Rate and duration are those of the evidence, not of the log.
        seen = np.isfinite(found.y) & np.isfinite(found.X[:, 1])
        found = self._loaded(slots, found)
        rows = sums_of_slots(found.X, found.y, found.usable, slots.start)
        ends = np.append(slots.start[1:], time_s.size)
        self._groups.feed(slots.index, rows)
        for k in range(len(rows)):
            times = time_s[slots.start[k] : ends[k]][seen[slots.start[k] : ends[k]]]
            if times.size and times[-1] > times[0]:
                self._span += float(times[-1] - times[0])
                self._samples += times.size - 1

    def record(self) -> OwnRecord | None:
        """Return the record of the flight so far; None if it has no evidence for this equation."""
        groups = self._groups.parts()
        if not groups or not self._samples or self.rate_hz < OWN_RATE_HZ:
            return None
        return OwnRecord(
            equation=self._equation.name,
            setup=self._setup(),
            rate_hz=float(f"{self.rate_hz:.3g}"),
            duration_s=round(self._span, 1),
            groups=tuple((float(count), *packed(gram)) for count, gram in groups),
        )

    @property
    def gap(self) -> Reason | None:
        """The reason for missing evidence; None if there is evidence, or if nothing is measured."""
        if not self._samples or self.record() is not None:
            return None
        if self.rate_hz < OWN_RATE_HZ:
            return Reason("own_too_slow", quantity=self._equation.quantity, needed_hz=OWN_RATE_HZ)
        return Reason("own_still", quantity=self._equation.quantity)

    @property
    def rate_hz(self) -> float:
        """Rate of the samples that carry the left side, where there are any."""
        return self._samples / self._span

    def _loaded(self, slots: Slots, found: Terms) -> Terms:
        """Return the terms with that of the friction by load; unusable before the load is known."""
        base = np.ascontiguousarray(found.X[:, :_LINEAR_TERMS])
        load = self._load.feed(slots, base, found.y, found.usable)
        X = found.X.copy()
        X[:, LOADED] = friction_with_load(found.X[:, 1], load)
        return Terms(X, found.y, found.usable & np.isfinite(load))

    def _in_window(self, gram: Array) -> Array:
        """Return a window's sums without its own offset."""
        self._pressure |= bool(gram[PRESSURE, PRESSURE] > 0.0)
        # An integrated angle has an unknown zero: its load is a multiple of the pressure.
        free = [ONE] if self._turned.source == "V3" else [ONE, PRESSURE]
        return eliminated(gram, free)[np.ix_(_COLUMNS, _COLUMNS)]

    def _setup(self) -> str:
        """Return the measurement set-up as text; only flights with the same set-up are compared."""
        angle = "V3, its speed" if self._turned.coarse else self._turned.source or "speed"
        return f"angle from {angle}, {'airspeed' if self._pressure else 'no airspeed'}"


class Terms(NamedTuple):
    """Terms of the judged samples.

    Attributes
    ----------
    X, y, usable
        Shapes (n, 8), (n,) and (n,).
    """

    X: Array
    y: Array
    usable: Flags


class AngleIntegrator:
    """The angle of a servo, measured or integrated from its speed, block after block.

    The command is not used as the angle: its lag, times load, would appear as drag. An integrated angle has
    an unknown zero, which a free term of the pressure absorbs in each window.

    Parameters
    ----------
    longest_s
        Longest time between samples that is travel.

    Attributes
    ----------
    source
        ``V3``, or ``speed`` where it is integrated; decided by the first slot that has either.
    coarse
        Whether the speed is a coarse register beside a measured angle; decided by the first slot in which the
        angle moves.
    """

    def __init__(self, longest_s: float) -> None:
        self.source: str | None = None
        self.coarse: bool | None = None
        self._shaft: str | None = None
        self._longest_s = longest_s
        self._time_s, self._rad_s, self._angle = np.nan, 0.0, 0.0

    def one_shaft(self, slots: Slots) -> Slots:
        """Return the slots with the speed of one shaft only: the rotor's if the first slot has it."""
        rotor, output = (np.isfinite(slots.values[slots.judged, key]) for key in (_V7, _V10))
        self._shaft = self._shaft or _first(slots.start, V7=rotor, V10=output)
        values = slots.values.copy()
        values[:, _V7 if self._shaft == "V10" else _V10] = np.nan
        return replace(slots, values=values)

    def fine_speed(self, actuator: Actuator, slots: Slots, speed: ServoSpeed) -> ServoSpeed:
        """Return the speed, from the measured angle where its register is coarse."""
        if self.coarse is None:
            angle = np.where(slots.values[:, SENSED] > 0, slots.values[:, SHAFT], np.nan)
            pairs = [np.diff(column, prepend=np.nan)[slots.judged] for column in (angle, speed.rad_s)]
            known = np.isfinite(pairs[0]) & np.isfinite(pairs[1])
            turns, steps = slots.sums(np.stack([known & (pair != 0.0) for pair in pairs], axis=1) * 1.0).T
            shown = np.flatnonzero(turns >= COARSE_SPEED_SHARE * OWN_RATE_HZ)
            if shown.size:
                self.coarse = bool(steps[shown[0]] < COARSE_SPEED_SHARE * turns[shown[0]])
        if not self.coarse:
            return speed
        angle = np.radians(slots.values[:, SHAFT])
        fine = angle_speed(slots.time_s, angle, ANGLE_SPEED_S)
        return ServoSpeed(fine, float(np.radians(actuator.moving_speed_deg_s)))

    def feed(self, slots: Slots, rad_s: Array) -> Array:
        """Return the angle, rad, shape (n,): the output shaft's, or that of the shaft whose speed it is."""
        time_s, values = slots.time_s[slots.judged], slots.values[slots.judged]
        shaft_deg = values[:, SHAFT]
        measured = np.isfinite(shaft_deg) & (values[:, SENSED] > 0)
        self.source = self.source or _first(slots.start, V3=measured, speed=np.isfinite(rad_s))
        if self.source == "V3":
            return np.where(measured, np.radians(shaft_deg), np.nan)
        speed = np.nan_to_num(rad_s)
        before_s = time_s[0] if np.isnan(self._time_s) else self._time_s
        # A pause of the telemetry is no travel.
        step_s = np.clip(np.diff(time_s, prepend=before_s), 0.0, self._longest_s)
        around = (speed + np.concatenate([[self._rad_s], speed[:-1]])) / 2
        angle: Array = np.concatenate([[self._angle], step_s * around]).cumsum()[1:]
        self._time_s, self._rad_s, self._angle = float(time_s[-1]), float(speed[-1]), float(angle[-1])
        return angle


def _first(start: Integers, **known: Flags) -> str | None:
    """Return which is known in the first slot that knows any of them, the earlier one if it knows several."""
    there = {name: np.logical_or.reduceat(mask, start) for name, mask in known.items()}
    slots = np.flatnonzero(np.logical_or.reduce([*there.values()]))
    return next(name for name, mask in there.items() if mask[slots[0]]) if slots.size else None


def terms(equation: OwnEquation, actuator: Actuator, slots: Slots, turned: AngleIntegrator) -> Terms:
    """Return the terms at the samples that the slots judge."""
    slots = turned.one_shaft(slots)
    speed = equation.speed(actuator, slots)
    if equation.name in _BY_SPEED:
        speed = turned.fine_speed(actuator, slots, speed)
    own, longest_s = slots.judged, LONGEST_GAP_PERIODS / OWN_RATE_HZ
    acceleration, span = central_slope(slots.time_s, speed.rad_s)
    # Central differences span two samples.
    moving = lasting(slots.time_s, speed.rad_s, speed.moving_rad_s, longest_s) & (span < 2 * longest_s)
    values = slots.values
    angle = turned.feed(slots, speed.rad_s[own])
    pressure = _HALF_DENSITY * np.nan_to_num(values[own, AIRSPEED]) ** 2
    X = np.empty((angle.size, len(TERMS)))
    X[:, 0] = np.sign(speed.rad_s[own])
    X[:, 1] = speed.rad_s[own]
    X[:, 2] = acceleration[own]
    X[:, LOAD] = pressure * angle
    # A load that turns with the shaft: the sine is the angle of a surface, and holds for an arm.
    X[:, ANGLE] = np.sin(angle) if turned.source == "V3" else angle
    X[:, PRESSURE] = pressure
    X[:, ONE] = 1.0
    X[:, LOADED] = 0.0
    y = np.ascontiguousarray(equation.left(actuator, slots)[own])
    usable = moving[own] & np.isfinite(y) & np.isfinite(X).all(axis=1)
    return Terms(X, y, usable)
