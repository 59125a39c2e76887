"""Cut an actuator's samples into slots of one second, however they arrive.

What a slot holds depends on the samples and their order alone, never on how the log was cut into
blocks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["Slot", "SlotCutter"]


@dataclass(frozen=True, slots=True, eq=False)
class Slot:
    """The samples of one second, after the last two of the slot before.

    Every sample but the first and the last has a neighbour on either side, for differences; the
    last is judged with the next slot.

    Attributes
    ----------
    index
        The slot covers flight times from ``index`` to ``index + 1`` seconds.
    time_s, values
        Shapes (n,) and (n, 12), increasing in time.
    """

    index: int
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]


class SlotCutter:
    """Collects samples and yields each slot once nothing more is expected for it.

    Parameters
    ----------
    lateness_s
        How long after its end a slot still waits for what was overtaken.

    Attributes
    ----------
    late
        Number of samples that came after their slot was closed; they are left out.
    latest_s
        Flight time of the latest sample; minus infinity before the first.
    """

    def __init__(self, lateness_s: float = 0.0) -> None:
        self.late = 0
        self._lateness_s = lateness_s
        self._times: list[NDArray[np.float64]] = []
        self._values: list[NDArray[np.float64]] = []
        self.latest_s = -np.inf
        self._closed = -np.inf
        self._before = (np.empty(0), np.empty((0, 12)))

    def feed(self, time_s: NDArray[np.float64], values: NDArray[np.float64]) -> Iterator[Slot]:
        """Yield the slots that these samples complete; ``time_s`` (n,) and ``values`` (n, 12)."""
        if time_s.size == 0:
            return
        latest = np.maximum.accumulate(np.concatenate([[self.latest_s], time_s]))
        in_time = time_s >= np.floor(latest[:-1] - self._lateness_s)
        self.late += int(np.count_nonzero(~in_time))
        self._times.append(time_s[in_time])
        self._values.append(values[in_time])
        self.latest_s = float(latest[-1])
        horizon = np.floor(self.latest_s - self._lateness_s)
        if horizon > self._closed:
            self._closed = horizon
            yield from self._close(horizon)

    def finish(self) -> Iterator[Slot]:
        """Yield what is left, the last slot possibly not full."""
        yield from self._close(np.inf)

    def _close(self, horizon: float) -> Iterator[Slot]:
        if not self._times:
            return
        time_s, first = np.unique(np.concatenate(self._times), return_index=True)
        values = np.concatenate(self._values)[first]
        done = int(np.searchsorted(time_s, horizon))
        self._times, self._values = [time_s[done:]], [values[done:]]
        slots = np.floor(time_s[:done]).astype(np.int64)
        bounds = [*np.flatnonzero(np.diff(slots, prepend=slots[:1] - 1)), done]
        for start, end in pairwise(bounds):
            whole_t = np.concatenate([self._before[0], time_s[start:end]])
            whole_v = np.concatenate([self._before[1], values[start:end]])
            yield Slot(int(slots[start]), whole_t, whole_v)
            self._before = whole_t[-2:], whole_v[-2:]
