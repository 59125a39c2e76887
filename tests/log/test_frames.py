"""Framing and decoding against pymavlink as an oracle, on any log that Hypothesis can think of."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.log import Decoder, Table
from mavhums.log.frames import Frame, FrameScanner
from tests.strategies import START_US, Record, blocks, cuts, records


def scan(data: bytes) -> tuple[list[Frame], FrameScanner]:
    scanner = FrameScanner()
    return list(scanner.feed(data, final=True)), scanner


def same(ours: Any, message: Any, field: str) -> bool:
    raw = getattr(message, f"_{field}_raw", None)
    if raw is not None:
        return bytes(ours) == bytes(raw).rstrip(b"\0")
    return np.array_equal(np.asarray(getattr(message, field), dtype=ours.dtype), ours)


@given(records())
@settings(max_examples=150, deadline=None)
def test_every_frame_is_found_and_every_field_is_right(log: list[Record]) -> None:
    decoder = Decoder()
    tables = decoder.feed(b"".join(record.data for record in log), final=True)
    assert not decoder.losses.any
    rows: dict[int, tuple[Table, int]] = {}
    for table in tables.values():
        for row, frame in enumerate(table.frame):
            rows[int(frame)] = (table, row)
    assert sorted(rows) == list(range(len(log)))
    for ordinal, record in enumerate(log):
        table, row = rows[ordinal]
        assert table.name == record.message.get_type()
        assert table.time_us[row] == record.time_us
        assert table.system[row] == record.system
        for field in record.message.fieldnames:
            assert same(table[field][row], record.message, field), field


@given(records(), st.data())
@settings(max_examples=80, deadline=None)
def test_where_blocks_end_does_not_matter(log: list[Record], data: st.DataObject) -> None:
    whole = b"".join(record.data for record in log)
    noise = data.draw(st.binary(max_size=40))
    place = data.draw(st.integers(0, len(whole)))
    damaged = whole[:place] + noise + whole[place:]
    expected, reference = scan(damaged)
    scanner = FrameScanner()
    found = []
    for block in blocks(damaged, data.draw(cuts(len(damaged)))):
        found += list(scanner.feed(block))
    found += list(scanner.feed(b"", final=True))
    assert found == expected
    assert scanner.losses == reference.losses


@given(records(min_size=2), st.binary(min_size=1, max_size=60), st.data())
@settings(max_examples=80, deadline=None)
def test_noise_between_records_costs_nothing_but_itself(
    log: list[Record], noise: bytes, data: st.DataObject
) -> None:
    before = data.draw(st.integers(1, len(log) - 1))
    parts = [record.data for record in log]
    found, scanner = scan(b"".join([*parts[:before], noise, *parts[before:]]))
    assert [frame.time_us for frame in found] == [record.time_us for record in log]
    assert scanner.losses.bytes_skipped == len(noise)
    assert scanner.losses.damaged_regions == 1


@given(records(min_size=2), st.data())
@settings(max_examples=80, deadline=None)
def test_a_flipped_bit_costs_one_frame_at_most(log: list[Record], data: st.DataObject) -> None:
    victim = data.draw(st.integers(0, len(log) - 1))
    record = log[victim].data
    bit = data.draw(st.integers(8 * 8, len(record) * 8 - 1))
    assume(not (record[8] == 0xFD and record[10] & 1 and bit // 8 >= len(record) - 13))
    damaged = bytearray(record)
    damaged[bit // 8] ^= 1 << (bit % 8)
    parts = [bytes(damaged) if k == victim else r.data for k, r in enumerate(log)]
    found, scanner = scan(b"".join(parts))
    others = [r.time_us for k, r in enumerate(log) if k != victim]
    # A flip in the message id can make a frame of an unknown message, whose CRC nobody can check.
    assert [frame.time_us for frame in found] == others
    assert scanner.losses.any or scanner.unknown


@given(records(), st.data())
@settings(max_examples=50, deadline=None)
def test_a_cut_last_record_is_told(log: list[Record], data: st.DataObject) -> None:
    last = log[-1].data
    kept = data.draw(st.integers(1, len(last) - 1))
    found, scanner = scan(b"".join(record.data for record in log[:-1]) + last[:kept])
    assert len(found) == len(log) - 1
    assert scanner.losses.cut_end_bytes == kept
    assert scanner.losses.bytes_skipped == 0


@given(st.binary(max_size=4000))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_read_to_the_end(data: bytes) -> None:
    found, scanner = scan(data)
    losses = scanner.losses
    assert losses.bytes_skipped + losses.cut_end_bytes <= len(data)
    if not found and not scanner.unknown:
        assert losses.bytes_skipped + losses.cut_end_bytes == len(data)


def heartbeats(times_us: list[int]) -> bytes:
    link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    out = b""
    for time_us in times_us:
        message = v2.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
        out += struct.pack(">Q", time_us) + bytes(message.pack(link))
    return out


@pytest.mark.parametrize("bit", [45, 50, 55, 62])
@pytest.mark.parametrize("place", [0, 3, 9])
def test_a_flipped_time_bit_does_not_move_the_log(bit: int, place: int) -> None:
    times = [START_US + 1_000_000 * k for k in range(10)]
    damaged = times.copy()
    damaged[place] ^= 1 << bit
    found, scanner = scan(heartbeats(damaged))
    assert len(found) == 10
    assert scanner.losses.implausible_times >= 1
    if place:
        assert all(abs(frame.time_us - time) <= 1_000_000 for frame, time in zip(found, times, strict=True))


def test_a_clock_that_was_set_is_followed() -> None:
    later = START_US + 400 * 86_400 * 1_000_000
    times = [START_US, START_US + 1, later, later + 1, later + 2]
    found, _ = scan(heartbeats(times))
    assert [frame.time_us for frame in found][-2:] == times[-2:]


def test_unknown_messages_are_counted_in_step_only() -> None:
    def unknown(payload: bytes) -> bytes:
        header = bytes([0xFD, len(payload), 0, 0, 7, 1, 1]) + (9_999_999).to_bytes(3, "little")
        return struct.pack(">Q", START_US) + header + payload + b"\x12\x34"

    beat = heartbeats([START_US])
    _, scanner = scan(beat + unknown(b"abc") + beat)
    assert scanner.unknown == {9_999_999: 1}
    assert not scanner.losses.any
    _, scanner = scan(beat + unknown(b"abc"))
    assert scanner.unknown == {9_999_999: 1}
    _, scanner = scan(beat + b"\0" + unknown(b"abc") + beat)
    assert scanner.unknown == {}
    assert scanner.losses.bytes_skipped == 1 + len(unknown(b"abc"))


def test_a_frame_with_an_unknown_flag_is_refused() -> None:
    beat = bytearray(heartbeats([START_US]))
    beat[10] = 0x02
    found, scanner = scan(bytes(beat) + heartbeats([START_US]))
    assert len(found) == 1
    assert scanner.losses.bytes_skipped == len(beat)


def test_wanted_messages_alone_are_unpacked_but_all_are_counted() -> None:
    decoder = Decoder({"ATTITUDE"})
    assert decoder.feed(heartbeats([START_US, START_US + 1]), final=True) == {}
    assert decoder.counts == {(1, 1, "HEARTBEAT"): 2}
    assert (decoder.first_time_us, decoder.last_time_us) == (START_US, START_US + 1)


def test_a_longer_payload_than_the_dialect_knows_is_cut() -> None:
    """A newer dialect may have appended an extension; MAVLink says to ignore what one does not know."""
    from fastcrc import crc16

    payload = bytes(range(1, 30))
    head = bytes([len(payload), 0, 0, 0, 1, 1, 0, 0, 0])
    crc = crc16.mcrf4xx(head + payload + bytes([50]))
    record = struct.pack(">Q", START_US) + b"\xfd" + head + payload + crc.to_bytes(2, "little")
    table = Decoder().feed(record, final=True)["HEARTBEAT"]
    assert table["custom_mode"].tolist() == [int.from_bytes(payload[:4], "little")]
    assert np.array_equal(table["type"], [payload[4]])
