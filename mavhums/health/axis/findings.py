"""Findings about an axis, and what explains them: the finding of another axis, or one of two mixed surfaces.

Mixed surfaces are elevons or a V-tail. One that keeps 1 − λ of its effect takes λ/2 of the gain about each of
its axes, and lets the demand about one axis move the aircraft about the other. The left surface moves with
the sum of both demands, the right one with their difference: the sign of this coupling distinguishes them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import Condition
from mavhums.health.axis.reference import Reference
from mavhums.health.axis.regressions import FORMS, Chain, Form, HighPass
from mavhums.health.axis.thresholds import (
    LEAST_ROWS_PER_S,
    MASKED_S,
)
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Coverage, Evidence, Interval, Suspect
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows


@dataclass(frozen=True, slots=True)
class AxisFindings:
    """The findings of a flight about one axis.

    Attributes
    ----------
    reference, best
        The reference used, or else the best candidate; None if there is none.
    usable_s
        Seconds of forward flight in which its demand was known, until the reference.
    effectiveness, windows
        The mean since the last change of the condition, or of a loss the value since its onset, with its
        95 % interval; and the number of windows in the mean, 0 for a loss.
    doubt
        The effectiveness over the last minute, where a loss of 40 % is not excluded by it.
    spacing_s
        Time between samples of the outputs or the rates, where a reference was sought.
    limits
        Limits by which the axis was judged.
    shares
        Of two mixed surfaces that move the axis, the probability that it is the ``left``, the ``right`` or
        ``both``; empty where the evidence does not decide.
    highest_evidence
        Highest logarithm of the evidence of a loss or a lag; None without a reference.
    """

    axis: str
    condition: Condition
    worst: Condition
    since_s: float | None
    coverage: Coverage
    suspects: tuple[Suspect, ...]
    evidence: tuple[Evidence, ...]
    effectiveness: Interval | None
    doubt: Interval | None
    windows: int
    reference: Reference | None
    best: Reference | None
    usable_s: int
    spacing_s: float
    limits: AxisLimits
    shares: Mapping[str, float] = field(default_factory=dict)
    highest_evidence: float | None = None


_ASTRAY: Final = frozenset({"hard_over", "tracking"})


def origins(faulty: Mapping[str, Sequence[Evidence]], mixed: Collection[str]) -> dict[str, str]:
    """Return of each axis whose finding another one explains, that other axis.

    Parameters
    ----------
    faulty
        The evidence of each axis that was degraded or an emergency.
    mixed
        The two axes that mixed surfaces move; none without.
    """
    if len(faulty) < 2:
        return {}
    begun = {axis: min(item.start_s for item in found) for axis, found in faulty.items()}
    first = min(begun, key=lambda axis: begun[axis])
    # A deflected rudder rolls and pitches the aircraft before the side force is certain.
    skids = [item.start_s for item in faulty.get("yaw", ()) if item.kind == "hard_over"]
    kinds = {axis: {item.kind for item in found} for axis, found in faulty.items()}
    if skids and min(skids) <= begun[first] + MASKED_S:
        first = "yaw"
    # An onset is known to within a manoeuvre; the rudder's effect is measured beside that of the ailerons.
    elif first == "yaw" and "roll" in begun and begun["roll"] <= begun["yaw"] + MASKED_S:
        first = "roll" if kinds["roll"] - _ASTRAY else first
    end_s = max(item.end_s for item in faulty[first])

    def explains(axis: str) -> bool:
        if begun[axis] > end_s + 2 * MASKED_S:
            return False
        # Elevons and V-tails fail about both of their axes, and the ailerons are part of the side force that
        # the rudder is measured against.
        if {first, axis} <= set(mixed) or (first, axis) == ("roll", "yaw"):
            return True
        # A surface that stays deflected upsets every axis; one that lost its effect upsets an attitude at
        # most, and leaves the gain of the others.
        return bool(kinds[first] & _ASTRAY) or kinds[axis] <= _ASTRAY

    return {axis: first for axis in faulty if axis != first and explains(axis)}


class _CoupledForm(Form):
    """A regression with the drive by the demand about another axis as its last nuisance."""

    def __init__(self, form: Form, other: str) -> None:
        self._form, self._other = form, other
        self.axis, self.nuisances, self.derivative = form.axis, form.nuisances + 1, form.derivative
        self.trimmed, self.beside = form.trimmed, (*form.beside, other)

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
        self._chain = Chain(_CoupledForm(FORMS[axis], other), reference.basis, reference.shape)
        self._filters = [HighPass(memory_s) for _ in range(3)]

    def feed(self, rows: Rows) -> Array:
        """Return of each second the information on a loss and on a coupling, and their scores.

        Returns
        -------
        Array
            Shape (n, 5): own drive², own times other, other², and the products of own and other with what the
            reference leaves of the response, over −K.
        """
        reference, columns = self._reference, self._chain.feed(rows)
        own, other = columns.others[:, :-1], columns.others[:, -1]
        left = columns.answer - own @ reference.others - reference.gain * columns.drive
        good = columns.good
        parts = zip(self._filters, (columns.drive, other, left), strict=True)
        d, c, r = (np.where(good, filter_.feed(np.where(good, part, np.nan)), 0.0) for filter_, part in parts)
        k = reference.gain
        products = np.stack([d * d, d * c, c * c, -d * r / k, -c * r / k], axis=1)
        sums: Array = products.reshape(-1, RATE_HZ, 5).sum(axis=1)
        whole = good.reshape(-1, RATE_HZ).sum(axis=1) >= LEAST_ROWS_PER_S
        return np.where(whole[:, None], sums, 0.0)
