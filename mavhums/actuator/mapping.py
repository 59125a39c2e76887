"""Map message fields to V1–V12 of each actuator, and say where each came from.

The instrumented tier: DEBUG_FLOAT_ARRAY with ``name`` "EMA", ``array_id`` the servo number and
``data[0..11]`` = V1…V12, NaN where not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.clock import SenderClock
from mavhums.actuator.profile import Actuator, Airframe
from mavhums.log import Table
from mavhums.quantities import KEYS

__all__ = ["MESSAGES", "Mapped", "Mapper", "is_instrumented"]

MESSAGES = frozenset({"DEBUG_FLOAT_ARRAY"})


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """New samples of one actuator: ``utc_us`` of shape (n,), ``values`` V1…V12 of shape (n, 12)."""

    vehicle: int
    actuator: Actuator
    utc_us: NDArray[np.int64]
    values: NDArray[np.float64]


def is_instrumented(table: Table) -> NDArray[np.bool_]:
    """Return which rows of a DEBUG_FLOAT_ARRAY table are actuator telemetry, shape (n,)."""
    return np.array(table["name"] == b"EMA")


class Mapper:
    """Maps tables of messages to samples of the profile's actuators, block after block.

    Parameters
    ----------
    airframe
        The profile.
    vehicle
        System id of the vehicle that the profile is for; None if it is for every vehicle.
    from_frame
        Messages before this one are ignored: the profile was not known then.
    """

    def __init__(self, airframe: Airframe, *, vehicle: int | None = None, from_frame: int = 0) -> None:
        self.airframe = airframe
        self._vehicle = vehicle
        self._from_frame = from_frame
        self._by_servo = {actuator.servo: actuator for actuator in airframe.actuators}
        self._clocks: dict[tuple[int, int], SenderClock] = {}
        self._measured: dict[tuple[int, str], NDArray[np.bool_]] = {}

    def feed(self, tables: Mapping[str, Table]) -> list[Mapped]:
        """Return the samples that these messages carry, each actuator's in the order of the log."""
        table = tables.get("DEBUG_FLOAT_ARRAY")
        if table is None:
            return []
        ours = is_instrumented(table) & (table.frame >= self._from_frame)
        if self._vehicle is not None:
            ours &= table.system == self._vehicle
        table = table.select(ours)
        out = []
        for system in np.unique(table.system):
            of_vehicle = table.select(table.system == system)
            utc_us = self._utc(of_vehicle)
            for servo in np.unique(of_vehicle["array_id"]):
                actuator = self._by_servo.get(int(servo))
                if actuator is None:
                    continue
                rows = of_vehicle["array_id"] == servo
                values = of_vehicle["data"][rows, :12].astype(np.float64)
                values[~np.isfinite(values)] = np.nan
                self._note(int(system), actuator, values)
                out.append(Mapped(int(system), actuator, utc_us[rows], values))
        return out

    def serves(self, vehicle: int | None) -> bool:
        """Return whether the profile is for this vehicle."""
        return self._vehicle is None or self._vehicle == vehicle

    def provenance(self, vehicle: int, actuator: Actuator) -> dict[str, str]:
        """Return the message field behind each quantity that was measured so far."""
        measured = self._measured.get((vehicle, actuator.name), np.zeros(len(KEYS), dtype=bool))
        return {
            key: f"DEBUG_FLOAT_ARRAY[EMA,{actuator.servo}].data[{k}]"
            for k, key in enumerate(KEYS)
            if measured[k]
        }

    def clock_segments(self, vehicle: int) -> int:
        """Return how many segments the vehicle's clock has had; more than one is a reboot or a jump."""
        return max((clock.segments for key, clock in self._clocks.items() if key[0] == vehicle), default=0)

    def _utc(self, table: Table) -> NDArray[np.int64]:
        utc_us = np.empty(len(table), dtype=np.int64)
        sent_us = table["time_usec"].astype(np.int64)
        for component in np.unique(table.component):
            rows = table.component == component
            key = (int(table.system[0]), int(component))
            clock = self._clocks.setdefault(key, SenderClock())
            utc_us[rows] = clock.to_utc_us(sent_us[rows], table.time_us[rows])
        return utc_us

    def _note(self, vehicle: int, actuator: Actuator, values: NDArray[np.float64]) -> None:
        seen = np.isfinite(values).any(axis=0)
        key = (vehicle, actuator.name)
        self._measured[key] = self._measured.get(key, np.zeros_like(seen)) | seen
