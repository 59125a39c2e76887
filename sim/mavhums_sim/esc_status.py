"""ESC_INFO (290) and ESC_STATUS (291) of MAVLink's common set, which pymavlink's dialects lack."""

from __future__ import annotations

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class EscStatus(mavlink.MAVLink_message):  # type: ignore[misc, unused-ignore]
    """Speed in rev/min, voltage in V and current in A of ESCs ``index`` … ``index + 3``, signed."""

    id = 291
    msgname = "ESC_STATUS"
    fieldnames = ("index", "time_usec", "rpm", "voltage", "current")
    crc_extra = 10
    wire = struct.Struct("<Q4i4f4fB")

    def __init__(
        self, index: int, time_usec: int, rpm: list[int], voltage: list[float], current: list[float]
    ) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = list(self.fieldnames)
        self.index = index
        self.time_usec = time_usec
        self.rpm = rpm
        self.voltage = voltage
        self.current = current

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame's bytes."""
        payload = self.wire.pack(self.time_usec, *self.rpm, *self.voltage, *self.current, self.index)
        frame: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return frame


class EscInfo(mavlink.MAVLink_message):  # type: ignore[misc, unused-ignore]
    """Count of errors, failure flags and temperature, cdegC, of ESCs 0 … 3."""

    id = 290
    msgname = "ESC_INFO"
    crc_extra = 251
    wire = struct.Struct("<Q4IH4H4h4B")

    def __init__(self, time_usec: int, errors: list[int], flags: list[int], temperature: list[int]) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = ["time_usec", "error_count", "failure_flags", "temperature"]
        self.time_usec, self.error_count = time_usec, errors
        self.failure_flags, self.temperature = flags, temperature

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the frame's bytes."""
        who = (0, 4, 4, 15)  # first ESC, their number, a CAN bus, all of them present
        payload = self.wire.pack(
            self.time_usec, *self.error_count, 0, *self.failure_flags, *self.temperature, *who
        )
        frame: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return frame
