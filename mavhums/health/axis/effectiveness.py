"""Control effectiveness: the aircraft's current response to a demand, relative to the reference.

The gain K of the response to the drive is fitted together with all other contributions to the response in
the first excited seconds of the flight. Each later second gives sums of products of drive and response, both
without their slow parts, so that a change of trim is not a change of gain. The sequential test detects a loss
or a lag by them (:mod:`mavhums.health.axis.evidence`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import replace
from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.evidence import LossTest
from mavhums.health.axis.findings import MixedSums
from mavhums.health.axis.reference import (
    Loss,
    Reference,
    Scores,
    Second,
    Sums,
    constants,
    jackknife,
    least_squares,
    measured,
    shapes,
    without_blocks,
)
from mavhums.health.axis.regressions import FORMS, Basis, Chain, Columns, Shape, Tail, judgeable
from mavhums.health.axis.thresholds import (
    EXTRA_LAGS_S,
    GAIN_ERROR,
    GROUND_SPEED_SHARE,
    JUDGED_ERROR,
    LEAST_DRIVE,
    LEAST_ROWS_PER_S,
    LONGEST_REFERENCE_S,
    REFERENCE_S,
    SCORE_SCATTER,
    SHIFT_S,
    SLOW_PART_S,
    SLOW_STREAM_S,
    SPEED_ERRORS_M_S,
    WIND_M_S,
    WINDOW_DEVIATION,
)
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.flight import LEAST_DRIVEN, SPEEDS
from mavhums.vehicle.grid import RATE_HZ, SHOWN_EVERY
from mavhums.vehicle.rows import Rows


class _Fit(NamedTuple):
    """The regression of one shape: its columns, the rows ``at`` that it takes, and what is ``left``."""

    shape: Shape
    columns: Columns
    at: NDArray[np.intp]
    design: Array
    answer: Array
    beta: Array
    left: float
    explained: float


class _Left(NamedTuple):
    """Sums of a second: response and columns by lag, rows, and the variance of what is between samples."""

    raw: Array
    columns: Array
    rows: int
    unseen: float


class EffectivenessTracker:
    """Tracks the effectiveness of one axis.

    Parameters
    ----------
    axis
        Roll, pitch or yaw, or the steering of a rover or a boat.
    limits
        The loss and the lag from which the axis is degraded; the defaults if None.
    coupled
        Another axis that the same surfaces move; None if they are not mixed.
    false_alarms
        Accepted number of false alarms in 100 hours.
    traced
        Whether :meth:`traces` returns what lies behind the results.
    """

    def __init__(
        self,
        axis: str,
        limits: AxisLimits | None = None,
        coupled: str | None = None,
        false_alarms: float = FALSE_ALARMS,
        *,
        traced: bool = False,
    ) -> None:
        self._form, self._limits, self._coupled = FORMS[axis], limits or AxisLimits(), coupled
        self._memory_s = SLOW_PART_S[axis]
        self._false_alarms = false_alarms
        self._traced: dict[str, list[Array]] | None = {"evidence": [], "response": []} if traced else None
        self._waiting: list[Rows] = []
        self._tried = 0
        self.reference: Reference | None = None
        self.best: Reference | None = None
        self.usable_s = 0
        self.spacing_s = 0.0
        self.excluded_s = 0

    @property
    def highest_evidence(self) -> float | None:
        """Highest logarithm of the evidence of a loss or a lag; None without a judged second."""
        highest = self._test.highest if self.reference is not None else -np.inf
        return float(highest) if np.isfinite(highest) else None

    @property
    def too_slow(self) -> bool:
        """Whether the outputs or the response are sampled too slowly to determine a gain."""
        return self.spacing_s > SLOW_STREAM_S

    def feed(self, rows: Rows) -> list[Second]:
        """Process rows; return the results of their seconds, from the first second with a reference on."""
        first = self._wait(rows) if self.reference is None else 0
        return self._judge(rows.cut(first, rows.seconds)) if first < rows.seconds else []

    def traces(self) -> Iterator[tuple[str, Array]]:
        """Yield what came since the last call by kind: time, what it is compared with, value; (n, 3)."""
        for kind, parts in self._traced.items() if self._traced else ():
            if parts:
                yield kind, np.concatenate(parts)
                parts.clear()

    def _wait(self, rows: Rows) -> int:
        """Wait for a reference; return the number of these seconds that passed without one."""
        if rows.fresh:
            self._waiting.clear()
        flying = rows.flying & np.isfinite(rows.demand(self._form.axis))
        usable = flying.reshape(-1, RATE_HZ).sum(axis=1) >= LEAST_ROWS_PER_S
        kept = 0
        for end, counts in enumerate(usable.tolist(), start=1):
            self.usable_s += counts
            self._tried += 1
            # An attempt in each second costs time.
            if self.usable_s >= REFERENCE_S and self._tried >= WINDOW_S:
                self._tried = 0
                self._keep(rows.cut(kept, end))
                kept = end
                self._refer(Rows.join(self._waiting))
            if self.reference is not None:
                return end
        if kept < rows.seconds:
            self._keep(rows.cut(kept, rows.seconds))
        return rows.seconds

    def _keep(self, rows: Rows) -> None:
        """Add rows to those that wait, and drop what is older than the longest reference."""
        self._waiting.append(rows)
        excess = sum(part.seconds for part in self._waiting) - LONGEST_REFERENCE_S
        while excess > 0:
            oldest = self._waiting.pop(0)
            if oldest.seconds > excess:
                self._waiting.insert(0, oldest.cut(excess, oldest.seconds))
            excess -= oldest.seconds

    def _refer(self, rows: Rows) -> None:
        """Use the buffered rows as the reference if they meet the requirements."""
        basis = Basis.of(rows)
        spacing = self._form.spacing(rows)
        spacing = spacing[rows.flying & np.isfinite(spacing)]
        self.spacing_s = float(np.median(spacing)) if spacing.size else 0.0
        # Slower samples alias the manoeuvres: their gain would be that of the sampling.
        if self.too_slow:
            return
        # A cheap look before a fit of every shape.
        if judgeable(rows, basis, self._form).sum() < REFERENCE_S * LEAST_ROWS_PER_S:
            return
        fits = [fit for shape in shapes(self._form.axis) for fit in self._fit(rows, basis, shape)]
        fit = max(fits, key=lambda fit: fit.explained, default=None)
        found = self._referred(rows, basis, fit) if fit else None
        if fit is None or found is None:
            return
        self.best = found if self.best is None or found.explained > self.best.explained else self.best
        if found.error <= GAIN_ERROR and found.apart <= JUDGED_ERROR:
            self.reference = found
            self._begin(rows)

    def _fit(self, rows: Rows, basis: Basis, shape: Shape) -> Iterator[_Fit]:
        """Yield the fit of a shape to the last usable rows that a reference needs, if it can be one."""
        columns = Chain(self._form, basis, shape).feed(rows)
        at = np.flatnonzero(columns.good)[-REFERENCE_S * RATE_HZ :]
        design = np.column_stack([columns.drive, columns.others])[at]
        if at.size < REFERENCE_S * LEAST_ROWS_PER_S or design[:, 0].std() < LEAST_DRIVE:
            return
        answer = columns.answer[at]
        beta, left = least_squares(design, answer)
        # In calm air a regression can find the autopilot's feedback instead of the aircraft, with a gain of
        # the wrong sign.
        if self._form.possible(beta[1:]):
            _, without = least_squares(design[:, 1:], answer)
            explained = 1.0 - left / without if without > 0 else 0.0
            yield _Fit(shape, columns, at, design, answer, beta, left, explained)

    def _referred(self, rows: Rows, basis: Basis, fit: _Fit) -> Reference | None:
        """Return the reference that a fit is, by the scores of its seconds; None if they show no drive."""
        others = fit.beta[1:]
        sums = Scores(others, self._memory_s).feed(fit.columns)
        inside = np.unique(fit.at // RATE_HZ)
        drive2, cross = sums.drive2[inside], sums.cross[inside]
        total = float(drive2.sum())
        if total <= 0:
            return None
        gain = float(cross.sum()) / total
        variance = float(((cross - gain * drive2) ** 2).sum()) / total
        error = float(np.sqrt(variance / total)) / abs(gain) if gain else inf
        # The reference may lie in quiet air, and the rest of the flight in rough air.
        variance = max(variance, SCORE_SCATTER * gain**2)
        first, last = rows.second + int(inside[0]), rows.second + int(inside[-1]) + 1
        deviation, parts = float(np.sqrt(fit.left)), without_blocks(fit.design, fit.answer)
        return Reference(
            basis,
            fit.shape,
            gain,
            others,
            variance,
            error,
            fit.explained,
            deviation,
            jackknife(parts),
            first,
            last,
            constants(self._form, basis.speed, fit.beta, parts),
            bool(rows.settled[fit.at].mean() > 0.5),
            float(drive2.max()),
        )

    def _begin(self, rows: Rows) -> None:
        reference = self.reference
        assert reference is not None
        extras = (0.0, *EXTRA_LAGS_S)
        self._chains = [Chain(self._form, reference.basis, reference.shape, extra) for extra in extras]
        self._scores = [Scores(reference.others, self._memory_s) for _ in extras]
        self._test = LossTest(reference, self._limits, self._false_alarms, mixed=self._coupled is not None)
        # Over more seconds a loss is measured with what was before its onset.
        self._recent: deque[tuple[int, Array]] = deque(maxlen=2 * WINDOW_S)
        self._left: deque[_Left] = deque(maxlen=SHIFT_S)
        self._signals = Tail(2, 1)
        self._mixed: MixedSums | None = None
        if self._coupled is not None:
            self._mixed = MixedSums(reference, self._form.axis, self._coupled, self._memory_s)
            self._mixed.feed(rows)
        self._sums(rows)
        slow = GROUND_SPEED_SHARE
        self._slow_chain = Chain(self._form, reference.basis, reference.shape, least_share=slow)
        self._slow_scores = Scores(reference.others, self._memory_s)
        excluding = self._excluding(rows, self._unknown(rows))
        self.excluded_s = self._test.excludes_in_reference(excluding.values())
        self._waiting.clear()

    def _sums(self, rows: Rows) -> list[Sums]:
        pairs = zip(self._scores, self._chains, strict=True)
        sums = [scores.feed(chain.feed(rows)) for scores, chain in pairs]
        if self._traced and self.reference:
            driven, raw, good = (row[::SHOWN_EVERY] for row in sums[0].rows)
            time_s = rows.second + np.arange(0, len(rows), SHOWN_EVERY) / RATE_HZ
            shown = np.column_stack([time_s, self.reference.gain * driven, raw])
            self._traced["response"] += [shown[good]] if good.any() else []
        return sums

    def _unknown(self, rows: Rows) -> list[float]:
        """Return the share of the gain that the error of the speed makes, by second."""
        assert self.reference is not None
        speed = np.fmax(rows.speed.reshape(-1, RATE_HZ).mean(axis=1), LEAST_DRIVEN)
        reference, form = self.reference, self._form
        settled = rows.settled.reshape(-1, RATE_HZ).all(axis=1)
        # Before turns have shown the wind, it is in the speed, and after them it is not. So much counts in
        # roll, too, whose gain follows the speed.
        alike = form.speed_errors * SPEED_ERRORS_M_S[int(reference.basis.sources) % SPEEDS]
        error = np.where(settled == reference.settled, alike, max(form.speed_errors, 1.0) * WIND_M_S)
        unknown: list[float] = np.minimum(error / speed, 1.0).tolist()
        return unknown

    def _excluding(self, rows: Rows, unknown: list[float]) -> dict[int, tuple[float, float, float]]:
        """Return, by place, the seconds that may exclude a loss: drive², drive times response, unknown.

        They may be slower than those that show one.
        """
        sums = self._slow_scores.feed(self._slow_chain.feed(rows))
        return {
            k: (float(sums.drive2[k]), float(sums.cross[k]), unknown[k])
            for k in np.flatnonzero(sums.count >= LEAST_ROWS_PER_S).tolist()
        }

    def _judge(self, rows: Rows) -> list[Second]:
        sums = self._sums(rows)
        unknown = self._unknown(rows)
        excluding = self._excluding(rows, unknown)
        stacked = np.array([[s.drive2, s.cross, s.answer2, s.drive] for s in sums])
        assert self.reference is not None
        raw, columns = np.array([s.raw for s in sums]), np.array([s.columns for s in sums])
        unseen = self._unseen(rows)
        mixed = [*self._mixed.feed(rows)] if self._mixed else [None] * rows.seconds
        seconds = []
        for k in range(rows.seconds):
            excluded = self._test.excludes(*excluding[k]) if k in excluding else 0
            count = int(sums[0].count[k])
            end_s = rows.second + k + 1
            self._left.append(_Left(raw[:, k], columns[:, k], count, float(unseen[k])))
            second = self._second(end_s, stacked[:, :, k], count, mixed[k], unknown[k])
            seconds.append(replace(second, excluded=excluded))
        return seconds

    def _unseen(self, rows: Rows) -> Array:
        """Return the variance of each second's sum of what a response leaves, by what is between the samples.

        Between two samples that differ a signal passes as a Brownian bridge does.
        """
        form, reference = self._form, self.reference
        assert reference is not None
        drive = reference.gain * form.drive(rows.demand(form.axis), rows.speed / reference.speed)
        steps = np.diff(self._signals.feed(np.column_stack([drive, form.answer(rows)])), axis=0)
        # A step between samples that are n rows apart is in each row by one n-th.
        bridges = np.nan_to_num((steps**2).sum(axis=1) * (rows.spacing * RATE_HZ) ** 3 / 12.0)
        return np.asarray(bridges.reshape(-1, RATE_HZ).sum(axis=1))

    def _second(self, end_s: int, sums: Array, count: int, mixed: Array | None, unknown: float) -> Second:
        reference = self.reference
        assert reference is not None
        loss, value, error = None, None, np.inf
        if count >= LEAST_ROWS_PER_S:
            self._recent.append((end_s, sums))
            alarm = self._test.feed(end_s, sums, mixed, unknown)
            if self._traced:
                shown = end_s, self._test.threshold, max(self._test.evidence, 0.0)
                self._traced["evidence"].append(np.array([shown]))
            since_s = self._test.since_s
            if since_s is not None and (alarm or self._test.suspects):
                loss = self._loss(since_s, certain=alarm)
            if len(self._recent) >= WINDOW_S:
                window = [sums[0] for _, sums in [*self._recent][-WINDOW_S:]]
                value, error = _measured(window, reference)
        shift, shift_error = self._shifted(reference)
        return Second(end_s, value, error, loss, shift, shift_error, 0)

    def _loss(self, since_s: int, *, certain: bool) -> Loss | None:
        assert self.reference is not None
        # At the lag that explains most: a slow servo's share in time is no loss.
        at_lag = [sums[self._test.lag] for end_s, sums in self._recent if end_s > since_s]
        kept, error = _measured(at_lag, self.reference)
        if kept is None:
            return None
        return Loss(
            certain,
            since_s,
            self._test.evidence,
            self._test.lag_s or None,
            kept,
            error,
            self._test.probability(self._limits.effectiveness_emergency),
            self._test.surfaces() if self._mixed else None,
        )

    def _shifted(self, reference: Reference) -> tuple[float | None, float]:
        """Return the unexplained mean response, and what errors of the model and of sampling make of it."""
        count = sum(left.rows for left in self._left)
        if count < SHIFT_S * LEAST_ROWS_PER_S:
            return None, 0.0
        answered = float(sum(left.raw[self._test.lag] for left in self._left)) / count
        means = np.sum([left.columns[self._test.lag] for left in self._left], axis=0) / count
        driven = reference.gain * float(means[0])
        variance = means @ reference.covariance @ means + (WINDOW_DEVIATION * driven) ** 2
        variance += sum(left.unseen for left in self._left) / count**2
        return self._form.unexplained(answered, driven), NORMAL_95 * sqrt(variance)


def _measured(seconds: Collection[Array], reference: Reference) -> tuple[float | None, float]:
    """Return the effectiveness over some seconds and its standard error; None if they do not show it."""
    if len(seconds) == 0:
        return None, np.inf
    drive2, cross = np.array(seconds)[::-1, :2].T
    values, errors = measured(drive2, cross, reference)
    return (float(values[-1]), float(errors[-1])) if np.isfinite(errors[-1]) else (None, np.inf)
