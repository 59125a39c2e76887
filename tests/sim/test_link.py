"""The link: what it loses, delays, repeats, signs; what the sender's clock says."""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim import Flight, FlightRecord, fly, write_tlog
from mavhums_sim.cyclogram import SURFACES
from mavhums_sim.link import EPOCH_US, Frame, Link, transmit
from mavhums_sim.rates import Rates
from mavhums_sim.telemetry import messages

KEY = bytes(range(32))


@pytest.fixture(scope="module")
def record() -> FlightRecord:
    return fly(Flight(seed=8, duration_s=20.0))


def frames(record: FlightRecord, link: Link) -> list[Frame]:
    return list(transmit(messages(record), link, record.flight.seed))


@pytest.mark.slow
@pytest.mark.parametrize("protocol", [Link(), Link(key=KEY)])
def test_a_radio_carries_what_its_line_can_of_every_stream(record: FlightRecord, protocol: Link) -> None:
    """A line of 57,600 baud has 5,760 bytes a second, of which each stream gets the same share."""
    named = FlightRecord(replace(record.flight, tiers=("named", "pwm")), record.cyclogram, record.actuators)
    link = replace(protocol, baud=57_600.0)
    for flown in (record, named):
        got = list(transmit(messages(flown, link), link, seed=1))
        second = np.array([frame.received_us - EPOCH_US for frame in got]) // 1_000_000
        carried = np.bincount(second, weights=[len(frame.data) for frame in got])[:-1]
        assert carried.mean() <= 5760
        assert carried.max() <= 5760 + 512  # the buffer of its port takes that
        assert np.median(carried) > 0.75 * 5760
        kept, sent = Counter(f.name for f in got), Counter(f.name for f in frames(flown, protocol))
        whole = {"HEARTBEAT", "STATUSTEXT", "PARAM_VALUE"}
        assert all(kept[name] == sent[name] for name in whole)
        shares = [kept[name] / sent[name] for name in sent.keys() - whole]
        assert max(shares) < 0.9
        assert max(shares) - min(shares) < 0.03
    names = Counter(decoded(frame).name for frame in got if frame.name == "NAMED_VALUE_FLOAT")
    assert all(len({names[f"S{servo}V{v:02d}"] for v in range(1, 13)}) == 1 for servo in (1, 2, 3, 4))


def test_a_line_that_is_fast_enough_changes_nothing(record: FlightRecord) -> None:
    fast = Link(baud=1e6)
    assert frames(record, Link()) == list(transmit(messages(record, fast), fast, record.flight.seed))
    with pytest.raises(ValueError, match="do not carry heartbeats"):
        messages(record, Link(baud=300.0))


def decoded(frame: Frame, mav: Any | None = None) -> Any:
    return (mav or mavlink.MAVLink(None)).decode(bytearray(frame.data))


def test_reception_never_goes_back_and_takes_its_latency(record: FlightRecord) -> None:
    got = frames(record, Link(latency_s=0.05, jitter_s=0.01))
    sent = np.array([t for t, _ in messages(record)])
    delay = np.array([f.received_us - EPOCH_US for f in got]) / 1e6 - sent
    assert delay.min() >= 0.05
    assert np.median(delay) > 0.055
    assert all(b.received_us >= a.received_us for a, b in pairwise(got))


@pytest.mark.slow
def test_a_flight_of_another_day_differs_in_nothing_else(record: FlightRecord) -> None:
    today, later = frames(record, Link()), frames(record, Link(day=1.5))
    assert [f.received_us + 36 * 3_600_000_000 for f in today] == [f.received_us for f in later]
    assert [f.data for f in today] == [f.data for f in later]


@pytest.mark.slow
@pytest.mark.parametrize(("loss", "burst"), [(0.1, 1.0), (0.1, 5.0), (0.4, 3.0)])
def test_loss_has_its_share_and_its_bursts(record: FlightRecord, loss: float, burst: float) -> None:
    got = frames(record, Link(loss=loss, burst=burst))
    total = len(frames(record, Link()))
    assert 1 - len(got) / total == pytest.approx(loss, abs=0.025)
    seq = np.array([decoded(f).get_seq() for f in got])
    missing = (np.diff(seq) - 1) % 256
    assert missing[missing > 0].mean() == pytest.approx(1.0 / (1 - loss) if burst == 1.0 else burst, rel=0.25)


@pytest.mark.slow
def test_late_frames_are_overtaken(record: FlightRecord) -> None:
    got = frames(record, Link(late=0.02, late_s=0.05))
    assert Counter(f.data for f in got) == Counter(f.data for f in frames(record, Link()))
    seq = np.array([decoded(f).get_seq() for f in got])
    back = ((np.diff(seq) + 128) % 256 - 128) < 0
    assert back.mean() == pytest.approx(0.02, abs=0.01)
    assert all(b.received_us >= a.received_us for a, b in pairwise(got))


@pytest.mark.slow
def test_parallel_links_repeat_frames_and_number_them(record: FlightRecord) -> None:
    got = frames(record, Link(links=2, loss=0.05))
    by_link = [[f for f in got if f.received_us % 4 == number] for number in range(4)]
    assert not by_link[2] + by_link[3]
    total = len(frames(record, Link()))
    for share in by_link[:2]:
        assert len(share) / total == pytest.approx(0.95, abs=0.02)
    both = {f.data for f in by_link[0]} | {f.data for f in by_link[1]}
    assert len(both) / total > 0.99


def clocks(got: list[Frame], name: str = "SERVO_OUTPUT_RAW") -> tuple[Any, Any]:
    kept = [f for f in got if f.name == name]
    received = np.array([f.received_us - EPOCH_US for f in kept]) / 1e6
    return received, np.array([decoded(f).time_usec for f in kept]) / 1e6


@pytest.mark.slow
def test_clock_is_off_and_drifts(record: FlightRecord) -> None:
    received, sender = clocks(frames(record, Link(clock_offset_s=5.0, clock_drift_ppm=1000.0)))
    slope, offset = np.polyfit(received, sender - received, 1)
    assert slope == pytest.approx(1e-3, rel=0.05)
    assert offset == pytest.approx(35.0, abs=0.01)


@pytest.mark.slow
def test_clock_stops_at_zero_and_wraps_where_its_field_does(record: FlightRecord) -> None:
    _, before_boot = clocks(frames(record, Link(clock_offset_s=-40.0)))
    assert before_boot.min() == 0.0
    assert before_boot.max() == pytest.approx(10.0, abs=0.1)
    wrapping = frames(record, Link(clock_offset_s=2**32 / 1e6 - 40.0))
    _, narrow = clocks(wrapping)
    _, wide = clocks(wrapping, "DEBUG_FLOAT_ARRAY")
    assert narrow.min() < 0.1
    assert narrow.max() > 4294.9
    assert np.ptp(wide) == pytest.approx(20.0, abs=0.1)


@pytest.mark.slow
def test_reboot_is_silent_then_starts_from_zero(record: FlightRecord) -> None:
    got = frames(record, Link(reboot_at_s=8.0, outage_s=2.0))
    received, sender = clocks(got, "DEBUG_FLOAT_ARRAY")
    after = received > 9.0
    assert received[~after].max() < 8.1
    assert received[after].min() > 9.99
    assert sender[~after].min() > 30.0
    assert 0.0 <= sender[after].min() < 0.05
    first = next(f for f in got if f.received_us > EPOCH_US + 9_000_000)
    assert decoded(first).get_seq() == 0


def number_of(frame: Frame) -> int:
    """Message number of a frame of MAVLink 2; MAVLink 1 has those below 256."""
    return int.from_bytes(frame.data[7:10], "little")


ALL_TIERS = ("instrumented", "esc-signed", "esc-unsigned", "named", "pwm")


def test_every_tier_can_be_signed() -> None:
    signed = frames(fly(Flight(duration_s=2.0, rate_hz=20.0, tiers=ALL_TIERS)), Link(key=KEY))
    receiver, stranger = mavlink.MAVLink(None), mavlink.MAVLink(None)
    receiver.signing.secret_key, stranger.signing.secret_key = KEY, bytes(32)
    with pytest.raises(mavlink.MAVError, match="signature"):
        decoded(signed[0], stranger)
    for frame in signed:
        assert frame.name == "ESC_STATUS" or decoded(frame, receiver).get_signed()  # pymavlink lacks it
        assert frame.data[2] == 1  # the flag says that 13 bytes of signature follow
        body, signature = frame.data[:-6], frame.data[-6:]
        assert hashlib.sha256(KEY + body).digest()[:6] == signature
    stamps = [int.from_bytes(frame.data[-12:-6], "little") for frame in signed]
    assert len(set(stamps)) == len(stamps)
    assert {"ESC_STATUS", "NAMED_VALUE_FLOAT", "DEBUG_FLOAT_ARRAY"} <= {frame.name for frame in signed}


def test_mavlink_1_carries_named_and_pwm_alone() -> None:
    record = fly(Flight(duration_s=2.0, rate_hz=20.0, tiers=ALL_TIERS))
    got = frames(record, Link(mavlink=1))
    assert {f.data[0] for f in got} == {0xFE}
    two = [f for f in frames(record, Link()) if number_of(f) < 256]
    assert Counter(f.name for f in got) == Counter(f.name for f in two)
    parameter = next(decoded(f) for f in got if f.name == "PARAM_VALUE")
    assert (parameter.param_id, parameter.param_value) == ("SERVO1_FUNCTION", 4.0)
    assert next(f for f in got if f.name == "SERVO_OUTPUT_RAW").data[1] == 21  # without servo9…16
    named = [decoded(f) for f in got if f.name == "NAMED_VALUE_FLOAT"]
    assert {m.name for m in named} == {f"S{servo}V{v:02d}" for servo in range(1, 5) for v in range(1, 13)}


def test_clock_of_every_tier_restarts() -> None:
    record = fly(Flight(duration_s=6.0, rate_hz=20.0, tiers=ALL_TIERS))
    sender = [
        int.from_bytes(frame.data[10:18], "little") / 1e6
        for frame in frames(record, Link(reboot_at_s=1.0, outage_s=2.0))
        if frame.name == "ESC_STATUS" and frame.received_us > EPOCH_US + 2_000_000
    ]
    assert len(sender) == pytest.approx(60, abs=2)
    assert 0.0 <= min(sender) < 0.1
    assert max(sender) == pytest.approx(3.0, abs=0.1)


@pytest.mark.slow
def test_log_holds_what_the_link_delivered(record: FlightRecord, tmp_path: Path) -> None:
    link = Link(loss=0.2, links=2)
    path = tmp_path / "lossy.tlog"
    counts = write_tlog(record, path, link)
    expected = frames(record, link)
    assert path.read_bytes() == b"".join(struct.pack(">Q", f.received_us) + f.data for f in expected)
    assert counts == dict(Counter(f.name for f in expected))


def test_link_holds_no_more_than_what_is_under_way() -> None:
    """The stream is drawn only as far as needed for the next frame."""
    drawn = 0

    def endless() -> Iterator[tuple[float, Any]]:
        nonlocal drawn
        while True:
            drawn += 1
            yield drawn * 0.01, mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)

    flow = transmit(endless(), Link(late=0.1, late_s=0.2), 0)
    for _ in range(1000):
        next(flow)
    assert drawn < 1200


@pytest.mark.parametrize(
    "wrong",
    [
        {"loss": 1.0},
        {"late": -0.1},
        {"burst": 0.5},
        {"loss": 0.9, "burst": 2.0},
        {"latency_s": -1.0},
        {"reboot_at_s": -1.0},
        {"links": 5},
        {"mavlink": 3},
        {"day": -1.0},
        {"key": b"short"},
        {"key": KEY, "mavlink": 1},
    ],
)
def test_impossible_links_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"share|day|burst|negative|links|MAVLink"):
        Link(**wrong)


def test_rates_decide_how_often_and_zero_is_never() -> None:
    rates = Rates(attitude=4.0, air_data=0.0, battery=1.0, servo_output=100.0, esc=0.0)
    counts = Counter(f.name for f in frames(fly(Flight(duration_s=10.0, rates=rates)), Link()))
    assert (counts["ATTITUDE"], counts["BATTERY_STATUS"], counts["SERVO_OUTPUT_RAW"]) == (40, 10, 1000)
    assert "VFR_HUD" not in counts
    assert "ESC_TELEMETRY_1_TO_4" not in counts
    with pytest.raises(ValueError, match="rate of esc"):
        Rates(esc=-1.0)


def test_bus_side_esc_reports_the_power_that_the_motor_takes() -> None:
    from mavhums_sim.conditions import Condition
    from mavhums_sim.sensors import ELECTRONICS_A, SensorNoise

    sag = dict.fromkeys(SURFACES, (Condition.step("supply_sag", 3.0, 5.0),))
    record = fly(Flight(duration_s=10.0, esc_side="bus", noise=SensorNoise.none(), conditions=sag))
    actuator = record.actuators["elevator"]
    volts, amperes = actuator.esc[:, 0], actuator.esc[:, 1]
    assert volts[actuator.time_s < 4.9] == pytest.approx(27.0)
    assert volts[actuator.time_s > 5.1] == pytest.approx(24.0)
    motion = actuator.motion
    power = np.interp(actuator.time_s, motion.time_s, motion.voltage * motion.current)
    np.testing.assert_allclose((amperes - ELECTRONICS_A) * volts, power, atol=1e-9)
    battery = [m for _, m in messages(record) if m.get_type() == "BATTERY_STATUS"]
    assert (battery[0].voltages[0], battery[-1].voltages[0]) == (27_000, 24_000)
