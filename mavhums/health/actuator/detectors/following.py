"""A shaft that does not do what is commanded: it lags too far behind, or does not move at all.

**Following** finds a shaft that moves, but not as commanded: a weak supply, motor or winding, or a gear near
to jamming. It needs the command, the output shaft's angle, and from the data sheet the slew rate
and the stroke; none of the motor's constants. An angle that no sensor measured may be off by a constant, and
shows what changes within a second.

A model follows the command as a healthy actuator would: with the lag of its controller, no faster than its
slew rate and no farther than its stroke. What the shaft lags behind the model, no healthy actuator lags:
friction, load and play move it by less than the limit.

A shaft at rest is left to the detector of jams. A second in which little is asked shows no fault and
ends none.

**Jam** finds a surface that is commanded and does not move: jammed, disconnected or without power. It needs
the command and the output shaft's angle, and none of the actuator's constants. An angle integrated from a
speed whose sign is derived from the command is no evidence. An angle calculated from the rotor's moves with
the rotor, which moves through the gear's play and winds up the gear even if the shaft is jammed.

The current shows a jam, too, however short it is and however little is commanded: a shaft at rest although
the motor pushes with most of its torque at stall, for half a second. The current's sign does not matter.

A shaft that its **load** stops is not jammed: an actuator too weak or too soft is already degrees
behind while it still moves, and then takes much of the current that it takes at rest. Until the command lies
on the other side of the shaft, nothing shows whether it is jammed as well. A load that is measured, and takes
little of the motor's torque, stops nothing.
"""

from __future__ import annotations

from math import exp
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Array1, Flags, Integers
from mavhums.core.kernels import kernel
from mavhums.core.quantities import column
from mavhums.core.statistics import RAD_S_PER_REV_MIN
from mavhums.health.actuator.detector import Detector, DetectorInput
from mavhums.health.actuator.thresholds import (
    FOLLOWING_ASKED_LIMITS,
    FOLLOWING_REST_SHARE,
    JAM_COMMAND_DEG,
    JAM_PARTS_PER_SLOT,
    JAM_SHARE,
    LABOURED_SHARE,
    STALLED_SECONDS,
    WOUND_UP_DEG,
)
from mavhums.health.decision.limits import Estimates, Levels
from mavhums.health.decision.thresholds import AGREEING
from mavhums.health.estimation.motion import longest_gap_s
from mavhums.health.estimation.slots import MAGNITUDES, SENSED, SHAFT, Slots, Windows
from mavhums.health.estimation.thresholds import GUARD_S, WINDOW_S

_V1, _V4, _V5, _V7, _V11 = (column(f"V{k}") for k in (1, 4, 5, 7, 11))
# Parts that a jam is sought over: three seconds hold 11 whole ones, whenever it begins; and a window. The
# shorter finds jams that are soon over.
_JAM_PARTS = (AGREEING * JAM_PARTS_PER_SLOT - 1, WINDOW_S * JAM_PARTS_PER_SLOT)


class FollowingDetector(Detector):
    """Error of following: the shaft's angle minus that of the model, root mean square over a second.

    Of a window's ten seconds, the third largest counts.
    """

    fault: ClassVar[str] = "following"
    quantity: ClassVar[str] = "error of following the command"
    unit: ClassVar[str] = "°"
    inspect: ClassVar[str] = (
        "supply, motor, winding and gear, which move the surface too slowly or too little"
    )

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        limits = actuator.limits
        self.levels = Levels(limits.following_deg, limits.following_emergency_deg) if limits else Levels()
        self._limit = self.levels.normal or np.inf
        low, high = sorted(actuator.travel_deg or (-np.inf, np.inf))
        lag_s, slew_deg_s = actuator.response_lag_s, actuator.slew_deg_s or np.inf
        self._model = np.array([lag_s, slew_deg_s, low, high, longest_gap_s(actuator)])
        self._state = np.full(3, np.nan)
        self._windows = Windows(1, empty=np.nan)

    @classmethod
    def suits(cls, actuator: Actuator) -> bool:
        """Return whether the profile has the slew rate and limits."""
        return actuator.slew_deg_s is not None and actuator.limits is not None

    def feed(self, seen: DetectorInput) -> Estimates:
        """Return the error; undecidable where fewer than three seconds of ten show a moving shaft."""
        slots = seen.slots
        own = slots.values[slots.judged]
        sensed = np.maximum.reduceat(own[:, SENSED], slots.start) > 0
        # Of two sources in one second only the sensor counts: from one to the other the angle jumps.
        shaft = np.where(np.repeat(sensed, slots.count()) > own[:, SENSED], np.nan, own[:, SHAFT])
        command = np.ascontiguousarray(own[:, _V1])
        error = _errors(slots.time_s[slots.judged], command, shaft, self._model, self._state)
        known = np.isfinite(error)
        steps = np.where(known, error, 0.0)
        count, total, squares = slots.sums(np.stack([known, steps, steps**2], axis=1)).T
        # An integrated angle drifts, and begins where nobody knows: a second shows how its error changes.
        constant = np.where(sensed, 0.0, total**2)
        whole = np.maximum(count * squares - constant, 0.0)
        rms = np.divide(np.sqrt(whole), count, out=np.full(count.size, np.nan), where=count > 0)
        travel, asked = (
            np.fmax.reduceat(angle, slots.start) - np.fmin.reduceat(angle, slots.start)
            for angle in (shaft, shaft - error)
        )
        # A second that asks little neither shows a fault nor ends one.
        shows = (rms > self._limit) | (asked >= FOLLOWING_ASKED_LIMITS * self._limit)
        # A shaft at rest is jammed or idle; either would read as a large error.
        moved = np.where((travel >= FOLLOWING_REST_SHARE * rms) & shows, rms, np.nan)
        windows = self._windows.feed(slots.index, moved[:, None])[:, :, 0]
        # The third largest of ten: one glitch of a sensor, or a step in two seconds, is no fault.
        largest = np.sort(np.where(np.isnan(windows), -np.inf, windows), axis=1)[:, -AGREEING]
        return Estimates.of(largest, np.zeros_like(largest), np.ones_like(largest), np.isfinite(largest))


@kernel
def _errors(time_s: Array1, command: Array1, shaft: Array1, model: Array1, state: Array1) -> Array:
    """Return the shaft's angle minus the model's, NaN where the model starts anew, shape (n,).

    ``model`` holds lag, slew rate, stroke and longest gap, ``state`` time, command and the model's angle
    between blocks.
    """
    lag, slew, low, high, longest_s = model
    error = np.full(time_s.size, np.nan)
    for k in range(time_s.size):
        if np.isnan(command[k]) or np.isnan(shaft[k]):
            continue
        passed = time_s[k] - state[0]
        # After a gap the model starts where the shaft is.
        if passed <= longest_s:  # not of NaN
            # The mean of two commands: a step between the samples came at half time on average.
            asked = min(max((command[k] + state[1]) / 2, low), high)
            step = (asked - state[2]) * (1.0 - exp(-passed / lag))
            state[2] += min(max(step, -slew * passed), slew * passed)
            error[k] = shaft[k] - state[2]
        else:
            state[2] = shaft[k]
        state[0], state[1] = time_s[k], command[k]
    return error


class JamDetector(Detector):
    """Fraction of the commanded travel that the shaft does not follow within three seconds.

    If three seconds contain too little commanded travel, ten seconds are used. The last second of the command
    does not count, because the shaft may not have followed yet. One such window is a jam: no actuator that
    follows leaves out most of 4°, and a jam may be over before several windows agree. A shaft that has
    just stalled leaves out all, whatever it flew before and after.
    """

    fault: ClassVar[str] = "jam"
    quantity: ClassVar[str] = "commanded travel not flown"
    unit: ClassVar[str] = "1"
    inspect: ClassVar[str] = (
        "gearbox and linkage for a blockage, and the actuator's supply, torque and gain, of which too little "
        "also keeps a surface where it is"
    )
    span_s: ClassVar[float | None] = _JAM_PARTS[0] / JAM_PARTS_PER_SLOT

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(JAM_SHARE, JAM_SHARE)
        ema = actuator.ema
        self._stall_a = ema.supply_voltage / ema.resistance if ema and ema.supply_voltage else np.nan
        self._rest_rev_min = actuator.moving_speed_rev_min if ema else np.nan
        self._windows = Windows(9, max(_JAM_PARTS), empty=-np.inf)
        self._laboured_a = 0.0  # current of the latest motion, with its way; zero if it was easy
        self._in_vain = Windows(1, slots=2)  # half a second may lie in two

    def feed(self, seen: DetectorInput) -> Estimates:
        """Return the fraction; undecidable if less than 4° of travel was commanded."""
        own, part = seen.slots.values[seen.slots.judged], self._parts(seen.slots)
        start = np.flatnonzero(np.diff(part, prepend=part[0] - 1))
        missed = own[:, _V1] - own[:, SHAFT]
        gap_s = np.diff(seen.slots.time_s, prepend=np.nan)[seen.slots.judged]
        resumes = gap_s > longest_gap_s(self.actuator)
        shown = [own[:, _V1], -own[:, _V1], own[:, SHAFT], -own[:, SHAFT]]
        shown += [WOUND_UP_DEG * (1.0 - own[:, SENSED]), missed, -missed, np.where(resumes, 1.0, -np.inf)]
        columns = np.stack(shown, axis=1)
        # What was seen before a gap is no longer seen after it, though its slot may be the one after.
        last = np.maximum.reduceat(np.where(resumes, np.arange(part.size), 0), start)
        columns[np.arange(part.size) < np.repeat(last, np.diff(start, append=part.size))] = -np.inf
        overloaded = self._overloaded(own, start)
        extremes = [np.maximum.reduceat(columns, start), overloaded[:, None]]
        windows = self._windows.feed(part[start], np.hstack(extremes))
        left_out = np.full(len(windows), np.nan)
        # The longer span is asked only where the shorter one commands too little.
        for parts in _JAM_PARTS:
            share = self._left_out(windows[:, -parts:])
            left_out = np.where(np.isnan(left_out), share, left_out)
        slot = part[start] // JAM_PARTS_PER_SLOT
        first = np.flatnonzero(np.diff(slot, prepend=slot[0] - 1))
        most = np.fmax.reduceat(left_out, first)
        most[self._stalls(seen.slots) & ~np.logical_or.reduceat(overloaded, first)] = 1.0
        return Estimates.of(most, np.zeros_like(most), np.ones_like(most), np.isfinite(most))

    def _parts(self, slots: Slots) -> Integers:
        """Return the part of a slot to which each judged sample belongs, counted through the flight.

        A sample's slot is the one that confirms it, ``GUARD_S`` or more after it.
        """
        slot = np.repeat(slots.index, slots.count())
        within = slots.time_s[slots.judged] + GUARD_S - slot
        part = np.clip(np.floor(within * JAM_PARTS_PER_SLOT), 0, JAM_PARTS_PER_SLOT - 1).astype(np.int64)
        return np.asarray(slot * JAM_PARTS_PER_SLOT + part)

    def _overloaded(self, own: Array, start: Integers) -> Flags:
        """Return in which parts of the judged samples its load holds the shaft, shape (k,)."""
        ema = self.actuator.ema
        current = np.fmax(np.abs(own[:, _V5]), own[:, MAGNITUDES][:, 1])
        if ema:
            volts = own[:, _V4] - ema.torque_constant * RAD_S_PER_REV_MIN * own[:, _V7]
            current = np.where(np.isnan(current), np.abs(volts) / ema.resistance, current)
        count = np.diff(start, append=len(own))
        current = np.add.reduceat(current, start) / count
        travel = own[start + count - 1, SHAFT] - own[start, SHAFT]
        # An integrated angle does not show how far behind the shaft is.
        missed = np.where(own[:, SENSED] > 0.0, own[:, _V1] - own[:, SHAFT], np.nan)
        behind = np.stack([np.minimum.reduceat(missed, start), np.minimum.reduceat(-missed, start)])
        speed, way = np.abs(travel) * JAM_PARTS_PER_SLOT, np.sign(travel)
        ahead = np.where(way > 0.0, *behind)
        # Where the load drives the shaft back, the motor does not move it.
        moves = (speed >= self.actuator.moving_speed_deg_s) & (ahead > 0.0)
        late = ahead - self.actuator.response_lag_s * speed >= JAM_COMMAND_DEG
        laboured = np.where(late, way * current, 0.0)[moves]
        latest = np.concatenate([[self._laboured_a], laboured])[np.cumsum(moves)]
        self._laboured_a = float(latest[-1])
        pushes = np.where(latest > 0.0, *behind) > 0.0
        held = pushes & (np.abs(latest) > LABOURED_SHARE * current)
        if ema:
            load = np.maximum.reduceat(np.abs(own[:, _V11]), start)
            held &= ~(load < LABOURED_SHARE * ema.gear_ratio * ema.torque_constant * current)
        return np.asarray(held)

    def _stalls(self, slots: Slots) -> Flags:
        """Return in which pairs of slots the shaft rests while the motor pushes, shape (k,)."""
        values, time_s = slots.values, slots.time_s
        _, unsigned_a, unsigned_rev_min = values[:, MAGNITUDES].T
        pushes = np.fmax(np.abs(values[:, _V5]), unsigned_a) >= JAM_SHARE * self._stall_a
        # A speed that is not known counts as motion: it must not show a stall.
        moves = ~(np.fmax(np.abs(values[:, _V7]), unsigned_rev_min) < self._rest_rev_min)
        moved_s = np.concatenate([[-np.inf], time_s[moves], [np.inf]])
        at = np.searchsorted(moved_s, time_s)
        apart_s = np.minimum(moved_s[at] - time_s, time_s - moved_s[at - 1])
        in_vain = (pushes & (apart_s >= GUARD_S))[slots.judged, None].astype(np.float64)
        # By the least rate as well: a slot of few samples is not a whole second.
        share = slots.sums(in_vain)[:, 0] / np.maximum(slots.count(), self.actuator.min_rate_hz)
        stalled: Flags = self._in_vain.feed(slots.index, share[:, None]).sum(axis=(1, 2)) >= STALLED_SECONDS
        return stalled

    def _left_out(self, windows: Array) -> Array:
        """Return the fraction of the commanded travel not followed; NaN if too little was commanded.

        Only what came since the last gap counts: in a gap the shaft may have moved and returned.
        """
        since = np.logical_or.accumulate(windows[:, :0:-1, 7] > 0.0, axis=1)[:, ::-1]
        windows = windows.copy()
        windows[:, :-1][since] = -np.inf
        # Columns 0 and 1 are the highest and minus the lowest command; the last second may not be answered
        # yet.
        commanded = windows[:, :-JAM_PARTS_PER_SLOT, :2].max(axis=1).sum(axis=1)
        # Column 4: an angle divided from the rotor's shows the wind-up of the gear, too.
        wound_up = windows[:, :, 4].max(axis=1)
        # Columns 2 and 3 are the highest and minus the lowest angle.
        angle = windows[:, :, 2:4].max(axis=1).sum(axis=1)
        enough = np.where(commanded >= JAM_COMMAND_DEG + wound_up, commanded, np.nan)
        enough[_only_approached(windows[:, :, 5:7], (1.0 - JAM_SHARE) * commanded)] = np.nan
        enough[(windows[:, :, 8] > 0.0).any(axis=1)] = np.nan
        return np.asarray(1.0 - np.maximum(angle - wound_up, 0.0) / enough)


def _only_approached(missed: Array, least: Array) -> Flags:
    """Return in which windows the command only came back to a shaft that had stayed behind it, shape (k,).

    A soft controller that holds a load stays behind by degrees and lets the shaft rest while the command
    returns: nothing asks it to move. ``missed`` holds the highest and minus the lowest of command less angle,
    shape (k, p, 2); an error that grows by ``least`` asks for motion.
    """
    empty = np.isneginf(missed[:, :, 0])
    first = missed[np.arange(len(missed)), np.argmin(empty, axis=1)]
    whole = missed.max(axis=1)
    grown = whole - first
    # An error that keeps its sign grows at its own end of the two.
    ahead, behind = whole[:, 1] < 0.0, whole[:, 0] < 0.0
    return np.asarray((ahead & (grown[:, 0] < least)) | (behind & (grown[:, 1] < least)))
