"""Which flight a log is of, so that two recordings of one flight count once."""

from __future__ import annotations

from datetime import datetime

from mavhums.core.models import Contract

__all__ = ["CLOCKS_APART_S", "FlightCopy", "FlightIdentity"]

CLOCKS_APART_S = 30.0
"""Two recordings of one flight differ by at most this much in the boot time."""


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
    aircraft
        Name of the aircraft by the operator's table or rule; None if they name none.

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
    aircraft: str | None = None

    def is_same(self, other: FlightIdentity) -> bool:
        """Return whether both are recordings of one flight.

        They are if vehicle, known board and boot time agree, and the shorter recording lies at least half
        within the longer one. An aircraft may fly several times without being switched off, and each flight
        may have its own log; then the boot times agree, but the recordings do not overlap.

        The clocks of a ground station and of a satellite receiver may differ by half a minute. Therefore the
        overlap is that of the times since boot, from which the difference of the clocks cancels.
        """
        if self.board is None or (self.vehicle, self.board) != (other.vehicle, other.board):
            return False
        if self.boot_utc is None or other.boot_utc is None:
            return False
        boots = datetime.fromisoformat(self.boot_utc), datetime.fromisoformat(other.boot_utc)
        if abs((boots[0] - boots[1]).total_seconds()) > CLOCKS_APART_S:
            return False
        return _overlap(self._since_boot(boots[0]), other._since_boot(boots[1]))

    def _since_boot(self, boot: datetime) -> tuple[float, float] | None:
        """Return start and end of the log, seconds since boot; None if they are unknown."""
        if self.start_utc is None or self.end_utc is None:
            return None
        start, end = datetime.fromisoformat(self.start_utc), datetime.fromisoformat(self.end_utc)
        return (start - boot).total_seconds(), (end - boot).total_seconds()


class FlightCopy(Contract):
    """Another log of the same flight of a vehicle.

    Attributes
    ----------
    vehicle
        Its id on MAVLink.
    log, sha256
        Path and hash of the other log; None if they are unknown.
    counts
        Whether the other log counts rather than this one.
    """

    vehicle: int
    log: str | None
    sha256: str | None
    counts: bool


def _overlap(one: tuple[float, float] | None, other: tuple[float, float] | None) -> bool:
    """Return whether the shorter of two spans lies at least half within the other."""
    if one is None or other is None:
        return True
    common = min(one[1], other[1]) - max(one[0], other[0])
    shorter = min(one[1] - one[0], other[1] - other[0])
    return common >= 0.0 and 2.0 * common >= shorter
