"""The times that can be: a log's numbers are arbitrary, and every time in them passes here once."""

from __future__ import annotations

from typing import Any, Final

from mavhums.core.kernels import inlined

YEAR_2010_US: Final = 1_262_304_000_000_000
"""Before, nobody recorded these formats: a receiver whose week number rolled over, or no clock at all."""

YEAR_2100_US: Final = 4_102_444_800_000_000


@inlined
def plausible(time_us: Any) -> Any:
    """Return whether a time since boot, or since 1970, can be: it lies between 1970 and 2100."""
    return (time_us >= 0) & (time_us < YEAR_2100_US)


def is_date(utc_us: Any) -> Any:
    """Return whether a vehicle may have flown at this time, microseconds of UTC; times may be an array.

    Examples
    --------
    >>> is_date(1_700_000_000_000_000), is_date(10**18), is_date(0)
    (True, False, False)
    """
    return (utc_us > YEAR_2010_US) & (utc_us < YEAR_2100_US)
