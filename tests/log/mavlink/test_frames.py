"""Framing and decoding against pymavlink as an oracle, on any log that Hypothesis can think of."""

from __future__ import annotations

import itertools
import struct
import tracemalloc

import numpy as np
import pytest
from fastcrc import crc16
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.log import Decoder
from mavhums.log.base.decoder import PADDED
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.scanner import FrameScanner
from tests.log.decode import assert_cuts_do_not_matter, decode, differing_fields
from tests.log.mavlink.kernel_check import checked, frames_of, scan
from tests.log.mavlink.synthetic import sealed
from tests.strategies import START_US, Record, cuts, records

DAY_US = 86_400_000_000


@given(records())
@settings(max_examples=150, deadline=None)
def test_every_frame_is_found_and_every_field_is_right(log: list[Record]) -> None:
    decoder = Decoder()
    tables = decoder.feed(b"".join(record.data for record in log), final=True)
    assert not decoder.losses.any
    assert sorted(frame for table in tables.values() for frame in table.frame) == [*range(len(log))]
    for table in tables.values():
        sent = [log[frame] for frame in table.frame]
        assert {record.message.get_type() for record in sent} == {table.name}
        assert table.time_us.tolist() == [record.time_us for record in sent]
        assert table.system.tolist() == [record.system for record in sent]
        for row, record in enumerate(sent):  # MAVLink 1 has fewer fields
            assert differing_fields(table.select(np.array([row])), [record.message]) == []


@pytest.mark.slow
@given(records(), st.data())
@settings(max_examples=80, deadline=None)
def test_where_blocks_end_does_not_matter(log: list[Record], data: st.DataObject) -> None:
    whole = b"".join(record.data for record in log)
    noise = data.draw(st.binary(max_size=40))
    place = data.draw(st.integers(0, len(whole)))
    damaged = bytearray(whole[:place] + noise + whole[place:])
    for _ in range(data.draw(st.integers(0, 3))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] ^= data.draw(st.integers(1, 255))
    assert_cuts_do_not_matter(bytes(damaged), data.draw(cuts(len(damaged))))


@given(records(max_size=4), st.sampled_from(["as it is", "as text", "back to back"]))
@settings(max_examples=25, deadline=None)
def test_blocks_of_one_byte_are_as_good_as_the_whole(log: list[Record], form: str) -> None:
    data = b"".join(record.data[8:] if form == "back to back" else record.data for record in log)
    if form == "as text":
        data = data.replace(b"\n", b"\r\n")
    assert_cuts_do_not_matter(data, range(1, len(data)))


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
    # A flip in the id can make a frame of an unknown message that some crc_extra fits.
    ids = load_dialect().definitions
    certain = [frame for frame in found if frame.id in ids and not frame.padded]
    assert [frame.time_us for frame in certain] == others
    assert len(found) > len(certain) or scanner.totals.skipped or scanner.totals.cut_end


@pytest.mark.slow
@given(records(), st.data())
@settings(max_examples=50, deadline=None)
def test_a_cut_last_record_is_reported(log: list[Record], data: st.DataObject) -> None:
    last = log[-1].data
    kept = data.draw(st.integers(1, len(last) - 1))
    zeros = data.draw(st.sampled_from([0, 16, 5000]))
    rest = last[:kept].rstrip(b"\0")
    signed = last[8] == 0xFD and last[10] == 1
    assume(rest and not (signed and zeros))
    found, scanner = scan(b"".join(record.data for record in log[:-1]) + rest + bytes(zeros))
    assert len(found) == len(log) - 1
    assert (scanner.totals.cut_end, scanner.totals.filler) == (len(rest), zeros)
    assert scanner.totals.skipped == 0


@given(records(), st.integers(289, 5000))
@settings(max_examples=20, deadline=None)
def test_a_tail_too_long_for_a_record_is_damage(log: list[Record], size: int) -> None:
    whole = b"".join(record.data for record in log)
    _, scanner = scan(whole + b"\x55" * size)
    assert scanner.regions == [(len(whole), size)]
    assert scanner.totals.cut_end == 0


@given(st.binary(max_size=4000), st.sampled_from([0, 8]))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_read_to_the_end(data: bytes, stamp: int) -> None:
    checked(data, stamp=stamp)


def heartbeats(times_us: list[int], ahead: int = 0, component: int = 1) -> bytes:
    """Heartbeats of equal sequence numbers, so many after the first."""
    link = v2.MAVLink(None, srcSystem=1, srcComponent=component)
    link.seq = ahead
    frame = bytes(v2.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3).pack(link))
    return b"".join(struct.pack(">Q", time_us) + frame for time_us in times_us)


# At either end of a log a step of up to a day is as likely a pause as damage.
@pytest.mark.parametrize(
    ("bit", "place"),
    [*itertools.product([28, 32], [1, 3]), *itertools.product([37, 45, 50, 55, 62], [0, 1, 3, 9])],
)
def test_a_flipped_time_bit_does_not_move_the_log(bit: int, place: int) -> None:
    times = [START_US + 1_000_000 * k for k in range(10)]
    damaged = times.copy()
    damaged[place] ^= 1 << bit
    found, scanner = checked(heartbeats(damaged))
    assert scanner.totals.odd_times == 1
    assert [frame.odd_time for frame in found] == [k == place for k in range(10)]
    assert max(abs(frame.time_us - time) for frame, time in zip(found, times, strict=True)) <= 1_000_000
    assert scanner.totals.jumps == scanner.totals.rewinds == 0


LATER_US = START_US + 4 * DAY_US


@pytest.mark.parametrize(
    ("times_us", "first_us"),
    [
        ([START_US, LATER_US], START_US),
        ([START_US, LATER_US, LATER_US + 1], LATER_US),
        ([START_US, LATER_US, START_US + 1], START_US),
        ([START_US, LATER_US, 2**63 + 5], START_US),  # a time that cannot be judges nothing
        ([2**63 + 5, START_US], START_US),
        ([2**63 + 5], 946_684_800_000_000),
    ],
)
def test_the_first_time_is_judged_by_the_next_two(times_us: list[int], first_us: int) -> None:
    first = checked(heartbeats(times_us))[0][0]
    assert (first.time_us, first.odd_time) == (first_us, first_us != times_us[0])


def unknown(number: int = 9_999_999, seed: int = 77) -> bytes:
    head = bytes([3, 0, 0, 7, 1, 1]) + number.to_bytes(3, "little")
    return struct.pack(">Q", START_US) + b"\xfd" + sealed(head + b"abc", seed)


def test_unknown_messages_are_counted_in_step_only() -> None:
    beat = heartbeats([START_US])
    for log in (beat + unknown() + beat, beat + unknown()):
        found, scanner = checked(log)
        assert [frame.id for frame in found if frame.id] == [9_999_999]
        assert not scanner.regions
    _, scanner = checked(beat + b"\0" + unknown() + beat)
    assert scanner.regions == [(len(beat), 1 + len(unknown()))]


def test_an_unknown_message_whose_crc_no_definition_could_give_is_damage() -> None:
    beat, kept = heartbeats([START_US]), 0
    for flipped in range(256):
        damaged = bytearray(unknown())
        damaged[-2] ^= flipped
        kept += len(checked(beat + bytes(damaged) + beat)[0]) == 3
    assert kept == 1


def test_a_frame_with_an_unknown_flag_is_refused() -> None:
    beat = bytearray(heartbeats([START_US]))
    beat[10] = 0x02
    found, scanner = scan(bytes(beat) + heartbeats([START_US]))
    assert len(found) == 1
    assert scanner.totals.skipped == len(beat)


@pytest.mark.parametrize(
    ("later_us", "ahead", "component", "found"),
    [
        (DAY_US, 9, 1, True),
        (-DAY_US, 0, 1, True),
        (DAY_US + 1, 9, 1, False),
        (-DAY_US - 1, 0, 1, False),
        (-START_US, 1, 1, True),
        (-START_US, 8, 1, True),
        (-START_US, 8, 2, False),
    ],
)
def test_out_of_step_a_near_time_or_one_of_the_next_eight_numbers_confirms_a_frame(
    later_us: int, ahead: int, component: int, found: bool
) -> None:
    after = b"noise" + heartbeats([START_US + later_us], ahead, component) + b"noise, again noise"
    assert len(checked(heartbeats([START_US]) + after)[0]) == 1 + found


@pytest.mark.parametrize(
    ("times_s", "odd", "jumps", "rewinds"),
    [
        ([0, 60, 60], 0, 0, 0),
        ([0, 10, 80, 270, 640], 0, 3, 0),  # silence is no damage
        ([0, 61, 61], 0, 1, 0),
        ([0, 60.9, 1], 0, 1, 1),
        ([0, 61.1, 1], 1, 0, 0),  # a detour of more than two minutes
        ([0, -59, 1], 0, 0, 1),
        ([0, -60.1, 1], 1, 0, 0),
        ([2, 1], 0, 0, 0),
        ([2, 0.9], 0, 0, 1),
        ([0, 86_400], 0, 1, 0),
        ([0, 86_401], 1, 0, 0),  # nothing follows that distinguishes a pause from damage
        ([0, 1, 200_000, 200_001], 0, 1, 0),
        ([0, 200_000, 200_001], 1, 0, 0),  # the third is nearer to the second
    ],
)
def test_a_time_stamp_is_damaged_where_it_makes_a_detour(
    times_s: list[float], odd: int, jumps: int, rewinds: int
) -> None:
    totals = checked(heartbeats([START_US + round(1e6 * second) for second in times_s]))[1].totals
    assert (totals.odd_times, totals.jumps, totals.rewinds) == (odd, jumps, rewinds)


def test_a_frame_without_its_time_stamp_is_found() -> None:
    beat, stampless = heartbeats([START_US]), heartbeats([START_US], 1)[8:]
    for log, at in ((beat + stampless + beat, 1), (beat + stampless, 1), (stampless + beat, 0)):
        found, scanner = checked(log)
        assert found[at].odd_time
        assert found[at].time_us == START_US
        assert not scanner.regions


def trimmed_after_crc(size: int) -> bytes:
    """A HEARTBEAT of nine bytes, then MAVLink's CRC of all of it, but only ``size`` bytes of payload."""
    payload = bytes([0, 0, 0, 0, 1, 3, 0, 0, 0])
    head = bytes([9, 0, 0, 7, 1, 1, 0, 0, 0])
    crc = crc16.mcrf4xx(head + payload + bytes([50]))
    head = bytes([size]) + head[1:]
    return struct.pack(">Q", START_US) + b"\xfd" + head + payload[:size] + crc.to_bytes(2, "little")


def test_a_frame_that_was_trimmed_after_its_crc_is_taken_and_flagged() -> None:
    beat = heartbeats([START_US])
    found, scanner = checked(beat + trimmed_after_crc(6) + beat)
    assert [frame.padded for frame in found] == [False, True, False]
    assert scanner.totals.trials == 1
    tables, decoder = decode(beat + trimmed_after_crc(6) + beat)
    assert tables["HEARTBEAT"].flags.tolist() == [0, PADDED, 0]
    assert tables["HEARTBEAT"]["autopilot"].tolist() == [3, 3, 3]
    assert decoder.losses.padded_frames == 1
    assert decoder.losses.padded_false_bound == 1 / 65536
    assert decoder.losses.any


def test_out_of_step_no_padding_is_tried() -> None:
    beat = heartbeats([START_US])
    assert len(checked(beat + b"\0" + trimmed_after_crc(6) + beat)[0]) == 2
    assert len(checked(beat + trimmed_after_crc(6) + b"\0" + beat)[0]) == 2


def test_a_longer_payload_than_the_dialect_knows_is_cut() -> None:
    """A newer dialect may have appended an extension; MAVLink says to ignore what one does not know."""
    payload = bytes(range(1, 30))
    head = bytes([len(payload), 0, 0, 0, 1, 1, 0, 0, 0])
    record = struct.pack(">Q", START_US) + b"\xfd" + sealed(head + payload, 50)
    table = Decoder().feed(record, final=True)["HEARTBEAT"]
    assert table["custom_mode"].tolist() == [int.from_bytes(payload[:4], "little")]
    assert np.array_equal(table["type"], [payload[4]])


def test_offsets_beyond_four_gigabytes() -> None:
    """A stream that has already run for five gigabytes, as the scanner carries it."""
    beats = heartbeats([START_US + k for k in range(100)])
    scanner = FrameScanner(load_dialect())
    scanner._carried["base"] = base = 5 * 2**30
    batch = scanner.feed(beats[:1000] + b"noise" + beats[1000:], final=True)
    assert batch.rows.size == 99
    assert int(batch.rows["offset"][-1]) == base + 5 + 99 * 29
    assert scanner.regions == [(base + 34 * 29, 29 + 5)]
    assert frames_of(batch)[-1].payload == beats[-11:-2]


def test_memory_of_a_stream_does_not_grow() -> None:
    beats = heartbeats([START_US + k for k in range(2000)])
    decoder = Decoder(["ATTITUDE"])
    decoder.feed(beats)
    tracemalloc.start()
    for _ in range(200):
        decoder.feed(beats)
    grown, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 50_000
    assert peak < 20 * len(beats)
