"""Every message's facts in SI units, against the units in MAVLink's, ArduPilot's and PX4's definitions."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2
from pymavlink.mavutil import mode_string_v10

from mavhums.log import Table
from mavhums.log.base.decoder import LOOSE_TIME
from mavhums.vehicle.facts import ServoIds
from mavhums.vehicle.formats import FORMATS, SERVO_SOURCES, dataflash, mavlink, reports, servo_readings, ulog
from tests.vehicle.tables import table_of

NAN, QUARTER, G = np.nan, np.pi / 2, 9.80665
HALF = np.sqrt(0.5)
UNIX_2020_US = 1_577_836_800_000_000


def table(message: str, fields: dict[str, Any], component: int = 1, flags: int = 0) -> Table:
    """Return a table of one row."""
    arrays = {name: np.asarray(value) for name, value in fields.items()}
    kinds = [(name, value.dtype, value.shape) for name, value in arrays.items()]
    row = np.array([tuple(value.tolist() for value in arrays.values())], dtype=kinds)
    return table_of(message, row, component=component, flags=flags)


def fact(name: str, *tables: Table) -> Any:
    """Return the value of a fact in each of these messages; an empty list without it."""
    return [report.values[0].tolist() for one in tables for report in reports({one.name: one}, name)]


OUTPUTS = {f"servo{n}_raw": 1000 + n for n in range(1, 17)}
GYRO = {"xgyro": 100, "ygyro": -200, "zgyro": 300}
FORCE = {"xacc": 1000, "yacc": 500, "zacc": -1000}
HEARTBEAT = {"type": 2, "autopilot": 3, "base_mode": 81, "custom_mode": 5}
DATED = {"time_unix_usec": UNIX_2020_US, "time_boot_ms": 2000}
PLACE = {"lat": 515000000, "lon": -1234567, "alt": 120500, "relative_alt": 2500}
GPS = {"I": 0, "Status": 3, "Spd": 20.0, "GCrs": 90.0, "VZ": -2.0}
COMMANDED = {"q": [np.sqrt(0.75), 0.0, 0.5, 0.0], "type_mask": 0b0000_0111}
ONE = (b"N", 0x3F800000, 9)  # 1.0 as IEEE 754
HEALTH = {"onboard_control_sensors_enabled": 1 << 15 | 1 << 26 | 1 << 4}
DETECTOR = "failure_detector_status"
DETECTED = {"fd_arm_escs": 1, "fd_imbalanced_prop": 1, "fd_motor": 1, "motor_failure_mask": 0}
SPED = {"indicated_airspeed_m_s": 17.0}
INT32 = {"name": b"N", "type": b"int32_t", "value": 7.0}

FACTS: tuple[tuple[str, dict[str, Any], str, Any], ...] = (
    # MAVLink common.xml: mrad/s and mG but in HIGHRES_IMU; degE7, mm, cm/s; degrees commanded
    *((name, GYRO, "rates", [0.1, -0.2, 0.3]) for name in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2")),
    *((name, FORCE, "force", [G, G / 2, -G]) for name in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2")),
    ("HIGHRES_IMU", GYRO, "rates", [100, -200, 300]),
    ("HIGHRES_IMU", FORCE, "force", [1000, 500, -1000]),
    ("ATTITUDE", {"rollspeed": 1.0, "pitchspeed": 2.0, "yawspeed": 3.0}, "rates", [1, 2, 3]),
    ("ATTITUDE", {"roll": 1.0, "pitch": 2.0, "yaw": 3.0}, "attitude", [1, 2, 3]),
    ("POWER_STATUS", {"Vservo": 5100}, "servo rail", [5.1]),
    ("POWR", {"VServo": 5.1}, "servo rail", [5.1]),
    ("ATTITUDE", {"time_boot_ms": 1500}, "uptime", 1_500_000),
    ("ATTITUDE_TARGET", COMMANDED, "demand", [0, np.pi / 3]),
    ("ATTITUDE_TARGET", COMMANDED | {"type_mask": 0b1000_0000}, "demand", [NAN, NAN]),
    ("NAV_CONTROLLER_OUTPUT", {"alt_error": 2.5}, "altitude error", [2.5]),
    ("TECS", {"h": 100.0, "hdem": 102.5}, "altitude error", [2.5]),
    ("NAV_CONTROLLER_OUTPUT", {"nav_roll": 90.0, "nav_pitch": -45.0}, "demand", [QUARTER, -QUARTER / 2]),
    *(("VFR_HUD", {"airspeed": 17.0}, name, [17]) for name in ("airspeed", "sensed airspeed")),
    ("VFR_HUD", {"groundspeed": 9.0}, "groundspeed", [9]),
    ("VFR_HUD", {"alt": 50.0}, "altitude", [50]),
    ("LOCAL_POSITION_NED", {"z": -50.0}, "altitude", [50]),
    ("GLOBAL_POSITION_INT", {"vx": 300, "vy": -400, "vz": 100}, "velocity", [3, -4, 1]),
    ("GLOBAL_POSITION_INT", PLACE, "altitude", [2.5]),
    ("GLOBAL_POSITION_INT", PLACE, "position", [51.5, -0.1234567, 120.5]),
    *(("EXTENDED_SYS_STATE", {f"{name}_state": n}, name, [n]) for name, n in (("vtol", 4), ("landed", 2))),
    ("HEARTBEAT", HEARTBEAT, "state", [2, 3, 0, 5]),
    ("HEARTBEAT", HEARTBEAT | {"base_mode": 128}, "state", [2, 3, 1, 5]),
    ("HEARTBEAT", HEARTBEAT, "mode", [3, 2, 81, 5]),
    ("HEARTBEAT", HEARTBEAT, "autopilot", [2, 3]),
    ("SYSTEM_TIME", DATED, "boot", UNIX_2020_US - 2_000_000),
    ("PARAM_VALUE", {"param_id": b"N", "param_value": np.float32(1), "param_type": 9}, "parameter", ONE),
    ("SERVO_OUTPUT_RAW", {"port": 0, **OUTPUTS}, "outputs", [*range(1001, 1017)]),
    ("SERVO_OUTPUT_RAW", {"port": 1, **OUTPUTS}, "outputs_2", [*[NAN] * 16, *range(1001, 1017)]),
    ("SERVO_OUTPUT_RAW", {"port": 0, **OUTPUTS, "servo2_raw": 65535, "servo3_raw": 0, "servo4_raw": 800},
     "outputs", [1001, NAN, NAN, 800, *range(1005, 1017)]),
    # ArduPilot's log messages: rad/s and m/s² of the IMU, degrees of the attitude and the course
    *(("STAT", {"Armed": n, "isFlying": 0}, "armed", [3, n]) for n in (0, 1)),
    *(("ARM", {"ArmState": n}, "arming", [3, n]) for n in (0, 1)),
    *(("EV", {"Id": code}, "arming", [3, n]) for code, n in ((10, 1), (11, 0))),
    ("RCOU", {"Ch1": 1500}, "outputs", [1500, *[NAN] * 15]),  # Copter before 3.4
    *(("STAT", {"Armed": 1, "isFlying": n}, "landed", [1 + n]) for n in (0, 1)),
    ("RCOU", {"C1": 1500, "C14": 1100, "C15": 0}, "outputs", [1500, *[NAN] * 12, 1100, NAN, NAN]),
    ("RCO2", {"C15": 1500, "C32": 1100}, "outputs_2", [*[NAN] * 14, 1500, *[NAN] * 16, 1100]),
    ("RCO3", {"C32": 1100}, "outputs_3", [*[NAN] * 31, 1100]),
    ("IMU", {"I": 0, "GyrX": 1.0, "GyrY": 2.0, "GyrZ": 3.0}, "rates", [1, 2, 3]),
    ("IMU", {"AccX": 1.0, "AccY": 2.0, "AccZ": 3.0}, "force", [1, 2, 3]),  # before there were several
    ("RATE", {"ROut": 0.1, "POut": 0.2, "YOut": 0.3, "AOut": 0.4}, "mixer", [0.1, 0.2, 0.3, 0.4]),
    ("ATT", {"Roll": 90.0, "Pitch": -45.0, "Yaw": 180.0}, "attitude", [QUARTER, -QUARTER / 2, np.pi]),
    ("ATT", {"DesRoll": 90.0, "DesPitch": -45.0}, "demand", [QUARTER, -QUARTER / 2]),
    *(("ARSP", {"I": 0, "Airspeed": 17.0}, name, [17]) for name in ("airspeed", "sensed airspeed")),
    ("GPS", GPS, "velocity", [0, 20, -2]),
    ("GPS", GPS | {"GCrs": 180.0, "Status": 4}, "velocity", [-20, 0, -2]),
    ("GPS", GPS | {"Status": 2}, "velocity", [NAN] * 3),
    ("GPS", {"Status": 3, "Spd": 20.0, "GCrs": 0.0}, "velocity", [20, 0, 0]),
    ("GPS", GPS, "groundspeed", [20]),
    *(("EV", {"Id": code}, "landed", [n]) for code, n in ((18, 1), (28, 2))),
    ("POS", {"RelHomeAlt": 50.0}, "altitude", [50]),
    *((name, {"I": 0, "Alt": 50.0}, "altitude", [50]) for name in ("CTUN", "BARO")),
    ("POS", {"Lat": 51.5, "Lng": -0.1, "Alt": 120.5}, "position", [51.5, -0.1, 120.5]),
    ("MODE", {"ModeNum": 11}, "mode", [3, -1, 0, 11]),
    *((name, {"TimeUS": 1500}, "uptime", 1500) for name in ("MSG", "PARM")),
    ("PARM", {"Name": b"N", "Value": 1.0}, "parameter", ONE),
    # flags of faults: ESC_FAILURE_FLAGS, MAV_POWER_STATUS, MAV_SYS_STATUS_SENSOR, EDT2's status, PX4's topics
    ("ESC_INFO", {"error_count": [0, 1, 2, 3], "index": 4}, "ESC errors", [0, 1, 2, 3]),
    ("ESC_INFO", {"failure_flags": [0, 32, 0, 1], "index": 4}, "ESC faults", [0, 32, 0, 1]),
    ("POWER_STATUS", {"flags": 0b111}, "supply faults", [0]),
    ("POWER_STATUS", {"flags": 0b11001}, "supply faults", [0b1110]),
    ("POWR", {"Flags": 0b1010}, "supply faults", [0b0101]),
    *(("SYS_STATUS", {"onboard_control_sensors_present": bits}, "airspeed sensor", [n])
      for bits, n in ((0b110000, 1), (0b101111, 0))),
    ("SYS_STATUS", HEALTH | {"onboard_control_sensors_health": 3}, "autopilot faults", [0b11]),
    ("SYS_STATUS", HEALTH | {"onboard_control_sensors_health": 1 << 26}, "autopilot faults", [0b01]),
    *(("ESC", {"Instance": 2, "Err": 50.0 + n}, "ESC telemetry", [n]) for n in (0, 1)),
    ("EDT2", {"Instance": 2, "Status": 0b01010}, "ESC faults", [1 << 11]),
    ("CESC", {"Id": 2, "ECnt": 7}, "ESC errors", [7]),
    ("CSRV", {"Id": 2, "Err": 5}, "servo flags", [5]),
    ("esc_status", {"esc[1].esc_errorcount": 7}, "ESC errors", [0, 7, *[0] * 10]),
    ("esc_status", {"esc[1].failures": 32}, "ESC faults", [0, 32, *[0] * 10]),
    ("esc_status", {"esc_count": 4, "esc_online_flags": 0b1011}, "ESC links", [0, 0, 1, *[0] * 9]),
    (DETECTOR, DETECTED, "motor faults", [0] * 12),
    (DETECTOR, DETECTED | {"motor_failure_mask": 0b100}, "motor faults", [0, 0, 1, *[0] * 9]),
    (DETECTOR, DETECTED, "autopilot faults", [0b11100]),
    (DETECTOR, DETECTED | {"motor_failure_mask": 0b100}, "autopilot faults", [0b01100]),
    ("system_power", {"brick_valid": 0, "servo_valid": 1, "periph_5v_oc": 1}, "supply faults", [0b101]),
    ("system_power", {"hipower_5V_OC": 1}, "supply faults", [0b1000]),
    # PX4's topics: SI units; angles as quaternions, z down
    ("vehicle_attitude", {"q": [HALF, HALF, 0.0, 0.0]}, "attitude", [QUARTER, 0, 0]),
    ("vehicle_attitude", {"q": [HALF, 0.0, 0.0, HALF]}, "attitude", [0, 0, QUARTER]),
    ("vehicle_attitude", {"q": [0.5, 0.5, 0.5, 0.5]}, "attitude", [QUARTER, 0, QUARTER]),
    *(("airspeed_validated", SPED | sensor, "airspeed", [17])
      for sensor in ({}, {"selected_airspeed_index": 1}, {"airspeed_source": 3})),
    *(("airspeed", SPED, name, [17]) for name in ("airspeed", "sensed airspeed")),
    ("vehicle_angular_velocity", {"xyz": [4.0, 5.0, 6.0]}, "rates", [4, 5, 6]),
    ("sensor_combined", {"gyro_rad": [1.0, 2.0, 3.0]}, "rates", [1, 2, 3]),
    ("vehicle_attitude", {"rollspeed": 1.0, "pitchspeed": 2.0, "yawspeed": 3.0}, "rates", [1, 2, 3]),
    ("sensor_combined", {"accelerometer_m_s2": [1.0, 2.0, 3.0]}, "force", [1, 2, 3]),
    ("vehicle_attitude_setpoint", {"q_d": COMMANDED["q"]}, "demand", [0, np.pi / 3]),
    ("vehicle_attitude_setpoint", {"roll_body": 0.5, "pitch_body": 0.25}, "demand", [0.5, 0.25]),
    *(("vehicle_local_position", {"vx": 3.0, "vy": 4.0, "vz": -1.0}, name, value)
      for name, value in (("velocity", [3, 4, -1]), ("groundspeed", [5]))),
    ("vehicle_local_position", {"z": -50.0}, "altitude", [50]),
    ("vehicle_status", {"arming_state": 2, "system_type": 1, "nav_state": 3}, "state", [1, 12, 1, 3]),
    ("vehicle_status", {"arming_state": 1, "system_type": 1, "nav_state": 4}, "state", [1, 12, 0, 4]),
    ("vehicle_air_data", {"baro_alt_meter": 50.0}, "altitude", [50]),
    ("vtol_vehicle_status", {"vehicle_vtol_state": 4}, "vtol", [4]),
    *(("vehicle_land_detected", {"landed": n}, "landed", [2 - n]) for n in (0, 1)),
    ("vehicle_status", {"nav_state": 4}, "mode", [12, -1, 0, 4]),
    ("vehicle_status", {"system_type": 22}, "autopilot", [22, 12]),
    ("vehicle_status", {"timestamp": 1500}, "uptime", 1500),
    ("vehicle_global_position", {"lat": 51.5, "lon": -0.1, "alt": 120.5}, "position", [51.5, -0.1, 120.5]),
    ("parameter", INT32, "parameter", (b"N", 7, 6)),
    ("parameter", INT32 | {"type": b"float", "value": 1.0}, "parameter", ONE),
    ("info", {"name": b"sys_name", "value": b"PX4"}, "autopilot name", b"PX4"),
    ("info", {"name": b"sys_uuid", "value": b"00ab"}, "board", b"00AB"),
    ("info", {"name": b"ver_sw_release", "value": b"17694975"}, "firmware", 17694975),
)  # fmt: skip


@pytest.mark.parametrize(("message", "fields", "name", "expected"), FACTS)
def test_of_a_fact(message: str, fields: dict[str, Any], name: str, expected: Any) -> None:
    (found,) = fact(name, table(message, fields))
    if isinstance(expected, (tuple, bytes)):
        assert found == expected
    else:
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def test_every_numeric_fact_is_here_or_of_the_outputs() -> None:
    elsewhere = {"text", "named value", "script value", "firmware", "board"}
    listed = {(message, name) for message, _, name, _ in FACTS}
    read = [(s.message, s.fact) for form in FORMATS for s in form.SOURCES if s.fact not in elsewhere]
    assert {message for message, name in read if (message, name) not in listed} == {"actuator_outputs"}


def test_rows_that_do_not_carry_the_fact() -> None:
    loose = table("NAV_CONTROLLER_OUTPUT", {"nav_roll": 9.0, "nav_pitch": 9.0}, flags=LOOSE_TIME)
    np.testing.assert_array_equal(fact("demand", loose), [[NAN, NAN]])
    no_fix = DATED | {"time_unix_usec": 1_230_768_000_000_000}  # 2009
    versions = (b"4294967296", b"0", b"1.2", b"00000000001")
    absent = (
        ("state", table("HEARTBEAT", HEARTBEAT | {"autopilot": 8})),
        ("mode", table("HEARTBEAT", HEARTBEAT | {"autopilot": 8})),
        ("boot", table("SYSTEM_TIME", no_fix)),
        ("outputs", table("SERVO_OUTPUT_RAW", {"port": 1, **OUTPUTS})),
        ("outputs_2", table("SERVO_OUTPUT_RAW", {"port": 0, **OUTPUTS})),
        ("rates", table("IMU", {"I": 1, "GyrX": 1.0, "GyrY": 2.0, "GyrZ": 3.0})),
        ("velocity", table("GPS", GPS | {"I": 1})),
        ("autopilot", table("vehicle_status", {"system_type": 0})),
        *(("airspeed", table("airspeed_validated", SPED | {"airspeed_source": n})) for n in (-1, 0, 4)),
        ("airspeed sensor", table("SYS_STATUS", {"onboard_control_sensors_present": 0})),
        ("airspeed sensor", table("SYS_STATUS", {"onboard_control_sensors_present": 3}, component=191)),
        ("board", table("info", {"name": b"sys_name", "value": b"PX4"})),
        *(("firmware", table("info", {"name": b"ver_sw_release", "value": text})) for text in versions),
        ("firmware", table("info", {"name": b"ver_hw", "value": b"1"})),
    )
    for name, one in absent:
        assert fact(name, one) == [], (name, one.fields)


def readings(ids: ServoIds, *tables: Table, others: tuple[ServoIds, ...] = ()) -> list[tuple[str, Any]]:
    """Return source and quantities of what a servo reports, NaN left out."""
    found = [
        (reading.source, dict(zip(reading.fields, reading.values[0].tolist(), strict=True)))
        for one in tables
        for source in SERVO_SOURCES
        for reading in servo_readings(source, {one.name: one}, (ids, *others))
        if reading.servo == ids.servo and len(reading.values)
    ]
    return [(name, {key: n for key, n in values.items() if not np.isnan(n)}) for name, values in found]


FOUR = {"index": 4, "time_usec": 1, "voltage": [12.0, 13.0, 14.0, 15.0], "current": [1.0, -2.0, 3.0, 4.0]}
CENTI = {"voltage": [1200, 0, 1400, 1500], "current": [100, 0, 300, 400], "rpm": [10, 0, 30, 40]}
VOLZ = {"Id": 4, "PosCmd": 5.0, "Pos": 4.0, "V": 12.0, "A": 0.5, "Speed": NAN, "Force": NAN}
EIGHT = {"esc[1].timestamp": 9, "esc[1].esc_voltage": 12.0, "esc[1].esc_current": -1.0, "esc[1].esc_rpm": -30}
ACTUATORS = {"actuator": np.arange(32, dtype=np.float32) + 1000}
CARD = {"Instance": 2, "Volt": 12.0, "Curr": -1.5, "RPM": -30}


def of(v: float, a: float, rpm: float) -> dict[str, float]:
    return {"V4": v, "V5": a, "V7": rpm}


@pytest.mark.parametrize(
    ("ids", "message", "fields", "expected"),
    [
        # ESC_STATUS: V, A, rev/min of ESCs index … index + 3
        (ServoIds(1, 5), "ESC_STATUS", FOUR | {"rpm": [1, -2, 3, 4]}, [("ESC_STATUS[5]", of(13, -2, -2))]),
        (ServoIds(1, 1), "ESC_STATUS", FOUR | {"rpm": [1, -2, 3, 4]}, []),
        # ESC_TELEMETRY: cV, cA, rev/min; zeros are an absent ESC
        *((ServoIds(1, 4 + k), "ESC_TELEMETRY_5_TO_8", CENTI,
           [(f"ESC_TELEMETRY_5_TO_8[{k}]", of(12 + k, 1 + k, 10 + 10 * k))]) for k in (0, 2, 3)),
        (ServoIds(1, 5), "ESC_TELEMETRY_5_TO_8", CENTI, []),
        (ServoIds(1, 8), "ESC_TELEMETRY_5_TO_8", CENTI, []),
        (ServoIds(1, 30), "ESC_TELEMETRY_29_TO_32", CENTI, [("ESC_TELEMETRY_29_TO_32[2]", of(14, 3, 30))]),
        (ServoIds(17), "SERVO_OUTPUT_RAW", {"port": 1, **OUTPUTS}, [("SERVO_OUTPUT_RAW", {"pulse": 1001})]),
        (ServoIds(16), "SERVO_OUTPUT_RAW", {"port": 0, **OUTPUTS}, [("SERVO_OUTPUT_RAW", {"pulse": 1016})]),
        (ServoIds(1), "SERVO_OUTPUT_RAW", {"port": 1, **OUTPUTS}, []),
        (ServoIds(32), "ACTUATOR_OUTPUT_STATUS", ACTUATORS, [("ACTUATOR_OUTPUT_STATUS", {"pulse": 1031})]),
        (ServoIds(33), "ACTUATOR_OUTPUT_STATUS", ACTUATORS, []),
        # CSRV: a driven servo counts from 0 and repeats its command, on DroneCAN from 1 without; °, °/s
        (ServoIds(5), "CSRV", VOLZ, [("CSRV[4]", {"V1": 5, "V3": 4, "V4": 12, "V5": 0.5})]),
        (ServoIds(4), "CSRV", VOLZ, []),
        (ServoIds(9, None, 4), "CSRV", VOLZ, [("CSRV[4]", {"V1": 5, "V3": 4, "V4": 12, "V5": 0.5})]),
        (ServoIds(4), "CSRV", VOLZ | {"PosCmd": NAN, "Speed": 6.0, "Force": 2.0},
         [("CSRV[4]", {"V3": 4, "V4": 12, "V5": 0.5, "V10": 1})]),
        (ServoIds(4), "CSRV", {"Id": 4, "Pos": np.pi, "Speed": 2 * np.pi, "Force": 2.0},
         [("CSRV[4]", {"V3": 180, "V10": 60})]),
        (ServoIds(1, 2), "ESC", CARD, [("ESC[2]", of(12, 1.5, 30))]),  # magnitudes
        (ServoIds(1, 1), "ESC", CARD, []),
        (ServoIds(2), "RCOU", {"C1": 1100, "C2": 1500}, [("RCOU", {"pulse": 1500})]),
        (ServoIds(1, 1), "esc_status", EIGHT, [("esc_status[1]", of(12, -1, -30))]),
        (ServoIds(1, 1), "esc_status", EIGHT | {"esc[1].timestamp": 0}, []),
    ],
)  # fmt: skip
def test_of_a_servo(ids: ServoIds, message: str, fields: dict[str, Any], expected: Any) -> None:
    found = readings(ids, table(message, fields))
    assert [name for name, _ in found] == [name for name, _ in expected]
    for (_, values), (_, known) in zip(found, expected, strict=True):
        assert values == pytest.approx(known)


def test_a_record_that_is_named_is_of_no_other_servo() -> None:
    one = table("CSRV", VOLZ)
    assert readings(ServoIds(5), one, others=(ServoIds(9, None, 4),)) == []


def test_drivers_of_px4_follow_one_another() -> None:
    sent = np.arange(16, dtype=np.float32) + 1000
    for driver, servo, k in ((0, 16, 15), (1, 17, 0), (2, 34, 1)):
        one = table("actuator_outputs", {"output": sent}, component=driver)
        assert readings(ServoIds(servo), one) == [(f"actuator_outputs[{driver}]", {"pulse": 1000 + k})]
        assert readings(ServoIds(servo % 48 + 16), one) == []
    unset = table("actuator_outputs", {"output": [1500.0, 900.0, 0.0, *[2500.0] * 13]}, component=0)
    np.testing.assert_array_equal(fact("outputs", unset), [[1500, 900, *[NAN] * 14]])
    main = table("actuator_outputs", {"output": sent}, component=0)
    aux = replace(main, component=main.component + 1)
    assert fact("outputs", main) == [sent.tolist()]
    assert fact("outputs", aux) == fact("outputs_2", main) == []
    np.testing.assert_array_equal(fact("outputs_2", aux), [[*[NAN] * 16, *sent]])


def test_a_batch_that_repeats_the_one_before_is_no_reading() -> None:
    """PX4 sends ESCs 0–3 once more as 4–7; a batch that differs in one number is another one."""
    batch = FOUR | {"rpm": [1, 2, 3, 4]}
    first, copy = table("ESC_STATUS", batch | {"index": 0}), table("ESC_STATUS", batch)
    other = table("ESC_STATUS", batch | {"current": [1.0, -2.0, 3.0, 5.0]})
    later = table("ESC_STATUS", batch | {"time_usec": 2})
    elsewhere = replace(copy, system=copy.system + 1)
    for second, count in ((copy, 0), (other, 1), (later, 1), (elsewhere, 1)):
        both = Table.concatenate([first, second])
        (source,) = (one for one in SERVO_SOURCES if one.message == both.name)
        found = servo_readings(source, {both.name: both}, (ServoIds(1, 4),))
        assert sum(len(reading.values) for reading in found) == count


@pytest.mark.parametrize("autopilot", [v2.MAV_AUTOPILOT_ARDUPILOTMEGA, v2.MAV_AUTOPILOT_PX4])
def test_modes_have_the_names_that_pymavlink_gives_them(autopilot: int) -> None:
    custom = v2.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    numbers = [*range(40), *(main << 16 | sub << 24 for main in range(11) for sub in range(11))]
    for kind, base_mode, number in product(range(50), (0, custom, custom | 64), numbers):
        heartbeat = v2.MAVLink_heartbeat_message(kind, autopilot, base_mode, number, 4, 3)
        assert mavlink.mode_name(autopilot, kind, base_mode, number) == mode_string_v10(heartbeat)
    assert [dataflash.mode_name(3, kind, 0, 11) for kind in (-1, 1, 2)] == [None, "RTL", "DRIFT"]


def test_names_of_navigation_states() -> None:
    """PX4's are of vehicle_status.msg, whose free numbers are former modes."""
    states = {0: "MANUAL", 3: "MISSION", 7: "Mode(7)", 14: "OFFBOARD", 22: "VTOL_TAKEOFF", 23: "Mode(23)"}
    assert {number: ulog.mode_name(12, 1, 0, number) for number in states} == states
