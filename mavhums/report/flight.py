"""Which flight a log is of, so that two recordings of one flight count once."""

from __future__ import annotations

from datetime import datetime

from mavhums.core.models import Contract

__all__ = ["FlightIdentity"]

_CLOCKS_APART_S = 30.0


class FlightIdentity(Contract):
    """Which flight a log is of, so that two recordings of it count once.

    Attributes
    ----------
    vehicle
        Its id on MAVLink.
    board
        Unique id of its autopilot's board, or the operator's serial number; None if the log tells neither.
    boot_utc
        When the autopilot was switched on; None if the log tells no date.
    start_utc, end_utc
        Of the log; None if it tells no date.

    Examples
    --------
    >>> sent = FlightIdentity(vehicle=1, board="0A", boot_utc="2026-01-01T09:00:00+00:00")
    >>> logged = sent.model_copy(update={"boot_utc": "2026-01-01T09:00:02+00:00"})
    >>> sent.is_same(logged), sent.is_same(logged.model_copy(update={"board": None}))
    (True, False)
    """

    vehicle: int
    board: str | None = None
    boot_utc: str | None = None
    start_utc: str | None = None
    end_utc: str | None = None

    def is_same(self, other: FlightIdentity) -> bool:
        """Return whether both are recordings of one flight: the same known board and the same boot time.

        The clocks of a ground station and of a satellite receiver may differ by half a minute.
        """
        if self.board is None or self.board != other.board or None in (self.boot_utc, other.boot_utc):
            return False
        boots = [datetime.fromisoformat(str(each.boot_utc)) for each in (self, other)]
        return abs((boots[0] - boots[1]).total_seconds()) <= _CLOCKS_APART_S
