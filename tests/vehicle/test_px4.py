"""PX4's outputs on every bus, its parameters in a ULog, its modes and attitude."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from mavhums.log import Decoder
from mavhums.vehicle.parameters import read_parameters
from mavhums.vehicle.states import Attitude, FlightMode, VehicleStates
from tests.log.ulog import writer


def test_parameters_of_a_ulog_are_numbers_and_the_last_counts(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(writer.flight(3.0))
    parameters = read_parameters(path)
    assert parameters.is_px4
    assert parameters.vehicle == 7
    assert dict(parameters.values) == {"MAV_SYS_ID": 7, "PWM_MAIN_MIN1": 1050, "CA_SV0_TRQ_R": -0.5}


def test_modes_and_attitude_of_a_ulog_are_the_vehicles() -> None:
    status = writer.form("vehicle_status", "uint64_t timestamp;uint8_t nav_state;")
    modes = [0, 0, 3, 3, 77]
    turn = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    log = writer.header() + status + writer.form("vehicle_attitude", writer.FLIGHT["vehicle_attitude"])
    log += writer.subscribe(1, "vehicle_status") + writer.subscribe(2, "vehicle_attitude")
    log += b"".join(writer.data(1, struct.pack("<QB", 1_000_000 + k, m)) for k, m in enumerate(modes))
    log += b"".join(writer.data(2, struct.pack("<Q4f", 1_000_000 + k, *turn)) for k in range(3))
    tables = Decoder().feed(log, final=True)
    events = list(VehicleStates().feed(tables, start_us=1_000_000))
    assert [e.mode for e in events if isinstance(e, FlightMode)] == ["MANUAL", "MISSION", "Mode(77)"]
    [attitude] = [e for e in events if isinstance(e, Attitude)]
    assert attitude.roll_pitch_yaw_rad == pytest.approx(np.tile([0.0, 0.0, np.pi / 2], (3, 1)), abs=1e-6)
