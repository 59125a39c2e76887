"""Rows of a flight: the motion and the demand of the aircraft at each time of the grid."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Flags
from mavhums.vehicle.facts import ALL_OUTPUTS
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.surfaces import AXES, COLUMNS

_KEPT_S: Final = 1200  # 4 kB each; most flights of small aircraft are shorter


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Whole seconds of one flight without a gap; each array has ``RATE_HZ`` rows per second.

    Attributes
    ----------
    second
        Number of the first flight second.
    fresh
        Whether the preceding second is unknown.
    roll_rate, pitch_rate, yaw_rate
        Body rates, rad/s.
    side_force, load
        Specific force to the right, m/s², and downwards in g.
    roll, pitch, roll_demand, pitch_demand
        Measured and demanded angles, rad.
    speed
        Airspeed from the sensor or from the wind triangle, m/s; of a rover or a boat the speed forward.
    flying
        Whether the vehicle is a fixed wing in forward flight, or a rover or a boat that drives forward.
    up, aloft
        Whether all but the lift motors says so: at this instant, and for seconds without a break.
    trusted
        Whether the airspeed can be relied on.
    settled
        Whether it is not from a wind triangle that no turn has settled yet.
    sources
        What the rates and the speed were measured with: rows with another number are not comparable.
    force_source
        What the specific force was measured with.
    spacing, demand_spacing, force_spacing
        Spacing of the samples around each row, s: the longer one of the outputs and the rates; that of the
        demanded angles; that of the specific force.
    outputs
        Demand about roll, pitch and yaw from the servo outputs, ±1 at full travel, shape (n, 3).
    """

    second: int
    fresh: bool
    roll_rate: Array
    pitch_rate: Array
    yaw_rate: Array
    side_force: Array
    load: Array
    roll: Array
    pitch: Array
    roll_demand: Array
    pitch_demand: Array
    demand_spacing: Array
    force_spacing: Array
    speed: Array
    flying: Flags
    up: Flags
    aloft: Flags
    trusted: Flags
    settled: Flags
    sources: Array
    force_source: Array
    spacing: Array
    outputs: Array

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def seconds(self) -> int:
        """Number of seconds."""
        return len(self.speed) // RATE_HZ

    def demand(self, axis: str) -> Array:
        """Return the demand of the servo outputs about an axis."""
        return self.outputs[:, COLUMNS[axis]]

    def cut(self, first: int, last: int) -> Rows:
        """Return the seconds from ``first`` to before ``last``, as indices into these seconds."""
        a, b = first * RATE_HZ, last * RATE_HZ
        arrays = (getattr(self, name)[a:b] for name in _ARRAYS)
        return Rows(self.second + first, self.fresh and first == 0, *arrays)

    @classmethod
    def join(cls, parts: list[Rows]) -> Rows:
        """Join consecutive rows."""
        arrays = (np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS)
        return cls(parts[0].second, parts[0].fresh, *arrays)


_ARRAYS: Final = tuple(field.name for field in fields(Rows)[2:])
_FLAGS: Final = frozenset({"up", "aloft", "trusted", "settled"})
_MEASURED: Final = tuple(name for name in _ARRAYS if name not in ("flying", "outputs"))


class _RowBlock(NamedTuple):
    """Rows as one array: the columns of ``_MEASURED``, then the pulses of the outputs that are on."""

    second: int
    fresh: bool
    on: NDArray[np.intp]
    values: Array


class PastRows:
    """The last twenty minutes of a flight, without demands but with the pulses of all outputs.

    Whether lift motors carry the vehicle is known from the pulses: its rows are flying where they are aloft.

    What moves a surface does not change in flight, but what is known of it does: parameters come late, or
    an inference fails. What was judged before is then judged anew, with the same rows.

    Attributes
    ----------
    is_whole
        Whether nothing was dropped.
    """

    def __init__(self) -> None:
        self._parts: deque[_RowBlock] = deque()
        self._seconds = 0
        self.is_whole = True

    def add(self, rows: Rows, pulses: Array) -> None:
        """Add rows and the pulses of all outputs, µs, shape (n, ALL_OUTPUTS)."""
        on = np.flatnonzero(np.isfinite(pulses).any(axis=0))
        measured = [getattr(rows, name) for name in _MEASURED]
        self._parts.append(
            _RowBlock(rows.second, rows.fresh, on, np.column_stack([*measured, pulses[:, on]]))
        )
        self._seconds += rows.seconds
        # Memory must not grow with the flight: the oldest rows go, and what is judged anew begins later.
        while self._seconds > _KEPT_S:
            self._drop(self._seconds - _KEPT_S)

    def _drop(self, seconds: int) -> None:
        """Drop the oldest seconds, at most those of one part."""
        self.is_whole = False
        second, _, on, values = self._parts.popleft()
        left = values[seconds * RATE_HZ :].copy()
        if len(left):
            self._parts.appendleft(_RowBlock(second + seconds, True, on, left))
        self._seconds -= (len(values) - len(left)) // RATE_HZ

    def last(self, seconds: int, until_s: float = np.inf) -> tuple[Rows, Array] | None:
        """Return the last rows before a flight second, as one, and their pulses, shape (n, ALL_OUTPUTS).

        None without any.
        """
        runs = [*_before(self, until_s)]
        if not runs:
            return None
        rows, pulses = Rows.join([run for run, _ in runs]), np.concatenate([sent for _, sent in runs])
        first = max(rows.seconds - seconds, 0)
        return rows.cut(first, rows.seconds), pulses[first * RATE_HZ :]

    def __iter__(self) -> Iterator[tuple[Rows, Array]]:
        """Yield the runs without a gap, each with its pulses, µs, shape (n, ALL_OUTPUTS)."""
        run: list[_RowBlock] = []
        for part in self._parts:
            if part.fresh and run:
                yield _joined(run)
                run = []
            run.append(part)
        if run:
            yield _joined(run)


def _before(runs: Iterable[tuple[Rows, Array]], until_s: float) -> Iterator[tuple[Rows, Array]]:
    for rows, pulses in runs:
        count = int(min(until_s - rows.second, rows.seconds))
        if count > 0:
            yield rows.cut(0, count), pulses[: count * RATE_HZ]


def _joined(parts: list[_RowBlock]) -> tuple[Rows, Array]:
    count = len(_MEASURED)
    measured = np.concatenate([part.values[:, :count] for part in parts])
    pulses = np.full((len(measured), ALL_OUTPUTS), np.nan)
    at = 0
    for part in parts:
        pulses[at : at + len(part.values), part.on] = part.values[:, count:]
        at += len(part.values)
    columns = {
        name: column.astype(bool) if name in _FLAGS else column
        for name, column in zip(_MEASURED, measured.T.copy(), strict=True)
    }
    unknown = np.full((len(measured), len(AXES)), np.nan)
    return Rows(parts[0].second, parts[0].fresh, **columns, flying=columns["aloft"], outputs=unknown), pulses
