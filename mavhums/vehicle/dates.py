"""The date of a flight: of the sources that have one, the first whose date can be counts.

In order: the times of the log (of reception, or of the satellites on board), with the step of a receiver's
clock that was set while it recorded; then the vehicle's own clocks. A log without either has no date.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from mavhums.log.base.times import is_date


class BootTimes(NamedTuple):
    """A vehicle's boot by its own date, and by the log's times less its uptime, µs; None where not known."""

    dated_us: int | None
    logged_us: int | None


def date_shift_us(first_us: int, ahead_us: int | None, boots: Iterable[BootTimes]) -> int | None:
    """Return what must be added to a log's times for UTC, microseconds; None if nothing dates it.

    Parameters
    ----------
    first_us
        The log's first time.
    ahead_us
        By how much the clock of the log's times was set later; None if they count from boot.
    boots
        Of its vehicles.

    Examples
    --------
    >>> date_shift_us(1_700_000_000_000_000, 0, ()), date_shift_us(5, 0, ()), date_shift_us(5, None, ())
    (0, None, None)
    >>> date_shift_us(5_000_000, 0, [BootTimes(1_700_000_000_000_000, 2_000_000)])
    1699999998000000
    """
    if ahead_us is not None and is_date(first_us + ahead_us):
        return ahead_us
    shifts = (
        dated - logged for dated, logged in boots if dated is not None and logged is not None
    )  # the two clocks name one moment
    return next((shift for shift in shifts if is_date(first_us + shift)), None)
