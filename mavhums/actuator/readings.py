"""Values of one actuator from one source, before alignment with other sources."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import KEYS

__all__ = ["Reading", "blank"]


class Reading(NamedTuple):
    """New values from one source: an instance of a message.

    Attributes
    ----------
    source
        Name of the source in verdicts, for example ``DEBUG_FLOAT_ARRAY[EMA,3]``.
    tier
        Name of the telemetry tier.
    fields
        Message field of each quantity that the source can give, by key.
    frame
        Positions of the messages in the log, shape (n,), increasing.
    utc_us
        Times, microseconds of UTC, shape (n,).
    values
        V1…V12, shape (n, 12); NaN for quantities that are not given.
    signed
        Whether the values are signed; otherwise they are magnitudes.
    """

    vehicle: int
    actuator: Actuator
    source: str
    tier: str
    fields: dict[str, str]
    frame: NDArray[np.int64]
    utc_us: NDArray[np.int64]
    values: NDArray[np.float64]
    signed: bool = True


def blank(columns: Sequence[int], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return V1…V12, shape (n, 12), with the values (n, k) in the given columns and NaN elsewhere."""
    out = np.full((len(values), len(KEYS)), np.nan)
    out[:, columns] = values
    return out
