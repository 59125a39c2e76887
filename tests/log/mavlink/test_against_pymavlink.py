"""pymavlink's known faults, each with what shows that the decoder is right."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.log import read_log
from tests.strategies import START_US


def log_of(path: Path, *frames: bytes) -> Path:
    path.write_bytes(b"".join(struct.pack(">Q", START_US + k) + frame for k, frame in enumerate(frames)))
    return path


def types_by_pymavlink(path: Path) -> list[str]:
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    out = [message.get_type() for message in iter(connection.recv_msg, None)]
    connection.close()
    return out


def packed(dialect: Any, message: Any) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=1, srcComponent=1)))


def heartbeat(dialect: Any) -> bytes:
    return packed(dialect, dialect.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3))


def test_newer_messages_after_a_first_frame_of_mavlink_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was packed is known; pymavlink's choice of protocol by the first frame hides it."""
    monkeypatch.delenv("MAVLINK20", raising=False)
    values = v2.MAVLink_debug_float_array_message(5, b"EMA", 3, [1.5] * 58)
    path = log_of(tmp_path / "mixed.tlog", heartbeat(v1), packed(v2, values))
    assert types_by_pymavlink(path) == ["HEARTBEAT", "UNKNOWN_350"]
    log = read_log(path)
    assert log.tables["DEBUG_FLOAT_ARRAY"]["data"].tolist() == [[1.5] * 58]
    assert not log.losses.any


def test_an_unknown_message_whose_crc_cannot_be_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One bit of a heartbeat's id is flipped: no crc_extra at all gives its CRC, so it is damage."""
    monkeypatch.setenv("MAVLINK20", "1")
    damaged = bytearray(heartbeat(v2))
    damaged[9] ^= 0x80
    path = log_of(tmp_path / "flipped.tlog", heartbeat(v2), bytes(damaged), heartbeat(v2))
    assert types_by_pymavlink(path) == ["HEARTBEAT", f"UNKNOWN_{0x80 << 16}", "HEARTBEAT"]
    log = read_log(path)
    assert log.unknown == {}
    assert log.losses.bytes_skipped == 8 + len(damaged)
    assert len(log.tables["HEARTBEAT"]) == 2
