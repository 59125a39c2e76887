"""The log, read back with pymavlink: nothing lost, every quantity within its message's resolution."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink import mavutil

from mavhums_sim import FlightRecord, write_tlog
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.flight import Flight, fly
from mavhums_sim.link import EPOCH_US
from mavhums_sim.sensors import AMBIENT_C, winding_temperature
from mavhums_sim.telemetry import MESSAGES, messages

BOOT_S = 30.0
Read = dict[str, list[Any]]


@pytest.fixture(scope="module")
def record() -> FlightRecord:
    return fly(Flight(seed=21, duration_s=12.0, friction_nm={"elevator": (0.3, 0.9)}))


def read_back(path: Path) -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAVLINK20", "1")
        patch.setenv("MAVLINK_DIALECT", "ardupilotmega")
        connection = mavutil.mavlogfile(str(path))
        while (message := connection.recv_msg()) is not None:
            yield message
        connection.f.close()


@pytest.fixture(scope="module")
def written(record: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, int], Read]:
    path = tmp_path_factory.mktemp("log") / "flight.tlog"
    counts = write_tlog(record, path)
    read: Read = {}
    for message in read_back(path):
        read.setdefault(message.get_type(), []).append(message)
    return counts, read


def column(rows: list[Any], name: str) -> NDArray[np.float64]:
    return np.array([getattr(row, name) for row in rows], dtype=np.float64)


def test_pymavlink_reads_the_counts_that_were_written(written: tuple[dict[str, int], Read]) -> None:
    counts, read = written
    assert {name: len(rows) for name, rows in read.items()} == counts
    assert set(counts) == set(MESSAGES)


def test_sequence_is_unbroken_and_time_never_steps_back(written: tuple[dict[str, int], Read]) -> None:
    rows = sorted((m for rows in written[1].values() for m in rows), key=lambda m: m._timestamp)
    times = np.array([m._timestamp for m in rows])
    assert times[0] >= EPOCH_US / 1e6
    assert Counter(m.get_seq() for m in rows).most_common(1)[0][1] <= len(rows) // 256 + 1


def test_instrumented_tier_is_the_record_in_single_precision(
    record: FlightRecord, written: tuple[dict[str, int], Read]
) -> None:
    for servo, surface in enumerate(SURFACES, start=1):
        rows = [m for m in written[1]["DEBUG_FLOAT_ARRAY"] if m.array_id == servo]
        assert {m.name for m in rows} == {"EMA"}
        sent = record.actuators[surface]
        got = np.array([m.data[:12] for m in rows])
        np.testing.assert_array_equal(got, sent.values.astype(np.float32))
        stamps = column(rows, "time_usec") / 1e6 - BOOT_S
        np.testing.assert_allclose(stamps, sent.time_s, atol=0.51e-6)


def test_servo_outputs_are_the_command_to_the_microsecond(
    record: FlightRecord, written: tuple[dict[str, int], Read]
) -> None:
    rows = written[1]["SERVO_OUTPUT_RAW"]
    times = column(rows, "time_usec") / 1e6 - BOOT_S
    for servo, surface in enumerate(SURFACES, start=1):
        motion = record.actuators[surface].motion
        command = np.interp(times, motion.time_s, np.degrees(motion.command))
        pulse = column(rows, f"servo{servo}_raw")
        assert np.abs((pulse - 1500) * 0.12 - command).max() <= 0.0601


def test_esc_telemetry_is_the_magnitude_to_its_resolution(
    record: FlightRecord, written: tuple[dict[str, int], Read]
) -> None:
    """The message carries no time: the k-th row is the k-th sending of the stream."""
    rows = written[1]["ESC_TELEMETRY_1_TO_4"]
    times = np.array([t for t, m in messages(record) if m.get_type() == "ESC_TELEMETRY_1_TO_4"])
    for esc, surface in enumerate(SURFACES):
        actuator = record.actuators[surface]
        for name, v, resolution in (("voltage", 3, 0.01), ("current", 4, 0.01), ("rpm", 6, 1.0)):
            sent = np.interp(times, actuator.time_s, np.abs(actuator.values[:, v]))
            got = np.array([getattr(m, name)[esc] for m in rows]) * resolution
            assert np.abs(got - sent).max() <= 0.501 * resolution


def test_aircraft_state_is_the_cyclograms(record: FlightRecord, written: tuple[dict[str, int], Read]) -> None:
    flown, read = record.cyclogram, written[1]
    times = column(read["ATTITUDE"], "time_boot_ms") / 1e3 - BOOT_S
    for name, truth in (("roll", flown.roll), ("pitch", flown.pitch), ("yaw", flown.yaw)):
        got = column(read["ATTITUDE"], name)
        np.testing.assert_allclose(got, np.interp(times, flown.time_s, truth), atol=1e-3)
    assert column(read["VFR_HUD"], "airspeed").max() == pytest.approx(flown.airspeed.max(), abs=0.5)
    assert column(read["BATTERY_STATUS"], "current_battery").min() >= 0
    assert read["BATTERY_STATUS"][0].voltages[0] == 27_000


def test_a_winding_heats_by_its_current_and_the_esc_reports_it(
    record: FlightRecord, written: tuple[dict[str, int], Read]
) -> None:
    actuator, parameters = record.actuators["rudder"], record.flight.parameters
    current = np.full_like(actuator.motion.current, 1.1)
    for own, worse in ((1.0, 1.0), (1.1, 1.0), (1.0, 2.0)):
        worn = replace(actuator.motion.degradation, resistance_factor=np.full_like(current, worse))
        heated = replace(actuator.motion, current=current, degradation=worn)
        sized = replace(parameters, resistance=own * parameters.resistance)
        settled = 8.0 * 1.1**2 * sized.resistance * worse  # R_th·I²·R
        wanted = AMBIENT_C + settled * -np.expm1(-heated.time_s / 300.0)
        np.testing.assert_allclose(winding_temperature(heated, sized), wanted, atol=1e-6)
    times = np.array([t for t, m in messages(record) if m.get_type() == "ESC_TELEMETRY_1_TO_4"])
    for esc, surface in enumerate(SURFACES):
        got = np.array([m.temperature[esc] for m in written[1]["ESC_TELEMETRY_1_TO_4"]])
        assert np.abs(got - record.actuators[surface].temperature(parameters, times)).max() <= 0.5


def test_the_fixes_follow_the_flight_and_the_supply_is_one(
    record: FlightRecord, written: tuple[dict[str, int], Read]
) -> None:
    flown, fixes = record.cyclogram, written[1]["GPS_RAW_INT"]
    times = column(fixes, "time_usec") / 1e6 - BOOT_S
    north, east = np.diff([column(fixes, "lat"), column(fixes, "lon") * np.cos(np.radians(47.0))]) * 1e-7
    path = 111_320.0 * np.hypot(north, east).sum()
    between = (flown.time_s >= times[0]) & (flown.time_s <= times[-1])
    assert path == pytest.approx((flown.airspeed * np.cos(flown.pitch))[between].sum() * 1e-3, rel=0.01)
    height = np.interp(times, flown.time_s, flown.altitude)
    np.testing.assert_allclose(column(fixes, "alt") / 1e3 - 400.0, height, atol=1e-3)
    np.testing.assert_allclose(
        column(fixes, "vel"), 100 * np.interp(times, flown.time_s, flown.airspeed), rtol=0.05
    )
    volts = {m.voltage_battery for m in written[1]["SYS_STATUS"]}
    assert volts == {m.voltages[0] for m in written[1]["BATTERY_STATUS"]} == {27_000}


def test_log_names_its_airframe_and_its_servos(written: tuple[dict[str, int], Read]) -> None:
    said = {m.text for m in written[1]["STATUSTEXT"]}
    assert said == {"mavhums airframe=paper", "SimBoard 4D415648 554D5353 494D0001"}
    parameters = {m.param_id: m.param_value for m in written[1]["PARAM_VALUE"]}
    assert [parameters[f"SERVO{k}_FUNCTION"] for k in (1, 2, 3, 4)] == [4, 4, 19, 21]


def test_same_flight_writes_the_same_bytes(record: FlightRecord, tmp_path: Path) -> None:
    one, other = tmp_path / "one.tlog", tmp_path / "other.tlog"
    write_tlog(record, one)
    write_tlog(record, other)
    assert one.read_bytes() == other.read_bytes()
