"""Topics of a ULog as signals, in SI units, whatever the firmware's layout."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mavhums.log import Table
from mavhums.vehicle.facts import CONTINUOUS, STEPPED, Signal
from mavhums.vehicle.signals import SignalReader
from tests.vehicle.tables import table_of

Fields = list[tuple[Any, ...]]


def table(name: str, fields: Fields, rows: list[tuple[Any, ...]], instance: int = 0, frame: int = 0) -> Table:
    frames = np.arange(len(rows)) + frame
    values = np.array(rows, dtype=fields)
    return table_of(name, values, frame=frames, time_us=1000 * frames, component=instance)


def signals(*tables: Table) -> dict[str, Signal]:
    """Return the preferred source of each signal."""
    found = sorted(SignalReader().read({t.name: t for t in tables}), key=lambda one: -one.rank)
    return {signal.name: signal for signal in found}


def test_every_topic_gives_its_signal() -> None:
    half = np.sqrt(0.5)
    found = signals(
        table("actuator_outputs", [("output", "f4", (16,))], [([1500.0, 900.0, 0.0, *[2500.0] * 13],)]),
        table(
            "sensor_combined",
            [("gyro_rad", "f4", (3,)), ("accelerometer_m_s2", "f4", (3,))],
            [([1, 2, 3], [0, 0, -9.5])],
        ),
        table("vehicle_angular_velocity", [("xyz", "f4", (3,))], [([4, 5, 6],)], frame=5),
        table("vehicle_attitude", [("q", "f4", (4,))], [([half, half, 0, 0],)]),
        table("vehicle_attitude_setpoint", [("q_d", "f4", (4,))], [([half, 0, half, 0],)]),
        table("airspeed", [("indicated_airspeed_m_s", "f4")], [(17.0,)]),
        table(
            "vehicle_local_position",
            [("vx", "f4"), ("vy", "f4"), ("vz", "f4"), ("z", "f4")],
            [(3.0, 4.0, -1.0, -50.0)],
        ),
        table(
            "vehicle_status",
            [("arming_state", "u1"), ("system_type", "u1"), ("nav_state", "u1")],
            [(2, 1, 3), (1, 1, 4)],
        ),
        table("vtol_vehicle_status", [("vehicle_vtol_state", "u1")], [(4,)]),
        table("vehicle_land_detected", [("landed", "u1")], [(1,), (0,)]),
        table("input_rc", [("values", "u2", (18,))], [([1500, 1400, *[0] * 16],)]),
    )
    # PX4's commands to the mixer are of another scale, its altitude error is not read, and each airspeed
    # says itself whether it is a sensor's.
    absent = {"outputs_2", "outputs_3", "mixer", "altitude error", "airspeed sensor"}
    assert found.keys() == {*CONTINUOUS, *STEPPED} - absent
    for name, width in ((name, {**CONTINUOUS, **STEPPED}[name]) for name in found):
        assert found[name].values.shape[1] == width, name
    assert found["outputs"].values[0, :2].tolist() == [1500.0, 900.0]
    assert np.isnan(found["outputs"].values[0, 2:]).all()
    assert found["receiver"].values[0, :2].tolist() == [1500.0, 1400.0]
    assert found["rates"].values.tolist() == [[1, 2, 3]]
    assert found["attitude"].values[0] == pytest.approx([np.pi / 2, 0, 0], abs=1e-6)
    assert found["demand"].values[0] == pytest.approx([0, np.pi / 2], abs=1e-3)
    assert found["velocity"].values.tolist() == [[3.0, 4.0, -1.0]]
    assert found["groundspeed"].values.tolist() == [[5.0]]
    assert found["altitude"].values.tolist() == [[50.0]]
    assert found["state"].values.tolist() == [[1, 12, 1, 3], [1, 12, 0, 4]]
    assert found["landed"].values.tolist() == [[1], [2]]
    assert found["outputs"].source == "actuator_outputs"


def test_older_layouts_give_the_same() -> None:
    found = signals(
        table(
            "vehicle_attitude",
            [("rollspeed", "f4"), ("pitchspeed", "f4"), ("yawspeed", "f4")],
            [(0.1, 0.2, 0.3)],
        ),
        table("vehicle_attitude_setpoint", [("roll_body", "f4"), ("pitch_body", "f4")], [(0.5, 0.25)]),
    )
    assert found["rates"].values[0] == pytest.approx([0.1, 0.2, 0.3])
    assert found["demand"].values.tolist() == [[0.5, 0.25]]


def test_what_came_first_is_taken_from_then_on() -> None:
    reader = SignalReader()
    early = table("vehicle_angular_velocity", [("xyz", "f4", (3,))], [([4, 5, 6],)], instance=2)
    late = table("sensor_combined", [("gyro_rad", "f4", (3,))], [([1, 2, 3],)], frame=9)
    for tables in ({"vehicle_angular_velocity": early, "sensor_combined": late}, {"sensor_combined": late}):
        sources = [s.source for s in reader.read(tables) if s.name == "rates"]
        assert sources in (["vehicle_angular_velocity"], [])


def test_outputs_of_another_driver_and_odd_layouts_are_none() -> None:
    aux = table("actuator_outputs", [("output", "f4", (16,))], [([1500.0] * 16,)], instance=2)
    odd = table("vehicle_attitude", [("q", "f4", (3,))], [([1, 0, 0],)])
    text = table("airspeed", [("indicated_airspeed_m_s", "S4")], [(b"fast",)])
    assert signals(aux, odd, text) == {}
