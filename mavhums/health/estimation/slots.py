"""Division of an actuator's samples into slots of equal length, independent of block boundaries.

A sample belongs to the slot in which it is confirmed, that is, in which the sample after the first one
that is at least :data:`GUARD_S` later arrives. The speeds of its neighbours are then known, also where they
are differences of angles, and the content of a slot depends only on the samples and their order, not on
the division of the log into blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import KEYS, column
from mavhums.health.estimation.thresholds import GUARD_S, MOST_PLAUSIBLE, WINDOW_S

BUS, SHAFT, ROTOR_SENSED, SENSED, AIRSPEED, TURNED = (len(KEYS) + k for k in range(6))
MAGNITUDES = slice(len(KEYS) + 6, len(KEYS) + 9)
COLUMNS = MAGNITUDES.stop
_V2, _V3, _V7, _V10 = (column(key) for key in ("V2", "V3", "V7", "V10"))


@dataclass(frozen=True, slots=True, eq=False)
class Slots:
    """The samples of several slots, with neighbours on either side.

    Attributes
    ----------
    index
        Slot k covers flight times from ``index[k]`` to ``index[k] + 1`` slot lengths; increasing,
        shape (k,). Slots without confirmed samples are omitted.
    start
        Index of each slot's first judged sample, shape (k,).
    judged
        Mask of the samples that belong to the slots; the others are neighbours.
    time_s, values
        Shapes (n,) and (n, ``COLUMNS``), increasing in time; columns of :func:`with_extra_columns`.
    """

    index: Integers
    start: Integers
    judged: slice
    time_s: Array
    values: Array

    def sums(self, columns: Array) -> Array:
        """Return the sum over each slot of columns (n, m) of judged samples, shape (k, m)."""
        total: Array = np.add.reduceat(columns, self.start, axis=0)
        return total

    def count(self) -> Integers:
        """Return the number of judged samples of each slot, shape (k,)."""
        return np.diff(self.start, append=self.judged.stop - self.judged.start)


def with_extra_columns(
    values: Array,
    measured: Flags | None = None,
    bus_v: Array | None = None,
    airspeed: Array | None = None,
    magnitudes: Array | None = None,
) -> Array:
    """Return V1…V12 with the additional columns of some detectors, shape (n, ``COLUMNS``).

    Column ``BUS`` is the voltage of the supply bus; ``SHAFT`` the output shaft's angle if it does not
    depend on a derived sign; ``ROTOR_SENSED`` and ``SENSED`` are 1 where a sensor measured the rotor's angle
    and the output shaft's; ``AIRSPEED`` is the aircraft's, m/s;
    ``TURNED`` is 1 where the rotor's speed follows from the measured one of the output shaft;
    ``MAGNITUDES`` are those of V4, V5 and V7 from a source that does not measure their signs.
    Values that are not finite or not plausible are NaN.

    Parameters
    ----------
    values
        Shape (n, 12).
    measured
        Mask of the measured values, as opposed to derived ones, shape (n, 12); all if omitted.
    bus_v, airspeed
        Shape (n,); NaN if omitted.
    magnitudes
        Shape (n, 3); NaN if omitted.
    """
    wide = np.full((len(values), COLUMNS), np.nan)
    wide[:, : len(KEYS)] = values
    wide[:, SHAFT] = values[:, _V3]
    wide[:, [ROTOR_SENSED, SENSED]] = 1.0
    wide[:, TURNED] = 0.0
    if bus_v is not None:
        wide[:, BUS] = bus_v
    if airspeed is not None:
        wide[:, AIRSPEED] = airspeed
    if magnitudes is not None:
        wide[:, MAGNITUDES] = magnitudes
    if measured is not None:
        wide[:, [ROTOR_SENSED, SENSED]] = measured[:, [_V2, _V3]]
        wide[:, TURNED] = measured[:, _V10] & ~measured[:, _V7]
        # An angle that is integrated from a speed whose sign follows the command would always follow it.
        wide[~measured[:, [_V2, _V3, _V7]].any(axis=1), SHAFT] = np.nan
    # Not of NaN either: the comparison is False there.
    wide[~(np.abs(wide) < MOST_PLAUSIBLE)] = np.nan
    return wide


class SlotCutter:
    """Collects samples and returns slots of one second that are complete."""

    def __init__(self) -> None:
        # The samples that are not confirmed yet, after as many neighbours of the first of them.
        self._time_s, self._values, self._before = np.empty(0), np.empty((0, COLUMNS)), 0

    def feed(self, time_s: Array, values: Array) -> Slots | None:
        """Return the slots that these samples complete.

        ``time_s`` (n,) increases, also from one call to the next; ``values`` is (n, ``COLUMNS``).
        """
        if time_s.size == 0:
            return None
        self._time_s = np.concatenate([self._time_s, time_s])
        self._values = np.concatenate([self._values, values])
        return self._close(float(np.floor(time_s[-1])))

    def finish(self) -> Slots | None:
        """Return the remaining slots; the last one may be incomplete."""
        return self._close(np.inf)

    def _close(self, horizon: float) -> Slots | None:
        before, done = self._before, int(np.searchsorted(self._time_s, horizon))
        whole_t, whole_v = self._time_s[:done], self._values[:done]
        time_s = whole_t[before:]
        confirmed_by = np.searchsorted(time_s, time_s + GUARD_S) + 1
        ready = int(np.searchsorted(confirmed_by, time_s.size))
        if not ready:
            return None
        slots = np.floor(time_s[confirmed_by[:ready]]).astype(np.int64)
        start = np.flatnonzero(np.diff(slots, prepend=slots[0] - 1))
        # The last sample is never ready. One more on the left: central differences need a neighbour.
        keep = max(int(np.searchsorted(whole_t, time_s[ready] - GUARD_S, side="right")) - 2, 0)
        self._time_s, self._values = self._time_s[keep:], self._values[keep:]
        self._before = before + ready - keep
        return Slots(slots[start], start, slice(before, before + ready), whole_t, whole_v)


class Windows:
    """Buffers the sums of the last slots.

    Parameters
    ----------
    columns
        Number m of sums of a slot.
    slots
        Number of slots in a window, S.
    empty
        Value of the sums of a slot without samples.
    """

    def __init__(self, columns: int, slots: int = WINDOW_S, empty: float = 0.0) -> None:
        self._slots = slots
        self._columns = columns
        self._empty = empty
        self._last: int | None = None
        self._kept = np.full((slots, columns), empty)

    def feed(self, index: Integers, sums: Array) -> Array:
        """Return the windows that end with each of these slots.

        Parameters
        ----------
        index, sums
            Increasing slot numbers, shape (k,), and their sums, shape (k, m); omitted slots are empty.

        Returns
        -------
        NDArray
            Shape (k, S, m), the oldest slot first.
        """
        last = int(index[0]) - 1 if self._last is None else self._last
        steps = index - np.concatenate([[last], index[:-1]])
        ahead = np.minimum(steps, self._slots + 1).cumsum()  # a jump of the clock must not allocate memory
        dense = np.full((self._slots + int(ahead[-1]), self._columns), self._empty)
        dense[: self._slots] = self._kept
        dense[self._slots + ahead - 1] = sums
        self._kept = dense[-self._slots :]
        self._last = int(index[-1])
        rows = ahead[:, None] + np.arange(self._slots)
        windows: Array = dense[rows]
        return windows
