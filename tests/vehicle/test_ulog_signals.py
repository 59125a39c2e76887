"""Topics of a ULog as signals, in SI units, whatever the firmware's layout."""

from __future__ import annotations

from typing import Any

import numpy as np

from mavhums.log import Table
from mavhums.vehicle.signals import SignalReader
from tests.vehicle.tables import table_of

Fields = list[tuple[Any, ...]]


def table(name: str, fields: Fields, rows: list[tuple[Any, ...]], instance: int = 0, frame: int = 0) -> Table:
    frames = np.arange(len(rows)) + frame
    values = np.array(rows, dtype=fields)
    return table_of(name, values, frame=frames, time_us=1000 * frames, component=instance)


def test_what_came_first_is_taken_from_then_on() -> None:
    reader = SignalReader()
    early = table("vehicle_angular_velocity", [("xyz", "f4", (3,))], [([4, 5, 6],)], instance=2)
    late = table("sensor_combined", [("gyro_rad", "f4", (3,))], [([1, 2, 3],)], frame=9)
    for tables in ({"vehicle_angular_velocity": early, "sensor_combined": late}, {"sensor_combined": late}):
        sources = [s.source for s in reader.read(tables) if s.name == "rates"]
        assert sources in (["vehicle_angular_velocity"], [])
