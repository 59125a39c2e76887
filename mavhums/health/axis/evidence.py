"""What a second says for a loss of control effectiveness or a slow servo, and against gusts and manoeuvres.

The response of an axis is y = (1 − λ)·K·d + noise: d is the drive, K the gain of the reference, λ the loss.
A second's sums give the log-likelihood ratio of each λ, and of each additional lag of d, against health, more
than λ = 0:

- *gusts*: they move the aircraft and, through the autopilot, the surfaces against it, which lowers the gain
  by up to √(R / K²D − u) (Cauchy and Schwarz): R is the response that no gain explains, u the share that is
  unexplained in the reference, D the sum of d²;
- *lags* up to the one that the profile allows: one of them is the aircraft's, as healthy seconds show;
- *speeds*: one that no sensor measures changes the gain by the share that is unknown;
- *reference*: its gain has an error, and is that of its own manoeuvres, which healthy seconds show;
- *manoeuvres*: the gain changes by a little between them, from one of some minutes to the next;
- *size*: beyond the reference's largest manoeuvre a servo may be too slow, or a surface stall, which lowers
  the gain by up to a fifth;
- *trim*: thrust and speed change it, and the surfaces that follow move nothing. A trim that is constant over
  the last seconds adds noise by the share of the drive that is constant, too.

The noise is that of the reference, or R over the last seconds if it is larger.

Each of two mixed surfaces is a hypothesis of its own: its loss also lets the demand about the other axis move
this one, y = (1 − μ)·K·d ∓ μ·K·c with the drive c of the other demand. No healthy axis does that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from math import hypot, inf, log, sqrt
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.thresholds import (
    EXTRA_LAGS_S,
    GAIN_DEVIATION,
    GAIN_KEPT_S,
    GUST_WINDOW_S,
    LARGER_LOSS,
    LEAST_LOSS_PER_LIMIT,
    LONGEST_REFERENCE_S,
    LOSSES,
    MEAN_ROWS,
    MOST_RATIO,
    NORMAL_EFFECTIVENESS,
    TRIM_CHANGE,
)
from mavhums.health.decision.thresholds import FALSE_ALARMS, NORMAL_S
from mavhums.health.sequential import EXCLUDING, SequentialTest
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.grid import RATE_HZ

_LAGS_S: Final = np.array((0.0, *EXTRA_LAGS_S))
_ERRORS: Final = np.arange(-3.0, 4.0)[:, None]  # of the reference's gain, in standard deviations
_TINY: Final = float(np.finfo(np.float64).tiny)
_PRIOR: Final = -0.5 * _ERRORS**2 - np.logaddexp.reduce(-0.5 * _ERRORS**2)  # logarithms of probabilities


class LossTest:
    """The sequential test of one axis against its reference.

    Parameters
    ----------
    reference
        The healthy response.
    limits
        The loss and the lag from which the axis is degraded.
    false_alarms
        Accepted number of false alarms in 100 hours.

    Attributes
    ----------
    highest, threshold
        Highest evidence so far, and that of an alarm.
    """

    def __init__(
        self,
        reference: Reference,
        limits: AxisLimits,
        false_alarms: float = FALSE_ALARMS,
        *,
        mixed: bool = False,
    ) -> None:
        self._reference = reference
        least = LEAST_LOSS_PER_LIMIT * (1.0 - limits.effectiveness_degraded)
        losses = np.linspace(min(least, 1.0), 1.0, LOSSES)
        slow = np.flatnonzero(limits.lag_s < _LAGS_S)
        self._allowed = np.flatnonzero(limits.lag_s >= _LAGS_S)
        # One of two mixed surfaces takes at most half of the gain, and as much of it moves the other axis.
        halves = np.linspace(min(least, 0.5), 0.5, LOSSES) if mixed else ()
        hypotheses = [(1.0 - loss, 0.0, 0) for loss in losses]
        hypotheses += [(1.0 - half, side * half, 0) for side in (1.0, -1.0) for half in halves]
        hypotheses += [(1.0, 0.0, lag) for lag in slow.tolist()]
        self._kept, self._moved, lags = np.array(hypotheses).T
        self._lag = lags.astype(np.intp)
        lost = self._lag == 0
        # A loss may be one of an aircraft that is late by what is allowed.
        self._lags = np.where(lost, self._allowed[:, None], self._lag)
        half = 0.5 if len(slow) else 1.0
        weights = np.where(lost, half / lost.sum(), half / max(len(slow), 1))
        self._test = SequentialTest(weights, false_alarms)
        self.highest, self.threshold = -inf, self._test.threshold
        # The reference's manoeuvres are others than those of the flight.
        error = hypot(reference.error, GAIN_DEVIATION)
        self._gains = 1.0 + error * _ERRORS
        # Of each gain, in the rows, and of each allowed lag, in the columns.
        self._likely: Array = _PRIOR - log(len(self._allowed)) + np.zeros(len(self._allowed))
        self._changes = _changes(error)
        self._noise = self._health = 0.0
        self._waiting = 0  # seconds since the last one over which a loss is excluded
        self._window: deque[Array] = deque(maxlen=GUST_WINDOW_S)
        self._coupled: deque[Array] = deque(maxlen=GUST_WINDOW_S)

    def feed(self, end_s: int, sums: Array, mixed: Array | None = None, unknown: float = 0.0) -> bool:
        """Take a usable second; return whether a fault is present.

        Parameters
        ----------
        end_s
            Flight second of its end.
        sums
            Drive², drive times response, response², and drive by additional lag, shape (1 + lags, 4).
        mixed
            Sums of mixed surfaces (:meth:`~mavhums.health.axis.findings.MixedSums.feed`), shape (5,).
        unknown
            Share of the gain that the error of the speed makes.
        """
        gain, (drive2, cross) = self._reference.gain, sums[:, :2].T
        if not drive2[0] > 0.0:  # what is not driven says nothing
            return self._test.alarm
        self._window.append(sums)
        if mixed is not None:
            self._coupled.append(mixed)
        unknown = max(unknown, self._beyond(float(drive2[0])))
        self._noise, gust_loss = self._gusts()
        spread = self._spread()
        kept = self._kept * self._gains[:, :, None]
        lost = _explained(kept, drive2[self._lags], cross[self._lags], gain)
        if mixed is not None:
            _, both, other2, _, coupled = mixed.tolist()
            lost += gain**2 * self._moved * (2.0 * (coupled - (1.0 - kept) * both) - self._moved * other2)
        allowed = drive2[self._allowed], cross[self._allowed]
        share = allowed[1] / (np.maximum(allowed[0], _TINY) * gain)
        gusty = np.clip(share, self._gains * (1.0 - gust_loss - unknown), self._gains)
        health = self._likely + _explained(gusty, *allowed, gain) / spread
        perfect = float(_explained(1.0, drive2[0], cross[0], gain)) / spread
        hypotheses = np.logaddexp.reduce(self._likely[:, :, None] + lost / spread, axis=(0, 1))
        ratios = hypotheses - np.logaddexp.reduce(health, axis=None)
        if not self._test.alarm:  # in a fault a second says nothing about the reference
            self._learn(np.exp(health - np.logaddexp.reduce(health, axis=None)))
        best = float(ratios.max())
        back = float(hypotheses[self._test.likeliest]) - perfect
        # The differences between the hypotheses stay.
        alarm = self._test.feed(end_s, ratios + _bounded(best) - best, _bounded(back))
        self.highest = max(self.highest, self._test.evidence)
        return alarm

    def _learn(self, probabilities: Array) -> None:
        """Take the probabilities of the gain and of the lag, shape (7, lags), after a healthy second.

        Both change: the gain with manoeuvres, the lag once within the seconds that make a verdict.
        """
        changed = self._changes @ probabilities
        mean = changed.mean(axis=1, keepdims=True)
        self._likely = np.log(mean + (1.0 - 1.0 / NORMAL_S) * (changed - mean))

    def excludes(self, drive2: float, cross: float, unknown: float = 0.0) -> int:
        """Take a second that may be slower than those of :meth:`feed`.

        Parameters
        ----------
        drive2, cross
            Its sums of drive², and of drive times response.
        unknown
            Share of the gain that the error of the speed makes.

        Returns
        -------
        int
            Number of seconds over which a loss of 40 % or more is excluded with 95 % by now, and was not
            before: a larger loss is the less likely wherever one of 40 % is less likely than health.
        """
        if not drive2 > 0.0:
            return 0
        unknown = max(unknown, self._beyond(drive2))
        kept = np.array((1.0, min(NORMAL_EFFECTIVENESS * (1.0 + unknown), 1.0))) * self._gains
        explained = _explained(kept, drive2, cross, self._reference.gain) / self._spread()
        likely = np.logaddexp.reduce(self._likely, axis=1)[:, None]
        healthy, lost = np.logaddexp.reduce(likely + explained)
        ratio = _bounded(float(healthy - lost))
        self._health = min(max(self._health, 0.0) + ratio, EXCLUDING)
        self._waiting = min(self._waiting + 1, LONGEST_REFERENCE_S)
        if self._health < EXCLUDING:
            return 0
        waiting, self._waiting = self._waiting, 0
        return waiting

    def excludes_in_reference(self, seconds: Iterable[tuple[float, float, float]]) -> int:
        """Take the seconds until the reference's end; return over how many of them a loss is excluded.

        They do not speak for those after it.
        """
        excluded = sum(self.excludes(*second) for second in seconds)
        self._health, self._waiting = 0.0, 0
        return excluded

    def _spread(self) -> float:
        """Return twice the variance of a second's score, relative to drive²."""
        trim = TRIM_CHANGE**2 * self._constant() * self._reference.gain**2
        return 2.0 * (max(self._noise, self._reference.variance) + trim)

    def _gusts(self) -> tuple[float, float]:
        """Return the noise of the last seconds, and the largest share of the gain that their gusts hide."""
        drive2, cross, answer2, _ = np.sum(self._window, axis=0).T
        # A lag under which nothing was driven explains nothing, and would divide by zero.
        driven = drive2 > 0.0
        if not driven[0]:
            return 0.0, 0.0
        left = float((answer2[driven] - cross[driven] ** 2 / drive2[driven]).min())
        own = drive2[0] * self._reference.gain**2
        share = max(left / own - self._coupling(), 0.0)
        noise = share * own / len(self._window) * MEAN_ROWS / RATE_HZ  # of independent rows
        return noise, sqrt(max(share - (1.0 - self._reference.explained), 0.0))

    def _beyond(self, drive2: float) -> float:
        """Return the share of the gain that a second may lack by being larger than those of the reference."""
        return LARGER_LOSS * max(1.0 - sqrt(self._reference.largest / drive2), 0.0)

    def _constant(self) -> float:
        """Return (Σd)² / Σd² of the last seconds: their rows if d is constant, 0 if it is balanced."""
        if not self._window:
            return 0.0
        drive2, _, _, drive = np.sum(self._window, axis=0)[0].tolist()
        return drive**2 / drive2 if drive2 > 0.0 else 0.0

    def _coupling(self) -> float:
        """Return the share of the response that the demand about the other axis explains: no gusts."""
        if not self._coupled:
            return 0.0
        drive2, both, other2, lost, coupled = np.sum(self._coupled, axis=0).tolist()
        alone = drive2 * other2 - both**2
        return (coupled * drive2 - lost * both) ** 2 / alone / drive2**2 if alone > 0.0 else 0.0

    @property
    def evidence(self) -> float:
        """Logarithm of the evidence, for the test's threshold of an alarm."""
        return self._test.evidence

    @property
    def suspects(self) -> bool:
        """Whether health shows as much evidence less often than ten times between two false alarms."""
        return self._test.evidence >= self._test.threshold - log(10.0)

    @property
    def since_s(self) -> int | None:
        """Flight second at which the likeliest fault begins; None without one."""
        since = self._test.since
        return None if since is None else since - 1

    @property
    def lag(self) -> int:
        """Index of the additional lag of the suspected fault, 0 for a loss or without one."""
        return int(self._lag[self._test.likeliest]) if self.suspects else 0

    @property
    def lag_s(self) -> float:
        """The same lag, s."""
        return float(_LAGS_S[self.lag])

    def surfaces(self) -> Array:
        """Return the probability that the left, the right or both mixed surfaces lost effect, shape (3,)."""
        shares = self._test.shares()
        left, right = self._moved > 0.0, self._moved < 0.0
        found = np.array([shares[one].sum() for one in (left, right, (self._lag == 0) & ~left & ~right)])
        return np.asarray(found / max(found.sum(), _TINY))

    def probability(self, kept: float) -> float:
        """Return the probability that a fault leaves no more than a share, and is no lag."""
        return float(self._test.shares()[(self._lag == 0) & (self._kept <= kept)].sum())


def _changes(error: float) -> Array:
    """Return the probability that one gain, in the columns, is another one, in the rows, a second later."""
    steps = error / GAIN_DEVIATION * (_ERRORS - _ERRORS.T)
    changed = np.exp(_PRIOR - 0.5 * steps**2)
    kept = 1.0 - 1.0 / GAIN_KEPT_S
    return np.asarray(kept * np.eye(_ERRORS.size) + (1.0 - kept) * changed / changed.sum(axis=0))


def _bounded(ratio: float) -> float:
    return min(max(ratio, -MOST_RATIO), MOST_RATIO)


def _explained(kept: Array | float, drive2: Array | float, cross: Array | float, gain: float) -> Array:
    """Return the square of the response that a share of the gain explains, less what it adds."""
    gains = kept * gain
    return np.asarray(2.0 * gains * cross - gains**2 * drive2)
