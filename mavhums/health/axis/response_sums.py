"""Sums of an axis's response over a flight, for the comparison with other flights of the aircraft.

A flight whose manoeuvres give no reference of its own may still show its control effectiveness, once other
flights tell what else moves the axis. All flights are summed with the same delay and lag, so that they can be
compared, and in parts, so that a loss has an onset.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.axis.filters import HighPass
from mavhums.health.axis.reference import STANDARDS
from mavhums.health.axis.regressions import FORMS, Basis, Chain, Shape
from mavhums.health.axis.thresholds import LEAST_ROWS_PER_S, PART_S, RESPONSE_SHAPES
from mavhums.health.estimation.least_squares import packed
from mavhums.results.verdict import OwnRecord
from mavhums.vehicle.flight import SPEEDS, Rows
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["RESPONSE", "Response", "ResponseSums"]

RESPONSE: Final = "response"
"""Name of the equation in a record."""

_MOST_PARTS: Final = 32  # at least 16 once the flight is long: bounds the size of a record


class Response(NamedTuple):
    """What a flight shows of an axis's response.

    Attributes
    ----------
    source
        What measured the speed: sensor (0), wind triangle (1), ground (2).
    groups
        Of each part its judged seconds, the flight second of its end, its mean speed, m/s, and the upper
        triangle of the sums of products of the regression's columns, all without their slow parts: the drive,
        the others, the response.
    """

    source: int
    groups: tuple[tuple[float, ...], ...]

    def in_parts(self, count: int) -> Response:
        """Return the same with no more than so many parts."""
        joined = []
        for rows in np.array_split(np.array(self.groups), min(count, len(self.groups))):
            seconds = float(rows[:, 0].sum())
            speed = round(float(rows[:, 0] @ rows[:, 2]) / seconds, 2)
            sums = (float(f"{number:.9g}") for number in rows[:, 3:].sum(axis=0).tolist())
            joined.append((seconds, float(rows[-1, 1]), speed, *sums))
        return Response(self.source, tuple(joined))

    def record(self, setup: str, rate_hz: float) -> OwnRecord:
        """Return the record of the flight; ``setup`` names the source; outputs have this rate."""
        return OwnRecord(
            equation=RESPONSE,
            setup=setup,
            rate_hz=float(f"{rate_hz:.3g}"),
            duration_s=sum(row[0] for row in self.groups),
            groups=self.groups,
        )


class _Part(NamedTuple):
    """Some judged seconds: their number, the last one, the sum of their speeds, and the sums of products."""

    seconds: int
    end_s: int
    speeds: float
    gram: Array


class ResponseSums:
    """Collects the sums of one axis over a flight, in memory that does not grow with it.

    Parameters
    ----------
    axis
        A key of :data:`~mavhums.health.axis.regressions.FORMS`.
    """

    def __init__(self, axis: str) -> None:
        form = FORMS[axis]
        delay_s, tau_s = RESPONSE_SHAPES[axis]
        # Relative to 1 m/s, whatever measured it: each part has its own speed, from one source.
        self._chain = Chain(form, Basis(1.0, 0.0), Shape(round(delay_s * RATE_HZ), tau_s))
        self._filters = [HighPass(STANDARDS[axis].memory_s) for _ in range(form.nuisances + 2)]
        self._parts: dict[int, list[_Part]] = {}
        self._lengths: dict[int, int] = {}
        self._open: tuple[int, _Part] | None = None

    def feed(self, rows: Rows) -> None:
        """Take whole seconds of a flight."""
        found = self._chain.feed(replace(rows, sources=np.zeros(len(rows))))
        columns = np.column_stack([found.drive, found.others, found.answer])
        usable = np.where(found.good[:, None], columns, 0.0)
        quick = np.stack(
            [one.feed(column) for one, column in zip(self._filters, usable.T, strict=True)], axis=1
        )
        quick[~found.good] = 0.0
        each = quick.reshape(rows.seconds, RATE_HZ, -1)
        grams = np.einsum("kri,krj->kij", each, each)
        good = found.good.reshape(-1, RATE_HZ).sum(axis=1)
        sources = rows.sources.reshape(-1, RATE_HZ) % SPEEDS
        alike = (sources == sources[:, :1]).all(axis=1)
        speeds = rows.speed.reshape(-1, RATE_HZ)[:, 0]
        for k in np.flatnonzero((good >= LEAST_ROWS_PER_S) & alike & np.isfinite(speeds)).tolist():
            second = _Part(1, rows.second + k + 1, float(speeds[k]), grams[k])
            self._take(int(sources[k, 0]), second)

    def _take(self, source: int, second: _Part) -> None:
        if self._open is not None and self._open[0] != source:
            self._close()
        self._open = source, second if self._open is None else _joined(self._open[1], second)
        if self._open[1].seconds >= self._lengths.get(source, PART_S):
            self._close()

    def _close(self) -> None:
        assert self._open is not None
        source, part = self._open
        self._open = None
        parts = self._parts.setdefault(source, [])
        parts.append(part)
        if len(parts) == _MOST_PARTS:
            # Full: neighbours are joined, so that memory stays the same for any length of flight.
            parts[:] = [_joined(one, other) for one, other in zip(parts[::2], parts[1::2], strict=True)]
            self._lengths[source] = 2 * self._lengths.get(source, PART_S)

    def response(self) -> Response | None:
        """Return the sums so far, of the usual source of the speed; None without a whole part."""
        lengths = {source: sum(part.seconds for part in parts) for source, parts in self._parts.items()}
        if not lengths:
            return None
        usual = max(lengths, key=lengths.__getitem__)
        return Response(
            usual,
            tuple(
                (float(seconds), float(end_s), round(speeds / seconds, 2), *packed(gram))
                for seconds, end_s, speeds, gram in self._parts[usual]
            ),
        )


def _joined(one: _Part, other: _Part) -> _Part:
    return _Part(one.seconds + other.seconds, other.end_s, one.speeds + other.speeds, one.gram + other.gram)
