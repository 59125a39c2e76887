"""Control effectiveness: the aircraft's current response to a demand, relative to the reference.

The gain K of the response to the drive is fitted together with all other contributions to the response in
the first excited seconds of the flight. Each later second gives a score: the shortfall of the response from
K times the drive, both without their slow parts, so that a change of trim is not a change of gain. The CUSUM
of the scores' log-likelihood ratios between the full gain and a reduced gain detects a loss. The likelihood
allows for the variation of K between manoeuvres.

References
----------
E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import replace
from math import exp
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.health.axis.findings import MixedSums
from mavhums.health.axis.reference import STANDARDS, Reference, Second, Standards, constants
from mavhums.health.axis.regressions import FORMS, Basis, Chain, Columns, Form, Lag, Shape, judgeable
from mavhums.health.axis.scores import LossExclusion, Pool, Scores, ServoLag, Sums, measured
from mavhums.health.axis.thresholds import (
    DETECTED_LOSS_PER_LIMIT,
    DRIVEN_SHARE,
    EXCLUDING_SPEED_SHARE,
    EXTRA_LAGS_S,
    FORGET_S,
    FULL_S,
    JUDGED_ERROR,
    LEAST_DRIVE,
    LEAST_ROWS_PER_S,
    LONGEST_REFERENCE_S,
    LOSS_SECONDS,
    MANOEUVRE_DEVIATION,
    MEAN_ROWS,
    MOST_CUSUM,
    POOLED_S,
    REFERENCE_RETRY_S,
    REFERENCE_S,
    SHIFT_S,
    TAIL_SHARE,
    WINDOW_SECONDS,
)
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import AXES

_FORGET: Final = exp(-1.0 / FORGET_S)  # per second


def new_tracker(
    axis: str, limits: AxisLimits | None = None, coupled: str | None = None
) -> EffectivenessTracker:
    """Return the tracker of the effectiveness of an axis; ``coupled`` is one that the same surfaces move."""
    least = 1.0 - (limits or AxisLimits()).effectiveness_degraded
    loss = round(DETECTED_LOSS_PER_LIMIT * least, 9)  # the profile's decimals, not those of the subtraction
    return EffectivenessTracker(FORMS[axis], replace(STANDARDS[axis], loss=loss), coupled)


class EffectivenessTracker:
    """Tracks the effectiveness of one axis.

    Parameters
    ----------
    form
        The regression of the axis.
    standards
        Requirements on the reference.
    coupled
        Another axis that the same surfaces move; None if they are not mixed.
    """

    def __init__(self, form: Form, standards: Standards, coupled: str | None = None) -> None:
        self._form, self._standards, self._coupled = form, standards, coupled
        self._waiting: list[Rows] = []
        self._tried = 0
        self.reference: Reference | None = None
        self.best: Reference | None = None
        self.usable_s = 0
        self.spacing_s = 0.0
        self.excluded_s = 0

    @property
    def too_slow(self) -> bool:
        """Whether the outputs or the rates are sampled too slowly to determine a gain."""
        return self.spacing_s > self._standards.spacing_s

    def feed(self, rows: Rows) -> list[Second]:
        """Process rows; return the results of their seconds, from the first second with a reference on."""
        first = self._wait(rows) if self.reference is None else 0
        return self._judge(rows.cut(first, rows.seconds)) if first < rows.seconds else []

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
            if self.usable_s >= REFERENCE_S and self._tried >= REFERENCE_RETRY_S:
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
        spacing = rows.spacing[rows.flying & np.isfinite(rows.spacing)]
        self.spacing_s = float(np.median(spacing)) if spacing.size else 0.0
        # Slower samples alias the manoeuvres: their gain would be that of the sampling.
        if self.too_slow:
            return
        # A cheap look before a fit of every shape.
        if judgeable(rows, basis, self._form.least_speed_share).sum() < REFERENCE_S * LEAST_ROWS_PER_S:
            return
        wanted = self._standards
        fits = [fit for shape in wanted.shapes() if (fit := self._fit(rows, basis, shape)) is not None]
        # In calm air a regression can find the autopilot's feedback instead of the aircraft, with a gain of
        # the wrong sign.
        possible = [fit for fit in fits if self._form.possible(fit.others)]
        found = max(possible, key=lambda fit: fit.explained, default=None)
        if found is None:
            return
        self.best = found if self.best is None or found.explained > self.best.explained else self.best
        if found.explained >= wanted.explained and found.error <= wanted.error:
            design, answer, _ = self._design(Chain(self._form, basis, found.shape).feed(rows))
            self.reference = replace(found, constants=constants(self._form, found.speed, design, answer))
            self._begin(rows)

    def _design(self, columns: Columns) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return the last usable rows that a reference needs: design, response and their places."""
        at = np.flatnonzero(columns.good)[-REFERENCE_S * RATE_HZ :]
        return np.column_stack([columns.drive, columns.others])[at], columns.answer[at], at

    def _fit(self, rows: Rows, basis: Basis, shape: Shape) -> Reference | None:
        columns = Chain(self._form, basis, shape).feed(rows)
        design, answer, at = self._design(columns)
        if at.size < REFERENCE_S * LEAST_ROWS_PER_S or design[:, 0].std() < LEAST_DRIVE:
            return None
        beta, left = _least_squares(design, answer)
        _, without = _least_squares(design[:, 1:], answer)
        explained = 1.0 - left / without if without > 0 else 0.0
        sums = Scores(beta[1:], self._standards.memory_s).feed(columns)
        inside = np.unique(at // RATE_HZ)
        drive2, cross = sums.drive2[inside], sums.cross[inside]
        total = float(drive2.sum())
        if total <= 0:
            return None
        gain = float(cross.sum()) / total
        variance = float(((cross - gain * drive2) ** 2).sum()) / total
        least = self._standards.scatter * gain**2
        # The reference may lie in quiet air, and the rest of the flight in rough air.
        seen, variance = variance, max(variance, least)
        # A weak drive in quiet air shows how the autopilot answers gusts, not what a manoeuvre does.
        error = float(np.sqrt((variance if self._form.feels_gusts else seen) / total)) / abs(gain or np.nan)
        power = float(drive2.mean())
        first, last = rows.second + int(inside[0]), rows.second + int(inside[-1]) + 1
        deviation = float(np.sqrt(left))
        return Reference(
            basis, shape, gain, beta[1:], variance, error, explained, deviation, power, first, last
        )

    def _begin(self, rows: Rows) -> None:
        reference = self.reference
        assert reference is not None
        extras = (0.0, *EXTRA_LAGS_S)
        self._chains = [Chain(self._form, reference.basis, reference.shape, extra) for extra in extras]
        self._scores = [Scores(reference.others, self._standards.memory_s) for _ in extras]
        self._cusum, self._full, self._strongest = 0.0, 0, 0.0
        self._since = reference.end_s
        self._window: deque[Array] = deque(maxlen=WINDOW_SECONDS)
        self._recent: deque[Array] = deque(maxlen=LOSS_SECONDS)
        self._servo_lag = ServoLag()
        self._left: deque[tuple[Array, int]] = deque(maxlen=SHIFT_S)
        self._exclusion, self._driven = LossExclusion(reference), Pool(reference, POOLED_S)
        self._mixed: MixedSums | None = None
        if self._coupled is not None:
            self._mixed = MixedSums(reference, self._form.axis, self._coupled, self._standards.memory_s)
            self._mixed.feed(rows)
        self._sums(rows)
        slow = EXCLUDING_SPEED_SHARE
        self._slow_chain = Chain(self._form, reference.basis, reference.shape, least_share=slow)
        self._slow_scores = Scores(reference.others, self._standards.memory_s)
        self.excluded_s = self._exclusion.begin(self._excluding(rows).values())
        self._waiting.clear()

    def _sums(self, rows: Rows) -> list[Sums]:
        pairs = zip(self._scores, self._chains, strict=True)
        return [scores.feed(chain.feed(rows)) for scores, chain in pairs]

    def _excluding(self, rows: Rows) -> dict[int, tuple[float, float]]:
        """Return, by place, the seconds that may exclude a loss: drive², and drive times response.

        They may be slower than those that show one.
        """
        sums = self._slow_scores.feed(self._slow_chain.feed(rows))
        return {
            k: (float(sums.drive2[k]), float(sums.cross[k]))
            for k in np.flatnonzero(sums.count >= LEAST_ROWS_PER_S).tolist()
        }

    def _judge(self, rows: Rows) -> list[Second]:
        sums = self._sums(rows)
        excluding = self._excluding(rows)
        stacked = np.array([[s.drive2, s.cross, s.answer2] for s in sums])
        assert self.reference is not None
        left = np.array([[s.raw, self.reference.gain * s.driven] for s in sums])
        seconds = []
        for k in range(rows.seconds):
            excluded = self._exclusion.feed(*excluding[k]) if k in excluding else 0
            count = int(sums[0].count[k])
            end_s = rows.second + k + 1
            seconds.append(self._second(end_s, stacked[:, :, k], count, left[:, :, k], excluded))
        if self._mixed is None:
            return seconds
        mixed = self._mixed.feed(rows)
        return [replace(second, mixed=part) for second, part in zip(seconds, mixed, strict=True)]

    def _second(self, end_s: int, sums: Array, count: int, left: Array, excluded: int) -> Second:
        reference = self.reference
        assert reference is not None
        self._left.append((left, count))
        if count >= LEAST_ROWS_PER_S:
            # Row 0 is without additional lag; the columns are drive², drive·response and response².
            drive2, cross = float(sums[0, 0]), float(sums[0, 1])
            score = cross - reference.gain * drive2
            self._window.append(sums)
            # The slow filter's tail fades with its memory, and the square of it twice as fast.
            self._strongest = max(drive2, exp(-2.0 / self._standards.memory_s) * self._strongest)
            ratio = _ratio(score, drive2, reference, self._standards.loss)
            # Evidence for the full gain always counts, evidence for a loss only where demand dominates gusts.
            informs = self._informs(reference)
            if informs:
                self._driven.add(drive2, cross, float(sums[0, 2]))
            if ratio < 0.0 or informs:
                self._cusum = min(MOST_CUSUM, max(0.0, _FORGET * self._cusum + ratio))
                self._recent.append(sums)
        value, error = None, np.inf
        if count >= LEAST_ROWS_PER_S and len(self._window) == WINDOW_SECONDS:
            value, error = _measured([window[0] for window in self._window], reference)
        if value is not None and error <= JUDGED_ERROR:
            self._full = self._full + 1 if value >= self._standards.full else 0
        # A fault that is over must not leave its sum behind.
        if self._full >= FULL_S:
            self._cusum = 0.0
            self._driven.clear()
        # Without a suspicion the onset moves along, and so does what is measured since then.
        if self._cusum == 0.0:
            self._since = end_s
            self._recent.clear()
            self._servo_lag = ServoLag()
        slow_s, later = self._servo_lag.feed(self._recent, reference.gain)
        shift, shift_error = self._shifted(reference.error)
        # At the lag that explains most: a slow servo's share in time is no loss.
        at_lag = [sums[self._servo_lag.lag] for sums in self._recent]
        left_over, left_error = _measured(at_lag, reference)
        return Second(
            end_s,
            value,
            error,
            self._cusum,
            self._since,
            slow_s,
            later,
            shift,
            left_over,
            left_error,
            len(self._recent),
            excluded,
            driven=self._driven.whole(),
            steady=self._driven.steady(),
            shift_error=shift_error,
        )

    def _shifted(self, gain_error: float) -> tuple[float | None, float]:
        """Return the unexplained mean response, and what of it the error of the reference's gain makes."""
        count = sum(rows for _, rows in self._left)
        if count < SHIFT_S * LEAST_ROWS_PER_S:
            return None, 0.0
        answered, driven = np.sum([left[self._servo_lag.lag] for left, _ in self._left], axis=0) / count
        return self._form.unexplained(float(answered), float(driven)), gain_error * abs(float(driven))

    def _informs(self, reference: Reference) -> bool:
        """Return whether demand, not gusts, dominates the last seconds.

        Gusts move the aircraft and, through the autopilot, the surfaces against it: without other drive, the
        gain is underestimated. The drive must therefore be nearly that of the reference, and some gain, with
        some lag, must explain most of the response. After a strong manoeuvre the tail of the slow filter
        would repeat that manoeuvre's score for seconds.
        """
        drive2, cross, answer2 = np.sum(self._window, axis=0).T
        if drive2[0] < DRIVEN_SHARE * reference.power * len(self._window):
            return False
        if self._window[-1][0, 0] < TAIL_SHARE * self._strongest:
            return False
        # A lag under which nothing was driven explains nothing, and would divide by zero.
        driven = drive2 > 0
        unexplained = (answer2[driven] - cross[driven] ** 2 / drive2[driven]) / drive2[driven]
        return float(unexplained.min(initial=np.inf)) <= self._standards.noise * reference.gain**2


def explained_by(axis: str, rows: Rows, demand: Array, others: Array) -> tuple[float, float]:
    """Return how much of the response about an axis a demand explains, and how much of the rest others do.

    Unlike in a reference, all usable rows count.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    rows
        The flight.
    demand, others
        The demand in question, shape (n,), and others, shape (n, k).

    Returns
    -------
    tuple
        Of the response that is left without any demand, the share that the demand explains; of what it
        leaves, the share that the others explain. Zero if the rows do not suffice.
    """
    outputs = np.full((len(rows), len(AXES)), np.nan)
    outputs[:, AXES.index(axis)] = demand
    form, rows = FORMS[axis], replace(rows, outputs=outputs)
    basis = Basis.of(rows)
    best = 0.0, 0.0
    for shape in STANDARDS[axis].shapes():
        columns = Chain(form, basis, shape).feed(rows)
        late = _late(others, shape) * (rows.speed / basis.speed)[:, None]
        good = columns.good & np.isfinite(late).all(axis=1)
        if good.sum() < REFERENCE_S * LEAST_ROWS_PER_S:
            continue
        nuisances, answer = columns.others[good], columns.answer[good]
        own = np.column_stack([columns.drive[good], nuisances])
        beta, left = _least_squares(own, answer)
        _, without = _least_squares(nuisances, answer)
        if not left < without * (1.0 - best[0]) or not form.possible(beta[1:]):
            continue
        _, both = _least_squares(np.column_stack([own, late[good]]), answer)
        best = 1.0 - left / without, 1.0 - both / left
    return best


def _late(demands: Array, shape: Shape) -> Array:
    """Return demands with the delay and the lag of a response, and half of the mean of its columns."""
    late = shape.delay_rows + MEAN_ROWS // 2
    out = np.full_like(demands, np.nan)
    for k, demand in enumerate(demands.T):
        out[late:, k] = Lag(shape.tau_s).feed(demand)[: len(demand) - late]
    return out


def _measured(seconds: Collection[Array], reference: Reference) -> tuple[float | None, float]:
    """Return the effectiveness over some seconds and its standard error; None if they do not show it."""
    if len(seconds) == 0:
        return None, np.inf
    drive2, cross, _ = np.array(seconds)[::-1].T
    values, errors = measured(drive2, cross, reference)
    return (float(values[-1]), float(errors[-1])) if np.isfinite(errors[-1]) else (None, np.inf)


def _ratio(score: float, drive2: float, reference: Reference, loss: float) -> float:
    """Return the log-likelihood ratio of a second between a loss and none."""
    lost = loss * reference.gain
    # The gain of a single second differs between manoeuvres, in proportion to the drive.
    spread = reference.variance + (MANOEUVRE_DEVIATION * reference.gain) ** 2 * drive2
    return float((-lost * score - 0.5 * lost**2 * drive2) / spread)


def _least_squares(design: Array, answer: Array) -> tuple[Array, float]:
    beta: Array = np.asarray(np.linalg.lstsq(design, answer, rcond=None)[0], dtype=np.float64)
    left = answer - design @ beta
    return beta, float(np.var(left))
