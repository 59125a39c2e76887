"""The board and the boot time of a vehicle, which distinguish two recordings of one flight from two flights.

The board's unique id is in AUTOPILOT_VERSION and in a text that ArduPilot sends and logs, as the same
hexadecimal digits: 12 bytes for ArduPilot, 18 for PX4, whose ULog contains them as sys_uuid. If there is no
id, the operator's serial number (BRD_SERIAL_NUM) replaces it. ArduPilot's simulator (SITL) sends the id of
its machine, with the number of the simulated vehicle in the first byte. The boot time is the difference
between the log's dates and the vehicle's own clock.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from mavhums.log import Table
from mavhums.vehicle.texts import texts

__all__ = ["RECORDED_MESSAGES", "Recorded", "RecordedFlights"]

RECORDED_MESSAGES: Final = frozenset(
    {"AUTOPILOT_VERSION", "SYSTEM_TIME", "ATTITUDE", "PARAM_VALUE", "PARM", "STATUSTEXT", "MSG"}
    | {"info", "vehicle_status"}
)
"""Messages that tell."""

_BOARD: Final = re.compile(r"\S+ ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})")
_SIMULATED: Final = re.compile(r"(.?)([0-9a-f]{31})", re.DOTALL)
_UID_BYTES: Final = 12
_PX4_BOARD: Final = b"sys_uuid"
_SERIAL: Final = b"BRD_SERIAL_NUM"
_GPS_LIVES_US: Final = 1_262_304_000_000_000  # 2010
_CLOCKS: Final = {
    "ATTITUDE": ("time_boot_ms", 1000),
    "MSG": ("TimeUS", 1),
    "PARM": ("TimeUS", 1),
    "vehicle_status": ("timestamp", 1),
}


class Recorded(NamedTuple):
    """A board's unique id, and UTC at its boot in microseconds; None if the log does not contain it."""

    board: str | None
    boot_us: int | None


class RecordedFlights:
    """Follows the boards and boot times of the vehicles of a log, block by block.

    The first value of each counts.
    """

    def __init__(self) -> None:
        self._boards: dict[int, str] = {}
        self._serials: dict[int, str] = {}
        self._boots: dict[int, int] = {}
        self._rough_boots: dict[int, int] = {}

    def feed(self, tables: Mapping[str, Table]) -> None:
        """Take tables of messages."""
        for said in texts(tables):
            board = _board_in(said.text)
            if board is not None:
                self._boards.setdefault(said.vehicle, board)
        version = tables.get("AUTOPILOT_VERSION")
        if version is not None:
            ids = zip(version.system.tolist(), version["uid2"], version["uid"].tolist(), strict=True)
            for system, uid2, uid in ids:
                if uid2.any():
                    own = uid2 if uid2[_UID_BYTES:].any() else uid2[:_UID_BYTES]
                    self._boards.setdefault(system, own.tobytes().hex().upper())
                elif uid:
                    self._boards.setdefault(system, f"{uid:016X}")
        info = tables.get("info")
        if info is not None and info.holds_text("name") and info.holds_text("value"):
            told = info.select(info["name"] == _PX4_BOARD)
            for system, uuid in zip(told.system.tolist(), told.texts("value"), strict=True):
                self._boards.setdefault(system, uuid.upper())
        for message, name, value in (("PARAM_VALUE", "param_id", "param_value"), ("PARM", "Name", "Value")):
            table = tables.get(message)
            if table is not None:
                told = table.select(table[name] == _SERIAL)
                for system, number in zip(told.system.tolist(), told[value].tolist(), strict=True):
                    if number > 0:
                        self._serials.setdefault(system, f"serial {number:.0f}")
        self._date(tables)

    def of(self, vehicle: int) -> Recorded:
        """Return the board and the boot time of a vehicle, as known so far."""
        board = self._boards.get(vehicle, self._serials.get(vehicle))
        return Recorded(board, self._boots.get(vehicle, self._rough_boots.get(vehicle)))

    def _date(self, tables: Mapping[str, Table]) -> None:
        gps = tables.get("SYSTEM_TIME")
        if gps is not None:
            living = gps.select(gps["time_unix_usec"] > _GPS_LIVES_US)
            boots = living["time_unix_usec"].astype(np.int64) - living["time_boot_ms"].astype(np.int64) * 1000
            _keep_first(self._boots, living, boots)
        for message, (field, scale) in _CLOCKS.items():
            table = tables.get(message)
            if table is not None and table.holds({field: 1}):
                boots = table.time_us - table[field].astype(np.int64) * scale
                _keep_first(self._rough_boots, table, boots)


def _board_in(text: str) -> str | None:
    """Return the unique id of a board in a text of the autopilot; None if it has none.

    Examples
    --------
    >>> _board_in("CubeOrange 00112233 44556677 8899AABB"), _board_in("Vd1219c7c4c5404aaa1f6d2a48adfda4")
    ('00112233445566778899AABB', 'SITL 56 D1219C7C4C5404AAA1F6D2A48ADFDA4')
    """
    match = _BOARD.fullmatch(text.strip())
    if match:
        return "".join(match.groups())
    match = _SIMULATED.fullmatch(text)
    return f"SITL {ord(match[1] or ' '):02X} {match[2].upper()}" if match else None


def _keep_first(
    known: dict[int, int], table: Table, boots: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> None:
    for vehicle, row in zip(*np.unique(table.system, return_index=True), strict=True):
        known.setdefault(int(vehicle), int(boots[row]))
