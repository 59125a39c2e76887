"""Signatures: pymavlink signs, and is the oracle of what a sound receiver accepts."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from mavhums.log import Decoder
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.scanner import FrameScanner
from mavhums.log.mavlink.signing import TICKS_PER_MINUTE, KeyFileError, SignatureGuard, load_key
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.link import Link
from tests.conftest import REAL_LOGS, Run, needs
from tests.strategies import START_US, blocks, cuts

KEY = bytes(range(32))
NOW = 10**9


class Signer:
    """One link of one component."""

    def __init__(self, key: bytes = KEY, *, system: int = 1, component: int = 1, link: int = 0) -> None:
        self._mav = v2.MAVLink(None, srcSystem=system, srcComponent=component)
        self._mav.signing.secret_key, self._mav.signing.sign_outgoing = key, True
        self._mav.signing.link_id = link

    def frame(self, ticks: int) -> bytes:
        self._mav.signing.timestamp = ticks
        return bytes(v2.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(self._mav))


def log_of(frames: list[bytes]) -> bytes:
    return b"".join((START_US + k).to_bytes(8, "big") + frame for k, frame in enumerate(frames))


def read(data: bytes, places: tuple[int, ...] = ()) -> tuple[int, int, int, int]:
    """Frames accepted, unsigned, wrongly signed, replayed."""
    decoder = Decoder(key=KEY)
    for block in blocks(data, list(places)):
        decoder.feed(block)
    decoder.feed(b"", final=True)
    losses = decoder.losses
    accepted = sum(decoder.counts.values())
    return accepted, losses.unsigned_frames, losses.bad_signatures, losses.replayed_frames


def test_a_signed_frame_counts_and_others_do_not() -> None:
    """One with another key and a forged time stamp does not block the true sender."""
    ours, theirs = Signer(), Signer(bytes(32))
    plain = bytes(v2.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(v2.MAVLink(None, 1, 1)))
    for ticks in (NOW + 1, 2**47):
        data = log_of([ours.frame(NOW), theirs.frame(ticks), plain, ours.frame(NOW + 2)])
        assert read(data) == (2, 1, 1, 0)


@pytest.mark.parametrize("place", [4, 10, -13, -10, -3])
def test_a_changed_bit_spoils_the_signature(place: int) -> None:
    """In sequence number, payload, link number, time stamp or signature; the CRC is made good again."""
    from fastcrc import crc16

    frame = bytearray(Signer().frame(NOW))
    frame[place] ^= 1
    extra = v2.MAVLink_attitude_message.crc_extra
    frame[-15:-13] = crc16.mcrf4xx(bytes(frame[1:-15]) + bytes([extra])).to_bytes(2, "little")
    assert read(log_of([bytes(frame)])) == (0, 0, 1, 0)


@pytest.mark.parametrize(("behind", "accepted"), [(TICKS_PER_MINUTE, 2), (TICKS_PER_MINUTE + 1, 1)])
def test_a_new_stream_may_be_a_minute_behind(behind: int, accepted: int) -> None:
    data = log_of([Signer().frame(NOW), Signer(system=2).frame(NOW - behind)])
    assert read(data)[0] == accepted


@given(
    sent=st.lists(
        st.tuples(st.integers(1, 2), st.integers(0, 1), st.integers(-(10**7), 10**7)), min_size=1, max_size=12
    ),
    data=st.data(),
)
@settings(max_examples=60, deadline=None)
def test_pymavlink_accepts_the_same(sent: list[tuple[int, int, int]], data: st.DataObject) -> None:
    """Honest senders in any order; wherever the log is cut."""
    signers = {(system, link): Signer(system=system, link=link) for system in (1, 2) for link in (0, 1)}
    frames = [signers[system, link].frame(NOW + ticks) for system, link, ticks in sent]
    receiver = v2.MAVLink(None)
    receiver.signing.secret_key, receiver.robust_parsing, receiver.signing.timestamp = KEY, True, 0
    oracle = 0
    for frame in frames:
        if receiver.parse_char(frame).get_type() == "ATTITUDE":
            oracle += 1
            ticks = int.from_bytes(frame[-12:-6], "little")
            receiver.signing.timestamp = max(receiver.signing.timestamp, ticks)
    content = log_of(frames)
    found = read(content, tuple(data.draw(cuts(len(content)))))
    assert found == (oracle, 0, 0, len(frames) - oracle)


def test_keys_come_raw_or_in_hexadecimal(tmp_path: Path) -> None:
    path = tmp_path / "key"
    for content in (KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"):
        path.write_bytes(content)
        assert load_key(path) == KEY


@pytest.mark.parametrize("content", [b"", b"secret", KEY[:31], KEY.hex().encode()[:-1], b"\xff" * 64])
def test_what_is_no_key_is_refused_with_the_remedy(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    with pytest.raises(KeyFileError, match="sha256sum"):
        load_key(path)


@needs(REAL_LOGS / "sitl")
def test_a_real_signed_link() -> None:
    """The autopilot signs all; the ground station's first frames came before it had the key."""
    log = REAL_LOGS / "sitl" / "plane_signed.link1.tlog"
    decoder, plain = Decoder(key=KEY), Decoder()
    data = log.read_bytes()
    decoder.feed(data, final=True)
    plain.feed(data, final=True)
    losses = decoder.losses
    assert (losses.unsigned_frames, losses.bad_signatures, losses.replayed_frames) == (67, 0, 0)
    assert sum(decoder.counts.values()) == sum(plain.counts.values()) - 67


@pytest.mark.slow
def test_analyse_takes_a_key(run: Run, tmp_path: Path) -> None:
    record = fly(Flight(seed=5, duration_s=16.0, rate_hz=25.0, friction_nm={"rudder": (1.0, 1.0)}))
    signed, key, other = tmp_path / "signed.tlog", tmp_path / "key", tmp_path / "other"
    write_tlog(record, signed, Link(key=KEY))
    key.write_text(KEY.hex())
    other.write_bytes(bytes(32))
    assessment = mavhums.analyse(signed, mavhums.Options(key=key))
    assert assessment.exit_code == run("analyse", signed, "--key", key).code == 11
    refused = run("analyse", signed, "--key", other)
    assert refused.code == 12
    assert "frames with a wrong signature" in refused.out
    pytest.importorskip("rerun")
    mavhums.record(assessment, tmp_path / "signed.rrd", mavhums.Options(key=KEY))
    assert (tmp_path / "signed.rrd").read_bytes().startswith(b"RRF")


STREAMS = st.tuples(st.integers(0, 2), st.integers(1, 2), st.integers(1, 2))
NEAR = st.integers(0, 3 * TICKS_PER_MINUTE)


def admitted(guard: SignatureGuard, frames: list[bytes]) -> list[bytes]:
    """Feed frames back to back, and return those that are admitted."""
    scanner = FrameScanner(load_dialect(), stamp=0)
    batch = scanner.feed(b"".join(frames), final=True)
    assert batch.rows.size == len(frames)
    return [frame for frame, new in zip(frames, guard.admit(batch), strict=True) if new]


@given(
    before=st.dictionaries(STREAMS, NEAR, max_size=4),
    sent=st.lists(st.tuples(STREAMS, NEAR), max_size=30),
)
@settings(max_examples=150, deadline=None)
def test_a_recording_is_admitted_whole_by_who_knows_of_nothing_before(
    before: dict[tuple[int, int, int], int], sent: list[tuple[tuple[int, int, int], int]]
) -> None:
    """The law of live and replay from the second session on; and nothing old is admitted."""
    signers = {stream: Signer(link=stream[0], system=stream[1], component=stream[2]) for stream, _ in sent}
    frames = [signers[stream].frame(NOW + ticks) for stream, ticks in sent]
    session = SignatureGuard(KEY, before={stream: NOW + ticks for stream, ticks in before.items()})
    recorded = admitted(session, frames)
    assert admitted(SignatureGuard(KEY), recorded) == recorded
    newest = {stream: NOW + ticks for stream, ticks in before.items()}
    times = [int.from_bytes(frame[-12:-6], "little") for frame in recorded]
    streams = [(frame[-13], frame[5], frame[6]) for frame in recorded]
    for stream, ticks in zip(streams, times, strict=True):
        assert ticks > newest.get(stream, 0)
        newest[stream] = ticks
    assert session.latest == newest
    assert session.newest == max(newest.values(), default=0)
