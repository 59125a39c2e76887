"""Replay: the commands of a log, ours or a real one, drive the actuators."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim import Flight, FlightRecord, fly, write_tlog
from mavhums_sim.link import EPOCH_US, Link
from mavhums_sim.rates import Rates
from mavhums_sim.replay import replay
from tests.conftest import REAL_LOGS, needs

HIGH_RATE = REAL_LOGS / "sitl" / "plane_hirate.link1.tlog"


@pytest.fixture(scope="module")
def flown() -> FlightRecord:
    return fly(Flight(seed=6, duration_s=15.0))


def logged(record: FlightRecord, path: Path, link: Link | None = None) -> Path:
    write_tlog(record, path, link)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("mavlink", [1, 2])
def test_replayed_log_gives_back_commands_and_airspeed(
    flown: FlightRecord, tmp_path: Path, mavlink: int
) -> None:
    path = logged(flown, tmp_path / "flight.tlog", Link(mavlink=mavlink))  # type: ignore[arg-type]
    played = replay(path)
    assert played.channels == {"aileron_left": 1, "aileron_right": 2, "elevator": 3, "rudder": 4}
    assert played.rate_hz == pytest.approx(50.0, rel=0.02)
    got, sent = played.cyclogram, flown.cyclogram
    late = 13  # ms: first sending and latency
    for surface in sent.commands:
        difference = got.commands[surface][2000:14_000] - sent.commands[surface][2000 + late : 14_000 + late]
        assert np.abs(np.degrees(difference)).max() < 0.5
    assert np.abs(got.airspeed[1000:14_000] - sent.airspeed[1000:14_000]).max() < 0.5
    assert np.abs(got.roll[1000:14_000] - sent.roll[1000:14_000]).max() < 0.02
    record = fly(Flight(duration_s=10.0, cyclogram=got))
    assert record.truth()["cyclogram"] == "replay of flight.tlog"
    assert record.actuators["elevator"].motion.moving_fraction > 0.8


@pytest.mark.slow
def test_held_commands_are_steps(flown: FlightRecord, tmp_path: Path) -> None:
    path = logged(flown, tmp_path / "flight.tlog")
    held = replay(path, {"rudder": 4}, "hold").cyclogram
    assert np.mean(np.diff(held.commands["rudder"]) != 0) < 0.06
    assert not held.commands["elevator"].any()


@pytest.fixture(scope="module")
def nameless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log whose first seconds, with the parameters, are lost to a reboot."""
    record = fly(Flight(seed=6, duration_s=6.0))
    return logged(record, tmp_path_factory.mktemp("log") / "nameless.tlog", Link(reboot_at_s=0.0))


def test_outputs_must_be_named_by_the_log_or_by_hand(nameless: Path) -> None:
    with pytest.raises(ValueError, match="--channel elevator=2"):
        replay(nameless)
    assert replay(nameless, {"elevator": 3}).channels == {"elevator": 3}
    with pytest.raises(ValueError, match=r"output 9 \(elevator\) never sends"):
        replay(nameless, {"elevator": 9})


def test_logs_without_commands_are_refused(tmp_path: Path) -> None:
    record = fly(Flight(duration_s=2.0, rates=Rates(servo_output=0.0)))
    with pytest.raises(ValueError, match="no SERVO_OUTPUT_RAW"):
        replay(logged(record, tmp_path / "none.tlog"))
    short = fly(Flight(duration_s=1.0))
    with pytest.raises(ValueError, match="less than a second"):
        replay(logged(short, tmp_path / "short.tlog"))
    with pytest.raises(FileNotFoundError):
        replay(tmp_path / "missing.tlog")


def test_only_the_main_outputs_of_the_busiest_vehicle_count(tmp_path: Path) -> None:
    """A second bank of outputs, and a second vehicle that says less, are left alone."""
    path = tmp_path / "mixed.tlog"
    names = mavlink.MAVLink_param_value_message(b"SERVO2_FUNCTION", 19.0, 9, 1, 0)
    with path.open("wb") as file:
        for k in range(200):
            for system, port, pulse in ((1, 0, 1600), (1, 1, 1900), (7, 0, 1100)):
                if system == 7 and k % 10:
                    continue
                link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
                pulses = [1500, pulse, *[1500] * 14]
                message = mavlink.MAVLink_servo_output_raw_message(k * 20_000, port, *pulses)
                file.write(struct.pack(">Q", EPOCH_US + k * 20_000) + message.pack(link))
                if k == 100:
                    file.write(struct.pack(">Q", EPOCH_US + k * 20_000) + names.pack(link))
    played = replay(path)
    assert played.channels == {"elevator": 2}
    assert np.degrees(played.cyclogram.commands["elevator"]) == pytest.approx(12.0)
    assert not played.cyclogram.airspeed.any()


@needs(HIGH_RATE)
def test_real_log_moves_the_actuators() -> None:
    played = replay(HIGH_RATE)
    assert played.channels == {"aileron_left": 1, "elevator": 2, "rudder": 4}
    assert played.rate_hz == pytest.approx(50.0, rel=0.02)
    record = fly(Flight(duration_s=140.0, cyclogram=played.cyclogram))
    for surface in played.channels:
        motion = record.actuators[surface].motion
        assert 0.5 < motion.moving_fraction < 0.95
        assert 1.0 < np.abs(motion.load).max() < 5.0
    assert record.actuators["aileron_right"].motion.moving_fraction < 0.02  # the wind alone
