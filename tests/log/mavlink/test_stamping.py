"""Pieces of links into records, whatever the pieces."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.log import Decoder
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.stamping import Piece, Stamper
from tests.log.decode import frames_in
from tests.strategies import START_US, Record, blocks, cuts, records


def pieces_of(sender: str, sent: list[Record], places: list[int]) -> list[Piece]:
    stream = b"".join(record.data[8:] for record in sent)
    return [Piece(sender, START_US + 10 * k, part) for k, part in enumerate(blocks(stream, places)) if part]


@pytest.mark.slow
@given(one=records(), other=records(), data=st.data())
@settings(max_examples=80, deadline=None)
def test_every_frame_becomes_a_record_however_it_is_cut(
    one: list[Record], other: list[Record], data: st.DataObject
) -> None:
    """Two senders, each cut anywhere, the pieces of both interleaved and fed in any blocks."""
    stamper, pieces = Stamper(load_dialect()), []
    for name, sent in (("one", one), ("other", other)):
        pieces += pieces_of(name, sent, data.draw(cuts(sum(len(record.data) - 8 for record in sent))))
    pieces.sort(key=lambda piece: piece.time_us)
    bounds = [0, *data.draw(cuts(len(pieces))), len(pieces)]
    out = b"".join(stamper.feed(pieces[a:b]) for a, b in itertools.pairwise(bounds))
    out += stamper.close(START_US + 1000)
    assert sorted(frames_in(out)) == sorted(record.data[8:] for record in one + other)
    decoder = Decoder()
    decoder.feed(out, final=True)
    assert sum(decoder.counts.values()) == len(one + other)
    assert not decoder.losses.any
    assert stamper.counts.bytes_skipped == 0


@given(sent=records(max_size=6), data=st.data())
@settings(max_examples=40, deadline=None)
def test_a_record_bears_the_time_of_the_piece_that_completed_it(
    sent: list[Record], data: st.DataObject
) -> None:
    size = sum(len(record.data) - 8 for record in sent)
    pieces = pieces_of("one", sent, data.draw(cuts(size)))
    stamper = Stamper(load_dialect())
    out = stamper.feed(pieces) + stamper.close(START_US + 1000)
    ends = np.cumsum([len(piece.data) for piece in pieces])
    place = position = 0
    for record in sent:
        position += len(record.data) - 8
        stamp = int.from_bytes(out[place : place + 8], "big")
        assert stamp == pieces[int(np.searchsorted(ends, position))].time_us
        place += len(record.data)


@given(st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=300)), max_size=20))
@settings(max_examples=100, deadline=None)
def test_any_bytes_are_survived_and_accounted_for(noise: list[tuple[int, bytes]]) -> None:
    stamper = Stamper(load_dialect())
    out = b""
    for k, (sender, data) in enumerate(noise):
        out += stamper.feed([Piece(sender, START_US + k, data)])
    out += stamper.close(START_US + 1000)
    counts = stamper.counts
    frames = frames_in(out)
    assert counts.frames == len(frames)
    assert counts.bytes == counts.bytes_skipped + sum(map(len, frames))


def test_the_frame_with_a_bad_crc_is_never_mended() -> None:
    """A log may hold frames whose zeros were trimmed; on a link a bad CRC is a bit error."""
    from fastcrc import crc16

    extra, payload = 39, b"\x01\x00\x00\x00\x00\x00\x00\x00\x07"
    head = bytes([len(payload), 0, 0, 0, 1, 1, 30, 0, 0])
    padded = bytes([28]) + head[1:] + payload.ljust(28, b"\0") + bytes([extra])
    frame = b"\xfd" + head + payload + crc16.mcrf4xx(padded).to_bytes(2, "little")
    decoder = Decoder()
    stamped = START_US.to_bytes(8, "big") + frame
    decoder.feed(stamped * 2, final=True)
    assert decoder.losses.padded_frames > 0
    stamper = Stamper(load_dialect())
    assert stamper.feed([Piece(0, START_US, frame * 2)]) + stamper.close(START_US) == b""
    assert stamper.counts.bad_crc_frames >= 1


def test_senders_beyond_the_limit_are_forgotten_with_their_halves() -> None:
    stamper = Stamper(load_dialect())
    for k in range(1000):
        stamper.feed([Piece(k, START_US + k, b"\xfd\x20half")])
    assert len(stamper._streams) == 64
    stamper.close(START_US)
    assert stamper.counts.bytes_skipped == stamper.counts.bytes == 6000
