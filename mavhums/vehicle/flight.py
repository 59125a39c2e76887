"""The motion and the demand of the aircraft, row by row on the grid, and whether it is in forward flight.

The detectors of an axis use only these data.
"""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import STANDARD_GRAVITY
from mavhums.vehicle.airspeed import Current, Speed
from mavhums.vehicle.facts import ARDUPILOT, FIXED_WING, ON_GROUND
from mavhums.vehicle.grid import RATE_HZ, Seconds, lengths
from mavhums.vehicle.rows import PastRows, Rows
from mavhums.vehicle.signals import all_outputs
from mavhums.vehicle.surfaces import AXES, STEERING, Demands, Surfaces
from mavhums.vehicle.vtol import HOVERING_MODES, LEAST_SPEED, NO_LIFT

_ROVER, _BOAT = 10, 11
GROUND: Final = frozenset({_ROVER, _BOAT})
_VTOL: Final = range(19, 26)
_VTOL_FORWARD: Final = 4  # MAV_VTOL_STATE_FW
_UNLED_MODES: Final = (0, 2, 3, 4, 16)  # in these, ArduPlane does not control the attitude
LEAST_DRIVEN: Final = 0.5
"""Speed of a rover or a boat that drives forward, m/s. Lower lets the noise of a receiver at rest in."""

_LEAST_GROUND_SPEED_M_S: Final = 5.0
"""A wind of 8 m/s looks like forward flight to the pitot tube of an aircraft at rest. Higher loses flight
against the wind."""
_AIRBORNE_S: Final = 3
"""Seconds without a break before forward flight counts: fewer let gusts on the ground in."""
_STOPPED_BY: Final = ("vtol", "mode", "ground", "slow")
SPEEDS: Final = 4  # sources of a speed: sensor, wind triangle, ground, ground less the current
THROUGH_WATER: Final = 3
_SPACING_S: Final = 0.001  # resolution of the counts of spacings: a millisecond, as most stamps have
_SPACINGS: Final = 10_000  # up to 10 s: a rarer stream does not count as a stream


class Flight:
    """Converts settled seconds to rows.

    Parameters
    ----------
    surfaces
        The outputs that move each surface; None if they are not known yet.

    Attributes
    ----------
    flown_s, fastest
        Seconds of forward flight so far, of a rover or a boat of driving forward, and the highest airspeed or
        speed forward while armed, m/s.
    doubted_s
        Seconds of these in which the airspeed sensor contradicted ground speed and wind.
    settled_s
        Seconds of these in which the speed is measured, or turns have shown the wind.
    parted_s
        Seconds of these in which outputs that were inferred as one did not move as one.
    kinds, autopilots, parameters
        MAV_TYPEs and MAV_AUTOPILOTs that the vehicle reported, and the names of its parameters.
    heard
        Signals with at least one number.
    steers
        Whether the output that steers a rover or a boat is known.
    past
        The rows so far, without demands.
    """

    def __init__(self, surfaces: Surfaces | None) -> None:
        self.past = PastRows()
        self._use(surfaces)
        self._speed, self._current = Speed(), Current()
        self._next: int | None = None
        self._run = 0
        self.flown_s = 0
        self.doubted_s = self.settled_s = 0
        self.parted_s = 0.0
        self.fastest = 0.0
        self._rows_of: Counter[str] = Counter()
        self._used: defaultdict[str, Counter[int]] = defaultdict(Counter)
        self._spacings = {name: np.zeros(_SPACINGS, dtype=np.int64) for name in ("outputs", "rates", "force")}
        self.kinds: set[int] = set()
        self.autopilots: set[int] = set()
        self.parameters: Collection[str] = ()
        self.heard: set[str] = set()

    @property
    def on_ground(self) -> bool:
        """Whether it is a rover or a boat: only its steering is judged."""
        return bool(self.kinds & GROUND) or self.steers

    def lasted_s(self, what: str) -> float:
        """Return the seconds ``recorded``, ``armed``, ``fast``, or those of why fast seconds do not count.

        Fast is armed above :data:`LEAST_SPEED`. It is not forward flight for the first of these reasons: the
        ``vtol`` state, a hovering ``mode``, on the ``ground``, ``slow`` over ground, ``lift`` motors.
        """
        return self._rows_of[what] / RATE_HZ

    def used_s(self, signal: str) -> dict[int, int]:
        """Return the seconds of forward flight by the rank of the stream that carried a signal.

        Of ``speed`` they are by where it comes from, see :meth:`mavhums.vehicle.airspeed.Speed.feed`.
        """
        return {rank: seconds for rank, seconds in self._used[signal].most_common() if rank >= 0}

    def rate_hz(self, stream: str) -> float | None:
        """Return how often a second ``outputs``, ``rates`` or ``force`` came in flight; None if not known."""
        counts = self._spacings[stream].cumsum()
        if not counts[-1]:
            return None
        return 1.0 / (_SPACING_S * (int(np.searchsorted(counts, counts[-1] / 2)) + 0.5))

    def _use(self, surfaces: Surfaces | None) -> None:
        self._lift = surfaces.lift if surfaces else NO_LIFT
        self._demands = Demands(surfaces) if surfaces else None
        self.steers = surfaces is not None and surfaces.axes == (STEERING,)
        self.parted_s = 0.0

    def learn(self, surfaces: Surfaces | None) -> Iterator[Rows]:
        """Take other surfaces for the whole flight; yield its rows so far with their demands."""
        before = self._lift
        self._use(surfaces)
        for rows, pulses in self.past:
            # What the rows counted under the former surfaces is taken back first.
            self._count(rows.up, rows.aloft, before.works(pulses), -1)
            flying = self._count(rows.up, rows.aloft, self._lift.works(pulses))
            yield replace(rows, flying=flying, outputs=self._demand(pulses, flying))

    def last(self, seconds: int, until_s: float = np.inf) -> tuple[Rows, Array] | None:
        """Return the last rows before a flight second without demands, and their pulses; None without any."""
        known = self.past.last(seconds, until_s)
        if known is None:
            return None
        rows, pulses = known
        return replace(rows, flying=rows.aloft & ~self._lift.works(pulses)), pulses

    def feed(self, seconds: Seconds) -> Iterator[Rows]:
        """Yield the rows of these seconds, as runs without a gap."""
        breaks = np.flatnonzero(np.diff(seconds.index) != 1) + 1
        edges = [0, *breaks.tolist(), len(seconds.index)]
        for a, b in itertools.pairwise(edges):
            first = int(seconds.index[a])
            fresh = first != self._next
            self._next = first + b - a
            yield self._rows(first, fresh, seconds.part(a, b))

    def _rows(self, first: int, fresh: bool, seconds: Seconds) -> Rows:
        signals, flat = seconds.signals, seconds.rows
        self.heard |= {name for name in flat.keys() - self.heard if np.isfinite(flat[name]).any()}
        # A vehicle whose surfaces are all on the second message has outputs as well.
        if self.heard & {"outputs_2", "outputs_3"}:
            self.heard.add("outputs")
        rates = flat["rates"]
        speed, trusted, settled, source = self._speed.feed(signals)
        driven = np.isin(flat["state"][:, 0], list(GROUND)) | (self.steers & np.isnan(flat["state"][:, 0]))
        if driven.any():
            speed = np.where(driven, self._forward(signals), speed)
            trusted, settled = trusted | driven, settled | driven
            source = np.where(driven, np.where(flat["state"][:, 0] == _BOAT, THROUGH_WATER, 2.0), source)
        pulses = all_outputs(flat)
        up = self._up(flat, speed, driven)
        aloft = self._lasting(up, fresh)
        whole = aloft.reshape(-1, RATE_HZ).all(axis=1)
        for name, used in (*seconds.ranks.items(), ("speed", source[::RATE_HZ].astype(np.int64))):
            self._used[name].update(used[whole].tolist())
        flying = self._count(up, aloft, self._lift.works(pulses))
        self.doubted_s += _whole_seconds(flying & ~trusted)
        self.settled_s += _whole_seconds(flying & settled)
        autopilot, mode = flat["state"][:, 1], flat["state"][:, 3]
        # An autopilot that does not control the attitude still sends the last command: no surface follows it.
        unled = (autopilot == ARDUPILOT) & np.isin(mode, _UNLED_MODES)
        demand = np.where(unled[:, None], np.nan, flat["demand"])
        rows = Rows(
            second=first,
            fresh=fresh,
            roll_rate=rates[:, 0],
            pitch_rate=rates[:, 1],
            yaw_rate=rates[:, 2],
            side_force=flat["force"][:, 1],
            load=flat["force"][:, 2] / STANDARD_GRAVITY,
            roll=flat["attitude"][:, 0],
            pitch=flat["attitude"][:, 1],
            roll_demand=demand[:, 0],
            pitch_demand=demand[:, 1],
            demand_spacing=flat["demand_spacing"][:, 0],
            force_spacing=flat["force_spacing"][:, 0],
            speed=speed,
            flying=flying,
            up=up,
            aloft=aloft,
            trusted=trusted,
            settled=settled,
            sources=source + SPEEDS * np.repeat(seconds.ranks["rates"], RATE_HZ),
            force_source=np.repeat(seconds.ranks["force"], RATE_HZ).astype(np.float64),
            spacing=self._spaced(flat, aloft),
            outputs=self._demand(pulses, flying),
        )
        self.past.add(rows, pulses)
        return rows

    def _forward(self, signals: Mapping[str, Array]) -> Array:
        """Return the speed forward, m/s, (n,), below zero in reverse; over ground where the way is not known.

        That of a boat is through the water.
        """
        velocity, heading = signals["velocity"][:, :, :2], signals["attitude"][:, :, 2]
        currents = np.zeros((len(velocity), 1, 2))
        for k in np.flatnonzero(signals["state"][:, 0, 0] == _BOAT):
            self._current.step(velocity[k, 0], float(heading[k, 0]), float(signals["rates"][k, 0, 2]))
            currents[k] = self._current.velocity
        north, east = np.moveaxis(velocity - currents, 2, 0)
        forward = north * np.cos(heading) + east * np.sin(heading)
        return np.where(np.isfinite(forward), forward, signals["groundspeed"][:, :, 0]).ravel()

    def _demand(self, pulses: Array, flying: Flags) -> Array:
        if self._demands is None:
            return np.full((len(pulses), len(AXES)), np.nan)
        demand = self._demands.feed(pulses)
        self.parted_s += int((self._demands.parted & flying).sum()) / RATE_HZ
        return demand

    def _count(self, up: Flags, aloft: Flags, lifts: Flags, times: int = 1) -> Flags:
        """Return where the vehicle flies forward; add its seconds, and those in which motors carry it."""
        flying = aloft & ~lifts
        self.flown_s += times * _whole_seconds(flying)
        self._rows_of["lift"] += times * int((up & lifts).sum())
        return flying

    def _up(self, flat: dict[str, Array], speed: Array, driven: Flags) -> Flags:
        """Return where everything but the lift motors indicates forward flight."""
        kind, autopilot, armed, mode = flat["state"].T
        self.kinds |= {int(k) for k in np.unique(kind[np.isfinite(kind)])}
        self.autopilots |= {int(k) for k in np.unique(autopilot[np.isfinite(autopilot)])}
        forward = flat["vtol"][:, 0] == _VTOL_FORWARD
        # A quadplane reports a fixed wing: the VTOL state then decides, where it is reported.
        wing = driven | forward & np.isin(kind, (FIXED_WING, *_VTOL))
        wing |= (kind == FIXED_WING) & ~(flat["vtol"][:, 0] > 0)
        hovering = ~driven & (autopilot == ARDUPILOT) & np.isin(mode, HOVERING_MODES)
        landed = ~driven & (flat["landed"][:, 0] == ON_GROUND)
        slow = ~driven & (flat["groundspeed"][:, 0] <= _LEAST_GROUND_SPEED_M_S)
        fast = (armed > 0) & (speed > LEAST_SPEED)
        # ArduPilot's rovers do not record on board whether they are armed.
        fast |= driven & ~(armed == 0) & (speed > LEAST_DRIVEN)
        self._rows_of.update(recorded=len(speed), armed=int((armed > 0).sum()), fast=int(fast.sum()))
        self.fastest = max(self.fastest, float(np.max(speed, initial=0.0, where=(armed > 0) & (speed > 0))))
        up: Flags = fast
        for why, stopped in zip(_STOPPED_BY, (~wing, hovering, landed, slow), strict=True):
            self._rows_of[why] += int((up & stopped).sum())
            up = up & ~stopped
        return up

    def _lasting(self, up: Flags, fresh: bool) -> Flags:
        """Return where the vehicle has flown for seconds without a break."""
        run = lengths(up, 0 if fresh else self._run)
        self._run = int(run[-1])
        return run >= _AIRBORNE_S * RATE_HZ

    def _spaced(self, flat: dict[str, Array], aloft: Flags) -> Array:
        """Return the longer spacing, of the outputs or of the rates, (n,); count all in flight."""
        rates = flat["rates_spacing"][:, 0]
        first, second = flat["outputs_spacing"][:, 0], flat["outputs_2_spacing"][:, 0]
        outputs = np.where(np.isfinite(first), first, second)
        force = flat["force_spacing"][:, 0]
        for name, spacing in (("outputs", outputs), ("rates", rates), ("force", force)):
            known = spacing[aloft & np.isfinite(spacing)]
            steps = np.clip(known / _SPACING_S, 0, _SPACINGS - 1).astype(np.int64)
            self._spacings[name] += np.bincount(steps, minlength=_SPACINGS)
        longer: Array = np.fmax(rates, outputs)
        return longer


def _whole_seconds(rows: Flags) -> int:
    """Return the number of seconds whose rows are all true."""
    return int(rows.reshape(-1, RATE_HZ).all(axis=1).sum())
