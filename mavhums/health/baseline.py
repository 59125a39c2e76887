"""An actuator's own baseline: what its indicators were in the flights before.

Individuals differ far more than one actuator does from flight to flight, so a change against
the own baseline shows wear long before a limit for all of a type does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mavhums.assessment import Indicator

__all__ = ["Baseline", "Baselines"]


@dataclass(frozen=True, slots=True)
class Baseline:
    """One indicator of one actuator over its reference flights.

    Attributes
    ----------
    mean
        Of the flights' values, each flight counting alike.
    flights, between
        Number of flights, at least two, and the standard deviation of their values.
    windows, within
        Number of windows in all of them, and the pooled standard deviation of the windows of a flight.
    """

    mean: float
    flights: int
    between: float
    windows: int
    within: float

    @classmethod
    def of(cls, indicators: Sequence[Indicator]) -> Baseline | None:
        """Return the baseline of several flights; None of fewer than two that show their scatter."""
        shown = [(i.value.estimate, i.windows, i.scatter) for i in indicators if i.scatter is not None]
        if len(shown) < 2:
            return None
        values, windows, scatter = (np.array(column, dtype=np.float64) for column in zip(*shown, strict=True))
        freedom = windows - 1
        return cls(
            mean=float(values.mean()),
            flights=len(shown),
            between=float(values.std(ddof=1)),
            windows=int(windows.sum()),
            within=float(np.sqrt(np.sum(freedom * scatter**2) / freedom.sum())),
        )


Baselines = Mapping[tuple[int, str, str], Baseline]
"""Baselines by vehicle, actuator and fault."""
