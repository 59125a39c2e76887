"""The response of an axis: its sums over a flight, and how much of it is left beside earlier flights.

A flight whose manoeuvres give no reference of its own may still show its control effectiveness: the weights
of all that moves the axis beside its surfaces come from the earlier healthy flights, and so does the gain.
All flights are summed with the same delay and lag, so that they can be compared, and in parts, so that a loss
has an onset.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.regressions import FORMS, Basis, Chain, HighPass, Shape
from mavhums.health.axis.thresholds import (
    DELAYS_S,
    DRIVEN_SHARE,
    JUDGED_ERROR,
    LAGS_S,
    LEAST_ROWS_PER_S,
    LEAST_SPEED_SHARE,
    PAST_RATE_RATIO,
    POOLED_S,
    REFERENCE_S,
    SLOW_PART_S,
    WINDOW_DEVIATION,
)
from mavhums.health.decision.baseline import Baseline, ComparedIndicator
from mavhums.health.decision.thresholds import LASTING_FLIGHTS
from mavhums.health.estimation.least_squares import packed, unpacked
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS, WINDOW_S
from mavhums.results.verdict import Indicator, OwnRecord
from mavhums.vehicle.flight import SPEEDS
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows

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
        # The middle of those that are tried for a reference.
        delay_s, tau_s = (tried[axis][(len(tried[axis]) - 1) // 2] for tried in (DELAYS_S, LAGS_S))
        # Relative to 1 m/s, whatever measured it: each part has its own speed, from one source.
        shape = Shape(round(delay_s * RATE_HZ), tau_s)
        self._chain = Chain(form, Basis(1.0, 0.0), shape, least_share=0.0)
        self._filters = [HighPass(SLOW_PART_S[axis]) for _ in range(form.nuisances + 2)]
        self._parts: dict[int, list[_Part]] = {}
        self._lengths: dict[int, int] = {}
        self._open: tuple[int, _Part] | None = None

    def feed(self, rows: Rows) -> None:
        """Take whole seconds of a flight."""
        found = self._chain.feed(replace(rows, sources=np.zeros(len(rows))))
        columns = np.column_stack([found.drive, found.others, found.answer])
        usable = np.where(found.good[:, None], columns, np.nan)
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
        if self._open[1].seconds >= self._lengths.get(source, WINDOW_S):
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
            self._lengths[source] = 2 * self._lengths.get(source, WINDOW_S)

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


class Stretch(NamedTuple):
    """About a minute of driven flight, compared with the earlier flights.

    Attributes
    ----------
    start_s, end_s
        In flight time.
    seconds
        Judged seconds in it.
    compared
        The gain relative to that of the earlier flights, beside their baseline.
    is_driven
        Whether the demand dominates gusts, so that a lower gain is a loss.
    """

    start_s: float
    end_s: float
    seconds: int
    compared: ComparedIndicator
    is_driven: bool


_HEAD: Final = 3  # seconds, end and speed of a part, before its sums of products
_LARGEST: Final = 1e12
_SIZES: Final = sorted({form.nuisances + 2 for form in FORMS.values()})


class _Parts(NamedTuple):
    """The parts of a flight: judged seconds, end and mean speed of each, and its sums of products."""

    seconds: Array
    end_s: Array
    speed: Array
    grams: Array

    @classmethod
    def of(cls, record: OwnRecord) -> _Parts | None:
        """Return the parts of a record; None if no flight of this axis can have left them."""
        lengths = {len(row) for row in record.groups}
        size = next((n for n in _SIZES if lengths == {_HEAD + n * (n + 1) // 2}), None)
        if size is None:
            return None
        rows = np.array(record.groups, dtype=np.float64)
        # A file can hold any number: sums of larger ones overflow.
        if rows[:, 0].min() <= 0.0 or np.abs(rows).max() > _LARGEST:
            return None
        grams = np.array([unpacked(row[_HEAD:], size) for row in record.groups])
        return cls(rows[:, 0], rows[:, 1], rows[:, 2], grams)

    def take(self, at: NDArray[np.intp]) -> _Parts:
        return _Parts(*(column[at] for column in self))


class _Scores(NamedTuple):
    """Sums of squares of the drive, and of its products with what the others leave of the response."""

    drive2: Array
    cross: Array

    @classmethod
    def of(cls, parts: _Parts, others: Array) -> _Scores:
        grams = parts.grams[parts.grams[:, 0, 0] > 0.0]  # a part without a demand shows no gain
        return cls(grams[:, 0, 0], grams[:, 0, -1] - grams[:, 0, 1:-1] @ others)

    def gain(self) -> float:
        return float(self.cross.sum() / self.drive2.sum())

    def squares(self) -> float:
        """Return the sum of squares about the flight's own gain, each part weighted by its certainty."""
        return float(((self.cross - self.gain() * self.drive2) ** 2 / self.drive2).sum())


def stretches(own: Sequence[OwnRecord], past: Sequence[Sequence[OwnRecord]]) -> Iterator[Stretch]:
    """Yield the stretches of a flight that show the effectiveness, in the order of time.

    Parameters
    ----------
    own
        Records of the axis in this flight.
    past
        The same of earlier healthy flights, in the order of time.
    """
    record = _record_of(own)
    parts = _Parts.of(record) if record else None
    if record is None or parts is None:
        return
    alike = (each for records in past if (each := _record_of(records)) and _alike(record, each))
    references = islice(alike, REFERENCE_FLIGHTS)
    flown = [known for each in references if (known := _Parts.of(each)) and _usable(known, parts)]
    if len(flown) < LASTING_FLIGHTS:
        return
    gram = sum(one.grams.sum(axis=0) for one in flown)
    weights = np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1], rcond=None)[0]
    usual, others = float(weights[0]), weights[1:]
    if usual == 0.0:
        return
    scores = [_Scores.of(one, others) for one in flown]
    # Each flight has a gain of its own, which takes one degree of freedom.
    variance = sum(one.squares() for one in scores) / sum(len(one.drive2) - 1 for one in scores)
    baseline = Baseline.of([_indicator(one, usual, variance) for one in scores])
    if baseline is None or baseline.mean <= 0.0:
        return
    total_s = sum(float(one.seconds.sum()) for one in flown)
    speed = sum(float(one.speed @ one.seconds) for one in flown) / total_s
    power = float(gram[0, 0]) / total_s
    # Near the stall ailerons lose most of their effect without a fault.
    driven = parts.take(
        np.flatnonzero((parts.speed >= LEAST_SPEED_SHARE * speed) & (parts.grams[:, 0, 0] > 0))
    )
    for first, last in _minutes(driven.seconds):
        minute = driven.take(np.arange(first, last))
        shown = _indicator(_Scores.of(minute, others), usual, variance)
        if shown.value.high - shown.value.low > 2 * NORMAL_95 * JUDGED_ERROR:
            continue
        seconds = int(minute.seconds.sum())
        yield Stretch(
            float(driven.end_s[first - 1]) if first else float(minute.end_s[0] - minute.seconds[0]),
            float(minute.end_s[-1]),
            seconds,
            ComparedIndicator.of(shown, baseline),
            # Gusts move the aircraft and, through the autopilot, the surfaces against it: where little else
            # drives these, the gain is underestimated.
            seconds >= REFERENCE_S and float(minute.grams[:, 0, 0].sum()) >= DRIVEN_SHARE * power * seconds,
        )


def _record_of(records: Sequence[OwnRecord]) -> OwnRecord | None:
    return next((record for record in records if record.equation == RESPONSE), None)


def _alike(one: OwnRecord, other: OwnRecord) -> bool:
    """Return whether two flights measured the speed alike, at rates that show about the same gain."""
    faster, slower = max(one.rate_hz, other.rate_hz), min(one.rate_hz, other.rate_hz)
    return one.setup == other.setup and faster <= PAST_RATE_RATIO * slower


def _usable(flown: _Parts, parts: _Parts) -> bool:
    """Return whether an earlier flight has the same columns, and was driven in more than one part."""
    return flown.grams.shape[1:] == parts.grams.shape[1:] and bool((flown.grams[:, 0, 0] > 0).sum() > 1)


def _indicator(scores: _Scores, usual: float, variance: float) -> Indicator:
    """Return the gain relative to the usual one, with its error."""
    count = len(scores.drive2)
    # A few parts that agree by chance are no better than those of the earlier flights.
    own = max(variance, scores.squares() / max(count - 1, 1)) / float(scores.drive2.sum()) / usual**2
    error = float(np.sqrt(own + WINDOW_DEVIATION**2 / count))
    windows = max(count, 2) * WINDOW_S
    mean = (scores.gain() / usual, error)
    return Indicator.of_mean(
        "effectiveness", "control gain", "1", mean, windows=windows, needed=LASTING_FLIGHTS
    )


def _minutes(seconds: Array) -> Iterator[tuple[int, int]]:
    """Yield the places of the first and after the last part of each minute; the last one may be shorter."""
    first, total = 0, 0.0
    for k, each in enumerate(seconds.tolist(), start=1):
        total += each
        if total >= POOLED_S or k == len(seconds):
            yield first, k
            first, total = k, 0.0
