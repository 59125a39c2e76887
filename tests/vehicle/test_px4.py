"""PX4's outputs on every bus, its parameters in a ULog, its modes and attitude."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from mavhums.log import Decoder
from mavhums.vehicle.parameters import Parameters, control_surfaces, read_parameters
from mavhums.vehicle.states import Attitude, FlightMode, VehicleStates
from tests.log.ulog import writer


@pytest.mark.parametrize(
    ("prefix", "servo", "usual"),
    [
        ("PWM_MAIN", 2, (1000, 1500, 2000)),
        ("PWM_AUX", 18, (1000, 1500, 2000)),
        ("UAVCAN_SV", 34, (0, 500, 1000)),
    ],
)
def test_surfaces_are_found_on_every_bus(prefix: str, servo: int, usual: tuple[int, int, int]) -> None:
    values = {f"{prefix}_FUNC2": 201.0, "CA_SV_CS0_TYPE": 3.0, f"{prefix}_REV": 2.0, f"{prefix}_FUNC1": 101.0}
    [output] = control_surfaces(Parameters(1, True, values))
    assert (output.servo, output.surface, output.pwm_us, output.is_reversed) == (
        servo,
        "elevator",
        usual,
        True,
    )
    assert output.because == f"{prefix}_FUNC2 = 201, CA_SV_CS0_TYPE = 3"
    assert ("CHECK" in output.calibrated_by) or prefix == "PWM_MAIN"


def test_limits_are_those_of_the_bus() -> None:
    values = {"PWM_AUX_FUNC1": 202.0, "CA_SV_CS1_TYPE": 1.0, "PWM_AUX_MIN1": 900.0, "PWM_AUX_MAX1": 2100.0}
    [output] = control_surfaces(Parameters(1, True, values))
    assert output.pwm_us == (900, 1500, 2100)
    assert output.surface == "left aileron"


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
