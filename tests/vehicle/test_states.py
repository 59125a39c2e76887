from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.engine.events import Event
from mavhums.vehicle.states import Attitude, FlightMode, Position, VehicleStates
from tests.conftest import real_logs
from tests.judge import judged
from tests.logs import packed
from tests.vehicle.tables import table_of

PLANE, COPTER, GCS = 1, 2, 6
ARDUPILOT, PX4, NONE = 3, 12, 8


def states(data: bytes, *, step: int | None = None, wanted: bool = True) -> list[Event]:
    _, events = judged(data, size=step or len(data), vehicle_states=wanted)
    return [e for e in events if isinstance(e, Attitude | Position | FlightMode)]


def log(*messages: Any, component: int = 1) -> bytes:
    """Frames 100 ms apart."""
    return packed(messages, component=component, step_us=100_000)


def attitude(ms: int, roll: float) -> Any:
    return v2.MAVLink_attitude_message(ms, roll, 0.2, -1.0, 0, 0, 0)


def heartbeat(kind: int, autopilot: int, base: int, custom: int) -> Any:
    return v2.MAVLink_heartbeat_message(kind, autopilot, base, custom, 4, 3)


def test_attitudes_on_the_senders_clock() -> None:
    data = log(attitude(1000, 0.1), attitude(1040, 0.2), attitude(1040, 9.0), attitude(1120, np.nan))
    (found,) = states(data)
    assert isinstance(found, Attitude)
    np.testing.assert_allclose(found.time_s, [0.0, 0.04])
    np.testing.assert_allclose(found.roll_pitch_yaw_rad, [[0.1, 0.2, -1.0], [0.2, 0.2, -1.0]], rtol=1e-6)


ON_EARTH = (90, 180), (-90, -180), (51.5, 179.9), (0, 0.011), (-0.011, 0)
NOWHERE = (51.5, 180.1), (-90.1, 12), (0.01, 0.01), (np.nan, 12)


@pytest.mark.parametrize(("degrees", "is_one"), [*((d, 1) for d in ON_EARTH), *((d, 0) for d in NOWHERE)])
def test_a_position_lies_on_the_earth_and_not_where_none_is_known(
    degrees: tuple[float, float], is_one: int
) -> None:
    fields = [("lat", "f8"), ("lon", "f8"), ("alt", "f8")]
    row = np.array([(degrees[0] * 1e7, degrees[1] * 1e7, 5000.0)], dtype=fields)
    table = table_of("GLOBAL_POSITION_INT", row, time_us=[7_200_000_000])
    found = list(VehicleStates().feed({table.name: table}, start_us=3_600_000_000))
    positions = [(event.time_s[0], event.altitude_m[0]) for event in found if isinstance(event, Position)]
    assert positions == [(3600.0, 5.0)] * is_one


def test_time_that_runs_back_or_stops_is_left_out_over_the_blocks() -> None:
    """A clock without a date begins at 0, or below."""
    states, heard = VehicleStates(), []
    for block in ([-3, -1], [-2, -1, 0], [0, 4, 3, 5]):
        row = np.zeros(len(block), dtype=[(name, "f4") for name in ("roll", "pitch", "yaw")])
        table = table_of("ATTITUDE", row, frame=block, time_us=block)
        for event in states.feed({table.name: table}, start_us=-1_000_000):
            assert isinstance(event, Attitude)
            heard.append((event.time_s * 1e6 - 1e6).round().tolist())
    assert heard == [[-3, -1], [0], [4, 5]]


def test_flight_modes_by_autopilot_and_vehicle() -> None:
    plane = PLANE, ARDUPILOT
    said = [(*plane, 89, 10), (*plane, 217, 10), (GCS, NONE, 0, 0)]  # the second is armed, in the same mode
    said += [(COPTER, ARDUPILOT, 89, 6), (PLANE, PX4, 81, 3 << 16), (*plane, 89, 99)]
    beats = [heartbeat(*one) for one in said]
    modes = [(event.time_s, event.mode) for event in states(log(*beats)) if isinstance(event, FlightMode)]
    assert modes == [(0.0, "AUTO"), (0.3, "RTL"), (0.4, "POSCTL"), (0.5, "Mode(99)")]


def test_the_last_hundred_modes_wait_for_a_text_that_names_the_kind() -> None:
    """Modes 10 and 5 in turn, of a log that does not name the kind with them."""

    states = VehicleStates()

    def modes(name: str, field: str, values: list[Any]) -> list[tuple[int, str]]:
        row = np.array([(value,) for value in values], dtype=[(field, "S20" if field == "Message" else "u1")])
        found = states.feed({name: table_of(name, row, time_us=np.arange(len(row)))}, start_us=0)
        return [(round(one.time_s * 1e6), one.mode) for one in found if isinstance(one, FlightMode)]

    assert modes("MODE", "ModeNum", [10, 5] * 60) == []
    assert modes("MSG", "Message", [b"PreArm: wait"]) == []
    changes = modes("MSG", "Message", [b"ArduPlane V4.7.0", b"ArduCopter V4.7.0"])
    assert changes == [(at, "FBWA" if at % 2 else "AUTO") for at in range(20, 120)]
    assert [mode for _, mode in modes("MODE", "ModeNum", [5, 10])] == ["AUTO"]


def test_one_component_speaks_for_the_vehicle() -> None:
    still = heartbeat(PLANE, NONE, 0, 0)
    other = log(still, still, attitude(5000, 3.0), component=154)
    (found,) = states(log(attitude(1000, 0.1)) + other)
    assert isinstance(found, Attitude)
    np.testing.assert_allclose(found.roll_pitch_yaw_rad[:, 0], [0.1], rtol=1e-6)


def test_it_costs_nothing_where_it_is_not_wanted() -> None:
    assert states(log(attitude(1000, 0.1), heartbeat(PLANE, ARDUPILOT, 89, 10)), wanted=False) == []


SHOWN = ("UAVLogViewer__vtol.tlog", "Jordinaa-supervisor__mav.tlog", "plane_normal.mavproxy.tlog")


@pytest.mark.slow
@pytest.mark.parametrize("path", [p for p in real_logs() if p.name in SHOWN], ids=lambda path: path.name)
def test_modes_of_real_logs_are_pymavlinks_own(path: Path) -> None:
    expected: list[tuple[int, str]] = []
    last: dict[int, str] = {}
    link = mavutil.mavlogfile(str(path), robust_parsing=True)
    while (message := link.recv_match(type="HEARTBEAT")) is not None:
        system, mode = message.get_srcSystem(), mavutil.mode_string_v10(message)
        if message.autopilot != NONE and last.get(system) != mode:
            last[system] = mode
            expected.append((system, mode))
    link.f.close()
    found = states(path.read_bytes(), step=65_536)
    modes = [(event.vehicle, event.mode) for event in found if isinstance(event, FlightMode)]
    assert modes == expected
    for kind in (Attitude, Position):
        times = [event.time_s for event in found if isinstance(event, kind) and event.vehicle == 1]
        assert not times or (np.diff(np.concatenate(times)) > 0).all()
