"""Residuals of a regression on the flight's own beginning: over three seconds, in standard deviations."""

from __future__ import annotations

from collections import deque
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mavhums.vehicle.flight import Rows
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["Left", "Model", "Residual"]

REFERENCE_S: Final = 40
_OVER_S: Final = 3
_LEAST_ROWS: Final = 14

Array = NDArray[np.float64]


class Model(Protocol):
    """A regression whose residual is monitored.

    Attributes
    ----------
    kind
        Whether the mean of the residual counts, or its root mean square.
    floor
        Smallest standard deviation of the residual: a calm reference does not guarantee a calm flight.
    spreads
        Standard deviation of each coefficient about zero, as a prior; infinite if unknown.
    """

    kind: Literal["mean", "rms"]
    floor: float
    spreads: tuple[float, ...]

    def feed(self, rows: Rows) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the regressors (n, m), the response (n,), and the usable rows; the state is updated."""
        ...


class Left(NamedTuple):
    """The residual over the three seconds that end at ``end_s``; NaN if it is not known."""

    end_s: int
    value: float
    deviations: float


class Residual:
    """Tracks the residual of one model."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._design: list[Array] = []
        self._answer: list[Array] = []
        self._rows = 0
        self._window: deque[tuple[float, int]] = deque(maxlen=_OVER_S)
        self._beta: Array | None = None
        self.deviation = np.nan
        self.since_s = 0

    def feed(self, rows: Rows) -> list[Left]:
        """Process rows; return the residuals of their seconds once the reference is complete."""
        if rows.fresh:
            self._window.clear()
        design, answer, good = self._model.feed(rows)
        first = self._wait(rows.second, design, answer, good) if self._beta is None else 0
        seconds = ((k, slice(k * RATE_HZ, (k + 1) * RATE_HZ)) for k in range(first, rows.seconds))
        return [self._second(rows.second + k + 1, design[at], answer[at], good[at]) for k, at in seconds]

    def _wait(self, second: int, design: Array, answer: Array, good: NDArray[np.bool_]) -> int:
        """Collect whole seconds for the reference; return the number of those that it needed."""
        usable = self._rows + good.reshape(-1, RATE_HZ).sum(axis=1).cumsum()
        complete = int(np.searchsorted(usable, REFERENCE_S * RATE_HZ))
        taken = min(complete + 1, len(usable))
        at = np.flatnonzero(good[: taken * RATE_HZ])
        self._design.append(design[at])
        self._answer.append(answer[at])
        self._rows += len(at)
        if complete < len(usable):
            self._refer(second + taken)
        return taken

    def _refer(self, end_s: int) -> None:
        """Fit the reference, which ends with this second, to the collected rows."""
        x, y = np.concatenate(self._design), np.concatenate(self._answer)
        own = self._model.floor
        weights = np.array([own / spread for spread in self._model.spreads]) * np.sqrt(RATE_HZ)
        x_wide = np.vstack([x, np.diag(weights)])
        self._beta = np.linalg.lstsq(x_wide, np.append(y, np.zeros(len(weights))), rcond=None)[0]
        self.deviation = max(float((y - x @ self._beta).std()), own)
        self.since_s = end_s
        self._design.clear()
        self._answer.clear()

    def _second(self, end_s: int, design: Array, answer: Array, good: NDArray[np.bool_]) -> Left:
        assert self._beta is not None
        model = sum((design[:, k] * b for k, b in enumerate(self._beta)), start=np.zeros(len(answer)))
        left = np.where(good, answer - model, 0.0)
        rms = self._model.kind == "rms"
        self._window.append((float((left * left if rms else left).sum()), int(good.sum())))
        total, count = np.array(self._window).sum(axis=0)
        if len(self._window) < _OVER_S or count < _OVER_S * _LEAST_ROWS:
            return Left(end_s, np.nan, np.nan)
        value = float(np.sqrt(total / count)) if rms else float(total / count)
        return Left(end_s, value, abs(value) / self.deviation)
