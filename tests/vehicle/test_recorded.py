"""Two recordings of one flight have one identity; two flights have not."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums import analyse
from mavhums.log import Decoder
from mavhums.results.sections import FlightIdentity
from mavhums.vehicle.identity import Identities
from mavhums_sim import Flight, fly, write_dataflash, write_tlog
from mavhums_sim.link import BOOT_US, EPOCH_US, Link
from tests.log.dataflash.synthetic import definition, fmt_of_fmt, record
from tests.log.ulog import writer
from tests.logs import packed
from tests.strategies import START_US
from tests.vehicle.tables import version


def heard(*messages: object) -> Identities:
    identities = Identities()
    identities.feed(Decoder().feed(packed(messages, step_us=0), final=True))
    return identities


TEXT = v2.MAVLink_statustext_message(6, b"CubeOrange 00112233 44556677 8899AABB")


def test_the_board_says_the_same_in_a_message_and_in_a_text() -> None:
    message = version(uid2=bytes(range(0, 0xBC, 0x11)))
    assert heard(TEXT).of(1).board == heard(message).of(1).board == "00112233445566778899AABB"


def test_px4s_board_is_the_same_in_a_message_and_in_a_ulog() -> None:
    uid = bytes([0, 6, 0, 0, 0, 0, *range(0x30, 0x3C)])
    board = writer.keyed("I", "char[36] sys_uuid", uid.hex().encode())
    log = writer.flight(1.0).replace(writer.keyed("I", "char[3] sys_name", b"PX4"), board)
    identities = Identities()
    identities.feed(Decoder().feed(log, final=True))
    assert identities.of(7).board == heard(version(uid2=uid)).of(1).board == uid.hex().upper()


def test_simulated_boards_are_known() -> None:
    texts = (first + b"d1219c7c4c5404aaa1f6d2a48adfda4" for first in (b"4", b"V", b";"))
    ids = {heard(v2.MAVLink_statustext_message(6, text)).of(1).board for text in texts}
    assert len(ids) == 3
    assert all(str(board).endswith(" D1219C7C4C5404AAA1F6D2A48ADFDA4") for board in ids)


def test_a_serial_number_replaces_a_board_that_is_not_recorded() -> None:
    serial, unset, boots = (
        v2.MAVLink_param_value_message(name, value, 9, 1, 0)
        for name, value in ((b"BRD_SERIAL_NUM", 17.0), (b"BRD_SERIAL_NUM", 0.0), (b"STAT_BOOTCNT", 205.0))
    )
    for said, board, count in (
        ([serial], "serial 17", None),
        ([boots], None, 205),
        ([boots, serial], "serial 17", 205),
        ([unset], None, None),
        ([serial, TEXT], "00112233445566778899AABB", None),
    ):
        who = heard(*said).of(1)
        assert (who.board, who.boots) == (board, count)


def test_the_satellites_time_goes_before_that_of_reception() -> None:
    time = v2.MAVLink_system_time_message(START_US + 7_000_000, 4000)
    attitude = v2.MAVLink_attitude_message(4000, 0, 0, 0, 0, 0, 0)
    assert heard(attitude).boot(1) == (None, START_US - 4_000_000)
    assert heard(attitude, time).boot(1).dated_us == START_US + 3_000_000
    assert heard(v2.MAVLink_system_time_message(0, 4000)).boot(1) == (None, None)


def test_one_flight_recorded_twice_is_one_flight(tmp_path: Path) -> None:
    flown = fly(Flight(duration_s=3.0, rate_hz=20.0, tiers=("pwm",)))
    sent, logged, later = (tmp_path / name for name in ("a.tlog", "a.BIN", "b.BIN"))
    write_tlog(flown, sent, Link(day=1.0))
    write_dataflash(flown, logged, day=1.0)
    write_dataflash(flown, later, day=1.0 + 120 / 86_400)
    logs = {path: analyse(path).log for path in (sent, logged, later)}
    identities: dict[Path, FlightIdentity] = {path: log.flight[0] for path, log in logs.items()}
    assert [logs[path].format for path in logs] == ["tlog", "dataflash", "dataflash"]
    assert identities[sent].board == identities[logged].board == "4D415648554D5353494D0001"
    assert identities[sent].is_same(identities[logged])
    assert not identities[sent].is_same(identities[later])
    boot = datetime.fromisoformat(str(identities[logged].boot_utc)).timestamp()
    assert boot == pytest.approx((EPOCH_US + 86_400_000_000 - BOOT_US) / 1e6, abs=0.01)


def test_an_undated_log_is_no_known_flight(tmp_path: Path) -> None:
    path = tmp_path / "undated.BIN"
    text = record(5, "QZ", [1000, b"CubeOrange 00112233 44556677 8899AABB"])
    path.write_bytes(fmt_of_fmt() + definition(5, "MSG", "QZ", "TimeUS,Message") + text * 3)
    [identity] = analyse(path).log.flight
    assert identity.board == "00112233445566778899AABB"
    assert identity.boot_utc is identity.start_utc is None
    assert not identity.is_same(identity)


@pytest.mark.parametrize("text", [b"EKF3 IMU0 is using GPS", b"00112233 44556677 8899AABB", b"A B C D"])
def test_other_texts_are_no_board(text: bytes) -> None:
    assert heard(v2.MAVLink_statustext_message(6, text)).of(1).board is None
