"""Which of two mixed surfaces, as elevons or a V-tail, explains a loss about the two axes that both move.

A surface that keeps 1 − λ of its effect takes λ/2 of the gain about each of its axes, and lets the demand
about one axis move the aircraft about the other. The left surface moves with the sum of both demands, the
right one with their difference: the sign of this coupling tells them apart.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.axis.filters import HighPass
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.regressions import FORMS, Chain, Form
from mavhums.health.axis.thresholds import LEAST_ROWS_PER_S, MANOEUVRE_DEVIATION, MIXED_RECENT_S, MIXED_WEIGHT
from mavhums.vehicle.flight import Rows
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["MixedPair", "MixedSums"]

# Shares of (own demand, other demand) in half of the reference's gain that a surface without effect takes
# away. Of both, the own demand's gain falls and nothing couples.
_TAKEN: Final[Mapping[str, Array]] = {
    "left": np.array([0.5, 0.5]),
    "right": np.array([0.5, -0.5]),
    "both": np.array([1.0, 0.0]),
}


class _Coupled(Form):
    """A regression with the drive by the demand about another axis as its last nuisance."""

    def __init__(self, form: Form, other: str) -> None:
        self._form, self._other = form, other
        self.axis, self.nuisances, self.derivative = form.axis, form.nuisances + 1, form.derivative

    def drive(self, demand: Array, relative: Array) -> Array:
        return self._form.drive(demand, relative)

    def others(self, rows: Rows, relative: Array, demands: dict[str, Array]) -> Array:
        coupled = self._form.drive(demands[self._other], relative)
        return np.column_stack([self._form.others(rows, relative, demands), coupled])

    def answer(self, rows: Rows) -> Array:
        return self._form.answer(rows)


class MixedSums:
    """Sums about one axis of two mixed surfaces, by second, of what the reference leaves unexplained.

    Parameters
    ----------
    reference
        The reference of the axis.
    axis, other
        The axis, and the other one that the surfaces move.
    memory_s
        Memory of the filter that removes trim.
    """

    def __init__(self, reference: Reference, axis: str, other: str, memory_s: float) -> None:
        self._reference = reference
        self._chain = Chain(_Coupled(FORMS[axis], other), reference.basis, reference.shape)
        self._filters = [HighPass(memory_s) for _ in range(3)]

    def feed(self, rows: Rows) -> Array:
        """Return of each second the information on a loss and on a coupling, and their scores.

        Returns
        -------
        Array
            Shape (n, 5): the 2×2 information matrix's three elements, then the two scores.
        """
        reference, columns = self._reference, self._chain.feed(rows)
        own, other = columns.others[:, :-1], columns.others[:, -1]
        left = columns.answer - own @ reference.others - reference.gain * columns.drive
        good = columns.good
        parts = zip(self._filters, (columns.drive, other, left), strict=True)
        d, c, r = (np.where(good, filter_.feed(np.where(good, part, 0.0)), 0.0) for filter_, part in parts)
        k = reference.gain
        products = np.stack([d * d, d * c, c * c, -d * r / k, -c * r / k], axis=1)
        sums: Array = products.reshape(-1, RATE_HZ, 5).sum(axis=1)
        # The gain of a single second differs between manoeuvres, in proportion to the drive.
        spread = reference.variance / k**2 + MANOEUVRE_DEVIATION**2 * (sums[:, 0] + sums[:, 2])
        whole = good.reshape(-1, RATE_HZ).sum(axis=1) >= LEAST_ROWS_PER_S
        return np.asarray(np.where(whole, 1.0, 0.0)[:, None] * sums / spread[:, None])


class MixedPair:
    """Weighs which of two mixed surfaces explains what both of their axes show since the onset of a loss."""

    def __init__(self) -> None:
        self._recent: deque[tuple[int, Array]] = deque()
        self._total: Array | None = None

    def add(self, end_s: int, sums: Array) -> None:
        """Add a second of one axis."""
        if self._total is not None:
            self._total += sums
        self._recent.append((end_s, sums))
        while self._recent[0][0] < end_s - MIXED_RECENT_S:
            self._recent.popleft()

    def begin(self, since_s: int) -> None:
        """Begin with a loss that has this onset."""
        self._total = np.sum([sums for end_s, sums in self._recent if end_s > since_s], axis=0) + np.zeros(5)

    def shares(self) -> dict[str, float]:
        """Return the probability that it is the ``left``, the ``right`` or ``both``; empty without a loss."""
        if self._total is None or not self._total.any():
            return {}
        dd, dc, cc, *score = self._total
        information = np.array([[dd, dc], [dc, cc]])
        logs = {}
        for name, taken in _TAKEN.items():
            size = float(taken @ information @ taken)
            total = float(taken @ score)
            lost = min(max(total / size, 0.0), 1.0) if size > 0 else 0.0
            logs[name] = MIXED_WEIGHT * (lost * total - lost**2 * size / 2)
        # Priors are equal; of the same data the likelihoods give the probabilities.
        top = max(logs.values())
        weights = {name: float(np.exp(value - top)) for name, value in logs.items()}
        return {name: weight / sum(weights.values()) for name, weight in weights.items()}
