"""The trim of a flight: which motors carry more than their share, for the comparison with other flights.

An imbalance alone is no evidence: whole propellers, a battery beside the middle and a motor's tolerance make
one. A change of it against the same aircraft's earlier flights is.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import NORMAL_95
from mavhums.results.standing import Interval
from mavhums.results.verdict import Indicator
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["BETWEEN_FLIGHTS", "NEEDED_FLIGHTS", "TRIM", "TRIM_YAW", "Trims"]

TRIM: Final = "trim"
"""Fault of the indicator: thrust that a motor gives more than its share, by that share."""
TRIM_YAW: Final = "trim_yaw"
"""The part of it about yaw, which a shifted weight does not change."""

BETWEEN_FLIGHTS: Final = np.array([0.03, 0.05, 0.012])
"""Standard deviation between a quad's flights of its effort about roll, pitch and yaw, by the thrust of one
motor: six flights of one aircraft with whole propellers."""
NEEDED_FLIGHTS: Final = 3
"""The scatter between flights is known from others, so the mean is all that the own ones must give."""
# Blocks as long as gusts last, s, whose mean is the trim; fewer have no scatter to speak of. By hand.
_BLOCK_S: Final = 10
_LEAST_BLOCKS: Final = 3


class Trims:
    """Sums up the trim of one flight in constant memory.

    Parameters
    ----------
    columns
        Effort about roll, pitch and yaw by each motor's thrust, shape (motors, 3).
    """

    def __init__(self, columns: Array) -> None:
        self._columns = columns
        self._block: list[Array] = []
        self._blocks = 0
        self._mean, self._squares = np.zeros(3), np.zeros(3)

    def add(self, thrusts: Array, flown: Flags) -> None:
        """Take whole seconds: thrusts, shape (n, motors), and in which rows it flew upright."""
        seconds = thrusts.reshape(-1, RATE_HZ, thrusts.shape[1]).mean(axis=1)
        # Second by second, so that the sums do not depend on how the log was cut.
        for second in np.flatnonzero(flown.reshape(-1, RATE_HZ).all(axis=1)).tolist():
            self._block.append(seconds[second])
            if len(self._block) == _BLOCK_S:
                asked = np.mean(self._block, axis=0)
                self._block.clear()
                self._blocks += 1
                effort = asked @ self._columns / asked.mean()
                off = effort - self._mean
                self._mean = self._mean + off / self._blocks
                self._squares = self._squares + off * (effort - self._mean)

    def of_motor(self, motor: int) -> tuple[Indicator, ...]:
        """Return the indicators of a motor, from 0; none of a flight that is too short."""
        if self._blocks < _LEAST_BLOCKS:
            return ()
        column = self._columns[motor]
        weights = column / BETWEEN_FLIGHTS**2
        weights = weights / (weights @ column)
        turns = np.array([0.0, 0.0, np.sign(column[2])])
        return (
            self._indicator(TRIM, "thrust beyond its share", weights),
            self._indicator(TRIM_YAW, "effort about yaw towards it", turns),
        )

    def _indicator(self, fault: str, quantity: str, weights: Array) -> Indicator:
        value = float(weights @ self._mean)
        scatter = float(np.sqrt(weights**2 @ self._squares / (self._blocks - 1)))
        half = NORMAL_95 * scatter / self._blocks**0.5
        return Indicator(
            fault=fault,
            quantity=quantity,
            unit="1",
            value=Interval(estimate=round(value, 5), low=round(value - half, 5), high=round(value + half, 5)),
            windows=self._blocks,
            scatter=round(scatter, 5),
            needed_flights=NEEDED_FLIGHTS,
        )
