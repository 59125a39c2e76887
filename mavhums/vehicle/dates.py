"""The date of a flight: of the sources that have one, the first whose date can be counts.

In order: the times of the log (of reception, or of the satellites on board), with the step of a receiver's
clock that was set while it recorded; then the vehicle's own clocks; then the log's file, which is said.
A log that no file holds and no clock dates has no date.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from mavhums.log.base.times import is_date

_NAMED: Final = re.compile(r"(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]+(\d\d)[-_.:]?(\d\d)[-_.:]?(\d\d)(?!\d)")
"""A date with its time of day, as loggers and ground stations name their files."""


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


def date_of_file(path: str, duration_s: float) -> tuple[datetime, str] | None:
    """Return when the log in a file began, by its name or else by its time, and that this is so.

    None if there is no such file, and no date in its name.

    Examples
    --------
    >>> began, said = date_of_file("2022-05-24_15-52-12.tlog", 60.0)
    >>> began.isoformat(), said.partition(":")[0]
    ('2022-05-24T15:52:12+00:00', 'dated by the name of its file')
    """
    said = "dated by the {} of its file: the log has no date"
    if match := _NAMED.search(Path(path).name):
        try:
            return datetime(*map(int, match.groups()), tzinfo=UTC), said.format("name")  # type: ignore[misc,arg-type]
        except ValueError:  # no such day
            pass
    try:
        ended_s = Path(path).stat().st_mtime
    except (OSError, ValueError):
        return None
    if not is_date((ended_s - duration_s) * 1e6):
        return None
    return datetime.fromtimestamp(ended_s - duration_s, UTC), f"{said.format('time')}; copying may change it"
