"""Logs that were converted to text, and logs without time stamps."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.log import Decoder
from mavhums.log.mavlink.decoder import Intake
from mavhums.log.mavlink.dialect import load_dialect
from tests.log.decode import decode, frames_in
from tests.logs import packed
from tests.strategies import Record, blocks, cuts, records


def passed(data: bytes, places: list[int]) -> tuple[bytes, Intake]:
    intake = Intake(load_dialect())
    out = b"".join(intake.feed(block) for block in blocks(data, places))
    return out + intake.feed(b"", final=True), intake


def lines(count: int = 30) -> bytes:
    """Records in which every byte value occurs, line feeds and carriage returns among them."""
    return packed([v2.MAVLink_tunnel_message(1, 1, 0, 128, [10, 13, 10, *range(125)])] * count, step_us=1)


@given(records(), st.data())
@settings(max_examples=60, deadline=None)
def test_a_sound_log_passes_unchanged(log: list[Record], data: st.DataObject) -> None:
    whole = b"".join(record.data for record in log)
    out, intake = passed(whole, data.draw(cuts(len(whole))))
    assert out == whole
    assert (intake.stamp, intake.line_ends) == (8, 0)


@given(st.data())
@settings(max_examples=30, deadline=None)
def test_a_conversion_to_text_is_undone_byte_for_byte(data: st.DataObject) -> None:
    whole = lines()
    damaged = whole.replace(b"\n", b"\r\n")
    out, intake = passed(damaged, data.draw(cuts(len(damaged))))
    assert out == whole
    assert intake.line_ends == whole.count(b"\n")
    decoder = Decoder()
    assert len(decoder.feed(damaged, final=True)["TUNNEL"]) == 30
    assert decoder.losses.line_ends_restored == whole.count(b"\n")
    assert not decoder.losses.any


def test_text_that_the_log_carries_is_no_conversion() -> None:
    """Every frame holds a carriage return and a line feed, as a serial tunnel would."""
    link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    frame = bytes(v2.MAVLink_statustext_message(6, b"ready\r\n").pack(link))
    stamps = (int.from_bytes(b"\0\5\x99\1\1\1\x20\0") + 256 * k for k in range(200))
    whole = b"".join(struct.pack(">Q", stamp) + frame for stamp in stamps)
    assert b"\n" not in whole.replace(b"\r\n", b"")
    out, intake = passed(whole, [])
    assert out == whole
    assert intake.line_ends == 0


def test_what_is_held_back_is_bounded() -> None:
    intake = Intake(load_dialect())
    held = len(b"\r\n") + 70_000
    assert len(intake.feed(b"\0\r\n" + b"x" * 70_000)) == 1 + held


@pytest.mark.parametrize("count", [1, 3, 30])
def test_frames_back_to_back_are_recognised(count: int) -> None:
    whole = lines(count)
    raw = b"".join(frames_in(whole))
    out, intake = passed(raw, list(range(0, len(raw), 7)))
    assert out == raw
    assert intake.stamp == 0
    assert passed(whole, [])[1].stamp == 8


def test_a_log_that_lost_its_first_stamp_has_stamps() -> None:
    assert passed(lines()[8:], [])[1].stamp == 8


def capture(count: int = 200) -> bytes:
    """Frames back to back, as a serial line carries them."""
    attitudes = (v2.MAVLink_attitude_message(1000 + 100 * k, 0.1, 0.2, 0.3, 0, 0, 0) for k in range(count))
    return b"".join(frames_in(packed(attitudes)))


BEGINNINGS = {
    "boot text": b"\r\n\r\nInit ArduPlane V4.5.7 (0fe2a2b6)\r\n\r\nFree RAM: 65535\r\n",
    "a newline": b"\n",
    "amid a frame": capture(1)[11:],
    "amid a frame, at a magic byte": b"\xfd" + capture(1)[20:],
    "boot text of a kilobyte": b"x" * 3000,
}


@pytest.mark.parametrize("beginning", BEGINNINGS.values(), ids=BEGINNINGS.keys())
@pytest.mark.parametrize("size", [7, 1000, 1 << 20])
def test_a_capture_that_does_not_begin_on_a_frame_is_read(beginning: bytes, size: int) -> None:
    whole = beginning + capture()
    tables, decoder = decode(whole, range(size, len(whole), size))
    assert len(tables["ATTITUDE"]) == 200
    assert decoder.undated
    assert decoder.losses.bytes_skipped == len(beginning)


def test_a_log_that_begins_amid_a_record_keeps_its_times() -> None:
    tables, decoder = decode(lines()[5:])
    assert len(tables["TUNNEL"]) in (29, 30)
    assert not decoder.undated
