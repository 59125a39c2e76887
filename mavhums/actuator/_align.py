"""Compiled loops of :mod:`mavhums.actuator.align`: convert rows of several sources to final samples.

Three arrays (times, frames and values) hold the rows of all sources: those of source k from
``bounds[k]`` to ``bounds[k + 1]``, increasing in time and in frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Array2, Flags, Flags2, Integers, Integers1, Integers2
from mavhums.core.kernels import kernel, subroutine
from mavhums.core.quantities import column

NEVER = 2**62
_BETWEEN = (column("V1"), column("V11"))  # the command and the load, which need no sensor at the shaft
_ANGLES = (column("V2"), column("V3"))

Rows = tuple[Integers1, Integers1, Array2]


@subroutine
def _first(values: Integers, start: int, end: int, least: int) -> int:
    """Return the first index from ``start`` on whose value is at least ``least``, else ``end``."""
    return start + int(np.searchsorted(values[start:end], least))


@kernel
def _near(values: Integers1, start: int, end: int, least: int, guess: int) -> int:
    """Return what :func:`_first` returns, at once if it is the guess or the index after the guess."""
    for index in range(max(guess, start), min(guess + 2, end)):
        if values[index] >= least and (index == start or values[index - 1] < least):
            return index
    return _first(values, start, end, least)


@subroutine
def _merge(
    rows: Rows,
    bounds: Integers,
    new: Rows,
    new_bounds: Integers,
    latest_us: Integers,
    late: Integers,
    needed_us: int,
    oldest_us: int,
    keep_us: int,
) -> tuple[Rows, Integers, Flags]:
    """Join old and new rows; return them, their bounds, and the mask of accepted new rows.

    Old rows are dropped if they are earlier than ``needed_us`` (except the last of each source), or
    ``keep_us`` earlier than both ``oldest_us`` and the source's latest row. New rows are dropped, and
    counted in ``late``, if they are not later than all earlier ones. ``latest_us`` is updated.
    """
    time, frame, values = rows
    new_time, new_frame, new_values = new
    sources = latest_us.size
    start = np.empty(sources, dtype=np.int64)
    taken = np.zeros(new_time.size, dtype=np.bool_)
    total = 0
    for k in range(sources):
        needed = max(needed_us, min(oldest_us, latest_us[k]) - keep_us)
        start[k] = max(_first(time, bounds[k], bounds[k + 1], needed) - 1, bounds[k])
        total += bounds[k + 1] - start[k]
        for row in range(new_bounds[k], new_bounds[k + 1]):
            if new_time[row] > latest_us[k]:
                latest_us[k] = new_time[row]
                taken[row] = True
                total += 1
            else:
                late[k] += 1
    out_time, out_frame = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
    out_values = np.empty((total, values.shape[1]))
    out_bounds = np.zeros(sources + 1, dtype=np.int64)
    end = 0
    for k in range(sources):
        for row in range(start[k], bounds[k + 1]):
            out_time[end], out_frame[end], out_values[end] = time[row], frame[row], values[row]
            end += 1
        for row in range(new_bounds[k], new_bounds[k + 1]):
            if taken[row]:
                out_time[end], out_frame[end] = new_time[row], new_frame[row]
                out_values[end] = new_values[row]
                end += 1
        out_bounds[k + 1] = end
    return (out_time, out_frame, out_values), out_bounds, taken


@subroutine
def _enlist(
    due: Integers,
    clock: int,
    new: Rows,
    new_bounds: Integers,
    taken: Flags,
    start: int,
    end: int,
    latest_due_us: int,
) -> Integers:
    """Append the clock's new rows with ``start`` ≤ frame < ``end`` to the pending samples, (n, 3)."""
    time, frame, _ = new
    chosen = np.zeros(time.size, dtype=np.bool_)
    for row in range(new_bounds[clock], new_bounds[clock + 1]):
        chosen[row] = taken[row] and start <= frame[row] < end and time[row] > latest_due_us
    rows = np.flatnonzero(chosen)
    out = np.empty((len(due) + rows.size, 3), dtype=np.int64)
    out[: len(due)] = due
    for k in range(rows.size):
        out[len(due) + k] = time[rows[k]], frame[rows[k]], clock
    return out


@kernel
def take(
    rows: Rows,
    bounds: Integers1,
    due: Integers2,
    new: Rows,
    new_bounds: Integers1,
    reigns: Integers2,
    latest_us: Integers1,
    late: Integers1,
    latest_due_us: int,
    reach_us: int,
    keep_us: int,
) -> tuple[Rows, Integers, Integers]:
    """Join old and new rows; return them, their bounds, and the pending samples.

    A pending sample, a row of (n, 3), is time, frame and source of a new row of the clock. ``reigns``,
    (n, 2), lists sources, and the frame from which on each is the clock. Old rows that no sample can
    need are dropped: those ``reach_us`` earlier than all pending and future samples, or ``keep_us``
    earlier than these and the source's latest row. ``latest_us`` is updated; ``late`` counts rows
    that are not later than all earlier ones.
    """
    oldest_us = due[0, 0] if len(due) else NEVER
    needed_us = min(oldest_us, latest_due_us) - reach_us
    rows, bounds, taken = _merge(
        rows, bounds, new, new_bounds, latest_us, late, needed_us, oldest_us, keep_us
    )
    for k in range(len(reigns)):
        end = reigns[k + 1, 1] if k + 1 < len(reigns) else NEVER
        if len(due):
            latest_due_us = max(latest_due_us, due[-1, 0])
        due = _enlist(due, reigns[k, 0], new, new_bounds, taken, reigns[k, 1], end, latest_due_us)
    return rows, bounds, due


@kernel
def limits(
    due: Integers2,
    rows: Rows,
    bounds: Integers1,
    first_frame: Integers1,
    rank: Integers1,
    gives: Flags2,
    horizon_us: int,
    known_from_us: int,
    final: bool,
) -> Integers:
    """Return, for each sample that is final, the first frame that it no longer uses.

    Pending samples, (n, 3), become final in order, all of them if ``final``. The frame is 0 for a
    sample that arrived more than ``horizon_us`` behind a source; it then uses no values at all.
    """
    time, frame, values = rows
    count = len(due)
    out = np.empty(count, dtype=np.int64)
    ahead, own, beside, heard = bounds[:-1].copy(), 0, bounds[:-1].copy(), bounds[:-1].copy()
    opened = NEVER
    for k in range(rank.size):
        row = _first(time, bounds[k], bounds[k + 1], known_from_us)
        opened = min(opened, frame[row] if row < bounds[k + 1] else NEVER)
    for i in range(count):
        at_us, own_frame, clock = due[i]
        limit = NEVER
        for k in range(rank.size):
            row = ahead[k] = _near(time, bounds[k], bounds[k + 1], at_us + horizon_us, ahead[k])
            limit = min(limit, frame[row] if row < bounds[k + 1] else NEVER)
        if limit < own_frame:
            limit = 0
        # Which sources there are is known once they have had the time to be heard.
        asked = own_frame if at_us >= known_from_us else max(own_frame, opened)
        complete = asked
        own = _near(time, bounds[clock], bounds[clock + 1], at_us, own)
        for k in range(rank.size):
            if asked == NEVER or k == clock or asked <= first_frame[k]:
                continue
            adds = rank[k] < rank[clock]
            for j in range(values.shape[1]):
                adds = adds or (gives[k, j] and np.isnan(values[own, j]))
            last = heard[k] = _near(frame, bounds[k], bounds[k + 1], asked + 1, heard[k])
            silent = last > bounds[k] and time[last - 1] < at_us - horizon_us
            if adds and not silent:  # nothing waits for a source that has died
                row = beside[k] = _near(time, bounds[k], bounds[k + 1], at_us, beside[k])
                complete = max(complete, frame[row] if row < bounds[k + 1] else NEVER)
        limit = min(limit, complete + 1)
        if limit >= NEVER and not final:
            return out[:i]
        out[i] = min(limit, NEVER)
    return out


@kernel
def combine(
    at_us: Integers1,
    limit: Integers1,
    order: Integers1,
    rows: Rows,
    bounds: Integers1,
    keep_us: int,
    spans_us: tuple[int, int],
) -> tuple[Array, NDArray[np.int8]]:
    """Return each quantity at each time, from the first source in ``order`` that has it.

    ``spans_us`` are the longest step between neighbours that are interpolated and, of what a servo reports,
    the longest of a source that is sampled: over more a reading is held, so that it shows that it repeats,
    and an angle is not known.
    Only messages before frames ``limit`` (n,) are used. Values and sources (−1 for none) are (n, 12) each.
    """
    time, frame, values = rows
    columns = values.shape[1]
    out = np.full((at_us.size, columns), np.nan)
    origin = np.full((at_us.size, columns), -1, dtype=np.int8)
    rights, knowns = bounds[:-1].copy(), bounds[:-1].copy()
    for i in range(at_us.size):
        missing = columns
        for k in order:
            if missing == 0:
                break
            right = rights[k] = _near(time, bounds[k], bounds[k + 1], at_us[i], rights[k])
            known = knowns[k] = _near(frame, bounds[k], bounds[k + 1], limit[i], knowns[k])
            if right >= known or time[known - 1] - at_us[i] > keep_us:
                continue
            left, part = right, 0.0
            if time[right] != at_us[i]:
                left = right - 1
                if left < bounds[k] or time[right] - time[left] > spans_us[0]:
                    continue
                part = (at_us[i] - time[left]) / (time[right] - time[left])
            sampled = time[right] - time[left] <= spans_us[1]
            for j in range(columns):
                found = values[right, j]
                if not sampled and j not in _BETWEEN:
                    found = np.nan if j in _ANGLES else values[left, j]
                elif left != right:
                    found = values[left, j] * (1.0 - part) + found * part
                if np.isnan(out[i, j]) and np.isfinite(found):
                    out[i, j], origin[i, j] = found, k
                    missing -= 1
    return out, origin
