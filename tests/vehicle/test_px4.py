"""Parameters in a ULog."""

from __future__ import annotations

from pathlib import Path

from mavhums.vehicle.parameters import read_parameters
from tests.log.ulog import writer


def test_parameters_of_a_ulog_are_numbers_and_the_last_counts(tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(writer.flight(3.0))
    parameters = read_parameters(path)
    assert parameters.is_px4
    assert parameters.vehicle == 7
    assert dict(parameters.values) == {"MAV_SYS_ID": 7, "PWM_MAIN_MIN1": 1050, "CA_SV0_TRQ_R": -0.5}
