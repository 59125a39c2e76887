"""The log of a closed-loop flight: what it says, against the flight and against pymavlink."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim.closed_loop import Air, ClosedLoop, Confounder, FlownLoop, fly_closed_loop
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.log import loop_messages, write_loop
from mavhums_sim.closed_loop.outputs import Outputs
from mavhums_sim.closed_loop.reports import ARDUPLANE_MODES, PX4_MODES, Streams, report
from mavhums_sim.flight import Flight
from mavhums_sim.link import Link

Log = list[tuple[int, Any]]


def decode(data: bytes) -> Log:
    """(µs of reception, message) as pymavlink reads a ``.tlog``; every frame must be whole."""
    parser = mavlink.MAVLink(io.BytesIO(), srcSystem=9)
    parser.robust_parsing = False
    at, seen = 0, []
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        size = 12 + data[at + 9]
        frame = bytearray(data[at + 8 : at + 8 + size])
        seen.append((stamp, parser.decode(frame)))
        at += 8 + size
    return seen


def fields(log: Log, name: str, *names: str) -> np.ndarray[Any, Any]:
    return np.array([[getattr(m, n) for n in names] for _, m in log if m.get_type() == name])


@pytest.fixture(scope="module", params=["ardupilot", "px4"])
def flown(request: pytest.FixtureRequest) -> FlownLoop:
    met: dict[str, Any] = {"air": Air(4.0, 20.0, 9.0), "confounders": (Confounder("gps", 2.0, 45.0, 50.0),)}
    return fly_closed_loop(ClosedLoop(seed=6, airframe=6, duration_s=60.0, flavour=request.param, **met))


@pytest.fixture(scope="module")
def log(flown: FlownLoop) -> Log:
    return decode(encode(report(flown, Streams(rate=10.0)), 6))


@pytest.mark.slow
def test_both_writers_send_the_same_messages(flown: FlownLoop, log: Log, tmp_path: Path) -> None:
    counts = write_loop(flown, tmp_path / "one.tlog", Streams(rate=10.0))
    one_by_one = decode((tmp_path / "one.tlog").read_bytes())
    assert sum(counts.values()) == len(log)
    for name in counts:
        ours, theirs = ([m.to_dict() for _, m in some if m.get_type() == name] for some in (log, one_by_one))
        assert ours == theirs, name


def test_stamps_and_sequence(log: Log) -> None:
    stamps = np.array([stamp for stamp, _ in log])
    assert (np.diff(stamps) >= 0).all()
    assert [m.get_seq() for _, m in log[:300]] == [k % 256 for k in range(300)]


def test_frames_are_lost_by_the_links_share(flown: FlownLoop) -> None:
    tables = report(flown)
    whole = sum(table.times.size for table in tables)
    kept = len(decode(encode(tables, 1, Link(loss=0.2))))
    assert kept == pytest.approx(0.8 * whole, rel=0.05)


@pytest.mark.parametrize("rate", [2.0, 25.0, 50.0])
def test_streams_keep_their_rate(flown: FlownLoop, rate: float) -> None:
    for table in report(flown, Streams(rate=rate)):
        if table.name in {"ATTITUDE", "SERVO_OUTPUT_RAW", "VFR_HUD"}:
            assert table.times.size == pytest.approx(rate * flown.end_s, abs=2)


def test_attitude_and_rates_are_the_flights(flown: FlownLoop, log: Log) -> None:
    rows = fields(log, "ATTITUDE", "time_boot_ms", "roll", "pitch", "rollspeed")
    times = rows[:, 0] / 1000.0 - 30.0
    for column, name, limit in ((1, "roll", 0.03), (2, "pitch", 0.03), (3, "p", 0.03)):
        error = rows[:, column] - np.interp(times, flown.time_s, flown.column(name))
        flying = times > flown.time_s[0] + 0.1
        assert np.abs(error[flying]).mean() < limit, name


def test_accelerometers_show_gravity_at_rest_and_lift_in_flight(flown: FlownLoop, log: Log) -> None:
    px4 = flown.flight.flavour == "px4"
    rows = fields(log, *(("HIGHRES_IMU",) if px4 else ("RAW_IMU",)), "xacc", "yacc", "zacc")
    force = np.linalg.norm(rows * (1.0 if px4 else 9.80665e-3), axis=1)
    assert force[:100].mean() == pytest.approx(9.81, rel=0.03)
    assert 8.0 < force[200:].mean() < 14.0


def test_pulses_follow_the_parameters(flown: FlownLoop, log: Log) -> None:
    outputs = Outputs.of(flown)
    rows = fields(log, "SERVO_OUTPUT_RAW", "time_usec", *(f"servo{n}_raw" for n in (1, 2, 3, 5)))
    times = rows[:, 0] / 1e6 - 30.0
    flying = times > flown.time_s[0] + 0.1
    index = ((times[flying] - flown.time_s[0]) / 0.01).astype(int)
    demand = flown.servos("demand")[index]
    sign = np.where(outputs.reversed_, -1.0, 1.0)
    sign = sign * ([-1, 1, 1, 1] if flown.flight.flavour == "px4" else [1, 1, 1, 1])
    expected = outputs.trim + sign * outputs.half_range * demand / np.radians(25.0)
    assert np.abs(rows[flying, 1:4] - expected[:, :3]).max() < 0.6
    assert (rows[times < flown.time_s[0], 4] == 1000).all()
    assert outputs.reversed_.any()


def test_parameters_are_cast_as_the_autopilot_casts(flown: FlownLoop, log: Log) -> None:
    values = {m.param_id: (m.param_value, m.param_type) for _, m in log if m.get_type() == "PARAM_VALUE"}
    if flown.flight.flavour == "px4":
        bits = struct.unpack("<i", struct.pack("<f", values["PWM_MAIN_FUNC1"][0]))[0]
        assert (bits, values["PWM_MAIN_FUNC1"][1]) == (201, 6)
        assert values["CA_SV_CS2_TRQ_P"] == (1.0, 9)
        assert values["CA_SV_CS0_TRQ_R"][0] == -values["CA_SV_CS1_TRQ_R"][0]
    else:
        assert [values[f"SERVO{n}_FUNCTION"][0] for n in range(1, 7)] == [4, 4, 19, 21, 70, 0]
        assert values["SERVO1_MIN"][0] < values["SERVO1_TRIM"][0] < values["SERVO1_MAX"][0]


def test_modes_arming_and_type(flown: FlownLoop, log: Log) -> None:
    rows = fields(log, "HEARTBEAT", "type", "autopilot", "base_mode", "custom_mode")
    px4 = flown.flight.flavour == "px4"
    assert set(rows[:, 1]) == {12 if px4 else 3}
    assert set(rows[:, 0]) == {1}
    armed = rows[:, 2] & 128 > 0
    assert not armed[:7].any()
    assert armed[9:].all()
    assert set(rows[:, 3]) <= set((PX4_MODES if px4 else ARDUPLANE_MODES).values())


def test_demand_leads_the_flown_roll(flown: FlownLoop, log: Log) -> None:
    if flown.flight.flavour == "px4":
        q = np.array([m.q for _, m in log if m.get_type() == "ATTITUDE_TARGET"])
        demanded = np.arctan2(
            2 * (q[:, 0] * q[:, 1] + q[:, 2] * q[:, 3]), 1 - 2 * (q[:, 1] ** 2 + q[:, 2] ** 2)
        )
    else:
        demanded = np.radians(fields(log, "NAV_CONTROLLER_OUTPUT", "nav_roll")[:, 0])
    flew = fields(log, "ATTITUDE", "roll")[:, 0]
    n = min(demanded.size, flew.size) - 4
    assert np.corrcoef(demanded[200:n], flew[204 : n + 4])[0, 1] > 0.9


def test_lost_gps_says_so(log: Log) -> None:
    rows = fields(log, "GPS_RAW_INT", "fix_type", "satellites_visible")
    assert 8 <= (rows[:, 0] == 1).sum() <= 12
    assert (rows[rows[:, 0] == 1, 1] == 0).all()


def test_emas_report_beside_the_vehicle() -> None:
    flight = ClosedLoop(seed=1, airframe=None, duration_s=25.0, emas=Flight(rate_hz=20.0))
    names = [message.get_type() for _, message in loop_messages(fly_closed_loop(flight))]
    assert {"DEBUG_FLOAT_ARRAY", "ESC_TELEMETRY_1_TO_4", "BATTERY_STATUS", "ATTITUDE"} <= set(names)
    assert names.count("SERVO_OUTPUT_RAW") == 249
