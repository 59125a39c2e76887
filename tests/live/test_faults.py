"""What can befall a link: verdicts stay right, or say that they cannot, and every loss is counted."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from mavhums.engine.events import Notice
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim import FlightRecord
from mavhums_sim.link import EPOCH_US, Link
from mavhums_sim.telemetry import messages
from tests.conftest import files_up_to
from tests.live.conftest import KEY, RIGHT, Rig, conditions, of, pieces

MakeRig = Callable[..., Rig]


@pytest.mark.slow
def test_a_sound_link_gives_what_the_log_gives(rig: Rig, worn_pieces: list[Piece], tmp_path: Path) -> None:
    rig.hear(worn_pieces)
    live = rig.end()
    assert conditions(live) == RIGHT
    stamped = b"".join(piece.time_us.to_bytes(8, "big") + piece.data for piece in worn_pieces)
    assert rig.recorder.path.read_bytes() == stamped
    counts = rig.stamper.counts
    assert (counts.frames, counts.bytes_skipped, counts.bad_crc_frames) == (len(worn_pieces), 0, 0)


@pytest.mark.slow
def test_a_third_of_the_frames_is_lost(rig: Rig, worn: FlightRecord, worn_pieces: list[Piece]) -> None:
    kept = pieces(worn, Link(loss=0.3, burst=3.0))
    rig.hear(kept)
    live = rig.end()
    assert conditions(live) == RIGHT
    missing = sum(loss.missing for loss in live.log.losses.sequence)
    # No later number shows the frames that are lost at the end.
    assert missing == pytest.approx(len(worn_pieces) - len(kept), abs=3)
    assert 0 < rig.shown.statuses[-1].link.missing_frames <= missing


@pytest.mark.slow
def test_frames_overtake_others(rig: Rig, worn: FlightRecord) -> None:
    rig.hear(pieces(worn, Link(late=0.05, late_s=0.05)))
    live = rig.end()
    assert conditions(live) == RIGHT
    assert rig.shown.statuses[-1].link.reordered_frames > 100
    assert of(live, "elevator").coverage.late > 20


@pytest.mark.slow
def test_every_frame_comes_twice(rig: Rig, worn_pieces: list[Piece]) -> None:
    twice = [copy for piece in worn_pieces for copy in (piece, piece._replace(time_us=piece.time_us + 300))]
    rig.hear(twice)
    live = rig.end()
    assert conditions(live) == RIGHT
    assert rig.shown.statuses[-1].link.duplicated_frames == pytest.approx(len(worn_pieces), rel=0.05)
    assert rig.stamper.frames == 2 * len(worn_pieces)


@pytest.mark.slow
def test_garbage_before_after_and_between(rig: Rig, worn_pieces: list[Piece]) -> None:
    dice = random.Random(5)
    spoilt, added = [], 0
    for piece in worn_pieces:
        if dice.random() < 0.05:
            garbage = dice.randbytes(dice.randint(1, 40))
            added += len(garbage)
            data = garbage + piece.data if dice.random() < 0.5 else piece.data + garbage
            piece = piece._replace(data=data)  # noqa: PLW2901
        spoilt.append(piece)
    rig.hear(spoilt)
    live = rig.end()
    assert conditions(live) == RIGHT
    counts = rig.stamper.counts
    assert counts.frames > 0.995 * len(worn_pieces)
    assert counts.bytes_skipped >= added


def readdressed(record: FlightRecord, system: int, start_s: float, sender: str) -> list[Piece]:
    """The flight of another vehicle, which begins later."""
    link = v2.MAVLink(None, srcSystem=system, srcComponent=1)
    out = []
    for time_s, message in messages(record):
        at_us = EPOCH_US + round((start_s + time_s) * 1e6)
        out.append(Piece(sender, at_us, bytes(message.pack(link))))
        link.seq = (link.seq + 1) % 256
    return out


@pytest.mark.slow
def test_another_vehicle_joins(rig: Rig, worn: FlightRecord, worn_pieces: list[Piece]) -> None:
    rig.hear(worn_pieces + readdressed(worn, 9, 8.0, "vehicle"))
    live = rig.end()
    assert conditions(live) == RIGHT
    assert conditions(live, vehicle=9) == RIGHT
    elevators = [alert for alert in rig.shown.alerts if alert.text.startswith("elevator EMERGENCY")]
    assert sorted(alert.vehicle for alert in elevators) == [1, 9]


@pytest.mark.slow
def test_the_vehicle_reboots(rig: Rig, worn: FlightRecord) -> None:
    rig.hear(pieces(worn, Link(reboot_at_s=14.0, outage_s=2.0)))
    live = rig.end()
    assert conditions(live) == RIGHT
    jumps = [event for event in rig.shown.events if isinstance(event, Notice) and "clock" in event.text]
    assert len(jumps) == 1
    elevator = of(live, "elevator")
    assert elevator.since is not None
    assert elevator.since.flight_time_s < 14.0, "the history goes on"


@pytest.mark.slow
def test_the_vehicles_clock_is_set(rig: Rig, worn: FlightRecord) -> None:
    """An hour ahead from the twelfth second on, as GPS sets it."""
    link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    sent = []
    for time_s, message in messages(worn):
        if time_s > 12.0 and "time_usec" in message.fieldnames and message.get_type() != "SERVO_OUTPUT_RAW":
            message.time_usec += 3_600_000_000
        sent.append(Piece("vehicle", EPOCH_US + round(time_s * 1e6), bytes(message.pack(link))))
    rig.hear(sent)
    assert conditions(rig.end()) == RIGHT
    assert any(isinstance(event, Notice) and "clock jumped" in event.text for event in rig.shown.events)


@pytest.mark.slow
def test_this_computers_clock_is_set(rig: Rig, worn_pieces: list[Piece]) -> None:
    """Six years ahead, as NTP sets a computer without a battery; the kernel stamps with that clock."""
    middle = len(worn_pieces) // 2
    rig.hear(worn_pieces[:middle])
    rig.wall_us += 6 * 365 * 86_400_000_000
    rig.hear(worn_pieces[middle:])
    live = rig.end()
    assert conditions(live) == RIGHT
    assert live.log.duration_s == pytest.approx(30.0, abs=0.5)


@pytest.mark.slow
def test_ten_seconds_of_silence(rig: Rig, worn_pieces: list[Piece]) -> None:
    before = [piece for piece in worn_pieces if piece.time_us < EPOCH_US + 18_000_000]
    after = [piece._replace(time_us=piece.time_us + 10_000_000) for piece in worn_pieces[len(before) :]]
    rig.hear(before)
    rig.wait_until(EPOCH_US + 27_500_000)
    silent = rig.shown.statuses[-1].actuators
    assert {status.condition for status in silent} == {"undecided"}
    assert {status.actuator: status.held for status in silent} == RIGHT
    assert all(status.stale and status.age_s is not None and status.age_s > 9 for status in silent)
    assert rig.shown.statuses[-1].link.age_s == pytest.approx(9.0, abs=0.3)
    rig.hear(after)
    live = rig.end()
    assert {status.actuator: status.condition for status in rig.shown.statuses[-1].actuators} == RIGHT
    assert [change.stale for change in rig.shown.stale] == [True] * 4 + [False] * 4
    assert conditions(live) == RIGHT


@pytest.mark.slow
def test_the_disk_is_full_while_recording(rig: Rig, worn_pieces: list[Piece]) -> None:
    third = len(worn_pieces) // 3
    rig.hear(worn_pieces[:third])
    with files_up_to(rig.recorder.bytes + 40_000):
        rig.hear(worn_pieces[third : 2 * third])
    record = rig.shown.statuses[-1].record
    assert record
    assert record.error
    assert record.lost_frames > 1000
    rig.hear(worn_pieces[2 * third :])
    live = rig.session.close()
    assert conditions(live) == RIGHT, "the flight is judged on"
    assert rig.recorder.error is None, "and recorded again when there is room"
    log = mavhums.read_log(rig.recorder.path)
    assert not log.losses.any, "the file holds whole records only"
    assert sum(log.counts.values()) == len(worn_pieces) - rig.recorder.lost_frames


@pytest.mark.slow
def test_a_forged_frame_changes_nothing(make_rig: MakeRig, worn: FlightRecord) -> None:
    """Signed with another key, from a time to come, it must neither count nor block the true sender."""
    rig = make_rig(key=KEY)
    true = pieces(worn, Link(key=KEY))
    forger = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    forger.signing.secret_key = bytes(32)
    forger.signing.sign_outgoing = True
    forger.signing.timestamp = 2**47
    forged = []
    for k in range(100):
        message = v2.MAVLink_debug_float_array_message(0, b"EMA", 4, [5.0] * 58)
        forged.append(Piece("vehicle", true[50 * k].time_us, bytes(message.pack(forger))))
    rig.hear([piece for pair in itertools.zip_longest(true, forged) for piece in pair if piece])
    assert conditions(rig.end()) == RIGHT
    counts = rig.stamper.counts
    assert (counts.bad_signatures, counts.frames, counts.replayed_frames) == (100, len(true), 0)


def test_unsigned_frames_do_not_count(make_rig: MakeRig, worn_pieces: list[Piece]) -> None:
    rig = make_rig(key=KEY)
    rig.hear(worn_pieces)
    assert rig.session.close().verdicts[0].reason_codes == ("no_signed_frame",)
    assert rig.stamper.counts.unsigned_frames == len(worn_pieces)
    assert rig.recorder.bytes == 0


@pytest.mark.slow
@pytest.mark.parametrize("senders", [1, 5000])
def test_a_burst_of_noise(rig: Rig, worn_pieces: list[Piece], senders: int) -> None:
    """Twenty thousand datagrams of noise within a second, from one port or from thousands."""
    dice = random.Random(8)
    noise = [
        Piece(("noise", k % senders), EPOCH_US + 10_000_000 + 50 * k, dice.randbytes(40) + b"\xfd\xff")
        for k in range(20_000)
    ]
    rig.hear(worn_pieces + noise)
    assert conditions(rig.end()) == RIGHT
    counts = rig.stamper.counts
    assert len(worn_pieces) <= counts.frames <= len(worn_pieces) + 3
    assert counts.bytes_skipped == pytest.approx(42 * 20_000, abs=3 * 280)
    assert len(rig.stamper._streams) == 0


@pytest.mark.slow
def test_noise_at_the_vehicles_own_address(rig: Rig, worn_pieces: list[Piece]) -> None:
    dice = random.Random(9)
    noise = [Piece("vehicle", EPOCH_US + 8_000_000 + 50 * k, dice.randbytes(60)) for k in range(20_000)]
    rig.hear(worn_pieces + noise)
    live = rig.end()
    assert {"normal", "undecided"} >= {conditions(live)[name] for name in ("aileron_left", "rudder")}
    assert conditions(live)["elevator"] in ("emergency", "undecided")
    assert of(live, "elevator").worst == "emergency"
    assert rig.stamper.counts.bytes_skipped > 60 * 19_000


@pytest.mark.slow
def test_every_fault_at_once(rig: Rig, worn: FlightRecord) -> None:
    dice = random.Random(10)
    link = Link(loss=0.2, burst=2.0, late=0.05, links=2, reboot_at_s=16.0, outage_s=1.0)
    spoilt = []
    for piece in pieces(worn, link):
        data = bytearray(piece.data)
        if dice.random() < 0.02:
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        spoilt.append(piece._replace(data=bytes(data)))
    rig.hear(spoilt)
    live = rig.end()
    assert conditions(live) == RIGHT
    assert rig.stamper.counts.bad_crc_frames > 0
