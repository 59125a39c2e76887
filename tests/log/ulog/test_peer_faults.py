"""Where ours and pyulog 1.3 differ, and who is right: each log here is sound, or says what it lost."""

from __future__ import annotations

import struct

import pytest

from tests.log.decode import decode
from tests.log.ulog import writer
from tests.log.ulog.peer import columns_of_peer

AIRSPEED = writer.form("airspeed", "uint64_t timestamp;float speed;uint8_t[4] _padding0;")


def row(time_us: int, speed: float, number: int = 1, padding: int = 0) -> bytes:
    return writer.data(number, struct.pack("<Qf", time_us, speed) + bytes(padding))


def speeds_of_peer(log: bytes) -> list[float]:
    columns = columns_of_peer(log).get(("airspeed", 0))
    return [] if columns is None else columns["speed"].tolist()


def speeds_of_ours(log: bytes) -> list[float]:
    tables, decoder = decode(log)
    assert not decoder.losses.any
    return list(tables["airspeed"]["speed"].tolist())


@pytest.mark.parametrize("padding", [1, 4])
def test_records_with_their_padding_are_records(padding: int) -> None:
    log = writer.header() + AIRSPEED + writer.subscribe(1, "airspeed") + row(1_000_001, 12.5, padding=padding)
    assert speeds_of_peer(log) == []
    assert speeds_of_ours(log) == [12.5]


def test_an_id_that_is_subscribed_again_keeps_its_earlier_records() -> None:
    again = writer.message("R", struct.pack("<H", 1)) + writer.subscribe(1, "airspeed")
    log = writer.header() + AIRSPEED + writer.subscribe(1, "airspeed") + row(1_000_001, 12.5)
    log += again + row(1_000_002, 13.5)
    assert speeds_of_peer(log) == [13.5]
    assert speeds_of_ours(log) == [12.5, 13.5]


def test_data_behind_an_appended_offset_keeps_its_subscription() -> None:
    head = len(writer.header(appended=[1]))
    before = AIRSPEED + writer.subscribe(1, "airspeed") + row(1_000_001, 1.0)
    log = writer.header(appended=[head + len(before)]) + before + row(1_000_002, 2.0)
    assert speeds_of_peer(log) == [1.0]
    assert speeds_of_ours(log) == [1.0, 2.0]


def test_a_flipped_kind_costs_one_record_and_not_all_until_the_next_sync() -> None:
    rows = [row(1_000_000 + k, float(k)) for k in range(100)]
    rows[10] = rows[10][:2] + b"\0" + rows[10][3:]
    log = writer.header() + AIRSPEED + writer.subscribe(1, "airspeed") + b"".join(rows) + writer.sync()
    tables, decoder = decode(log)
    assert speeds_of_peer(log) == [float(k) for k in range(10)]
    assert tables["airspeed"]["speed"].tolist() == [float(k) for k in range(100) if k != 10]
    assert decoder.losses.bytes_skipped == len(rows[10])
    assert decoder.losses.damaged_regions == 1
