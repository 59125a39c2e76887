"""The sender's clock as the time axis of a vehicle."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.log.base.decoder import LOOSE_TIME
from mavhums.vehicle import clocks as clocks_module
from mavhums.vehicle.clocks import Clocks
from mavhums.vehicle.time_axis import BOOT, BROKEN, SOUND, UNSTAMPED, USEC, MappedTimes, VehicleClock
from tests.strategies import cuts
from tests.vehicle.tables import table_of

Times = NDArray[np.int64]
START_US = 1_700_000_000_000_000


def array(values: list[int]) -> Times:
    return np.array(values, dtype=np.int64)


def follow(
    sent: Times, received: Times, kinds: Times | int = BOOT, *, clock: VehicleClock | None = None
) -> MappedTimes:
    """Map the messages of component 1."""
    counters = np.broadcast_to(np.asarray(kinds, dtype=np.int64), sent.shape).copy()
    return (clock or VehicleClock()).map(np.ones_like(sent), counters, sent, received)


@given(st.lists(st.integers(0, 900_000), min_size=1, max_size=30), st.integers(1, 2**40))
def test_latency_does_not_bend_the_senders_time(latency_us: list[int], boot_us: int) -> None:
    sent = array([boot_us + 10_000 * k for k in range(len(latency_us))])
    received = sent + array(latency_us)
    mapped = follow(sent, received)
    assert np.array_equal(np.diff(mapped.time_us), np.diff(sent))
    assert mapped.time_us[0] == received[0]
    assert not mapped.segment.any()


@given(
    st.lists(
        st.tuples(
            st.sampled_from([UNSTAMPED, BOOT, USEC]),
            st.sampled_from([0, 1_000_000, 5_000_000, 45_000_000, -45_000_000]),
        ),
        max_size=60,
    ),
    st.data(),
)
def test_where_blocks_end_does_not_matter(messages: list[tuple[int, int]], data: st.DataObject) -> None:
    kinds = array([kind for kind, _ in messages])
    sent = array([10**9 + 10_000 * k for k in range(len(messages))])
    received = sent + array([lag for _, lag in messages])
    expected = follow(sent, received, kinds)
    cut, clock = data.draw(cuts(len(messages))), VehicleClock()
    edges = itertools.pairwise([0, *cut, len(messages)])
    found = [follow(sent[a:b], received[a:b], kinds[a:b], clock=clock) for a, b in edges]
    for of_parts, of_whole in zip(zip(*found, strict=True), expected, strict=True):
        assert np.array_equal(np.concatenate(of_parts), of_whole)


def test_a_reboot_starts_a_segment_after_three_stamps() -> None:
    sent = array([100_000_000, 100_010_000, 5_000, 15_000, 25_000, 35_000])
    received = 10**9 + array([0, 10_000, 8_000_000, 8_010_000, 8_020_000, 8_030_000])
    mapped = follow(sent, received)
    assert mapped.segment.tolist() == [0, 0, 0, 0, 2, 0]
    assert mapped.worth.tolist() == [SOUND, SOUND, BROKEN, BROKEN, SOUND, SOUND]
    assert mapped.time_us[[0, 1, 4, 5]].tolist() == received[[0, 1, 4, 5]].tolist()


@pytest.mark.parametrize(
    ("jump_us", "worth"),
    [(30_000_000, SOUND), (30_000_001, BROKEN), (-30_000_000, SOUND), (-30_000_001, BROKEN)],
)
def test_a_stamp_more_than_30_s_from_what_has_passed_is_broken(jump_us: int, worth: int) -> None:
    passed_us = 2_000_000 if jump_us > 0 else 0  # ahead of what passed, behind the newest
    sent, received = array([100_000_000, 100_000_000 + passed_us + jump_us]), START_US + array([0, passed_us])
    assert follow(sent, received).worth.tolist() == [SOUND, worth]


@pytest.mark.parametrize("bad", [BOOT, USEC])
@pytest.mark.parametrize("count", [1, 2, 6])
def test_a_counter_that_is_set_breaks_two_stamps_and_no_clock(bad: int, count: int) -> None:
    """The other counter runs on, so that nothing rebooted; the third stamp in a row is taken."""
    kinds = np.tile([BOOT, USEC], 10)
    true = 100_000_000 + 10_000 * np.arange(20)
    sent = true.copy()
    wrong = np.flatnonzero(kinds == bad)[4 : 4 + count]
    sent[wrong] += 200_000_000
    mapped = follow(sent, START_US + true, kinds)
    assert np.flatnonzero(mapped.worth == BROKEN).tolist() == wrong[:2].tolist()
    assert not mapped.segment.any()
    sound = mapped.worth == SOUND
    assert np.array_equal(mapped.time_us[sound], START_US + true[sound])


@pytest.mark.parametrize("silence_us", [0, 60_000_000, 6_000_000_000])
def test_a_counter_of_32_bits_goes_on_after_its_last_number(silence_us: int) -> None:
    true = 2**32 - 25_000 + np.array([0, 10_000, 20_000, silence_us + 30_000, silence_us + 40_000])
    mapped = follow(true % 2**32, START_US + true, USEC)
    assert np.array_equal(mapped.time_us - mapped.time_us[0], true - true[0])
    assert not mapped.segment.any()
    assert (mapped.worth == SOUND).all()


def test_components_after_the_sixteenth_are_on_the_first_ones_clock() -> None:
    components = np.repeat(np.arange(1, 19), 2)
    sent = np.where(np.arange(36) % 2, 8_000_000, 5_000_000)
    received = np.full(36, START_US)
    mapped = VehicleClock().map(components, np.full(36, BOOT), sent, received).time_us - START_US
    assert mapped[:32].tolist() == [0, 3_000_000] * 16
    assert mapped[32:].tolist() == [3_000_000] * 4


def test_a_sender_that_runs_faster_or_slower_needs_no_second_segment() -> None:
    """The sender's clock is the flight's time, also where a simulator runs at a third of the real time."""
    for rate in (0.3, 1.25, 5.0):
        sent = 1_000_000 + np.arange(2000) * 100_000
        received = START_US + (np.arange(2000) * 100_000 / rate).astype(np.int64)
        mapped = follow(sent, received)
        assert not mapped.segment.any()
        assert np.array_equal(np.diff(mapped.time_us), np.diff(sent))


def test_without_a_stamp_the_time_is_the_senders_newest_and_what_passed_since() -> None:
    sent = array([5_000_000, 0, 6_000_000, 5_900_000, 0])
    kinds = array([BOOT, UNSTAMPED, BOOT, BOOT, UNSTAMPED])
    received = START_US + array([0, 250_000, 3_000_000, 3_000_000, 3_010_000])  # a backlog of 2 s in a burst
    times = follow(sent, received, kinds).time_us - START_US
    assert times.tolist() == [0, 250_000, 1_000_000, 900_000, 1_010_000]


def test_a_component_that_never_stamps_is_on_the_vehicles_clock() -> None:
    clock = VehicleClock()
    component, kinds = array([1, 1, 190]), array([BOOT, BOOT, UNSTAMPED])
    mapped = clock.map(component, kinds, array([5_000_000, 9_000_000, 0]), START_US + array([0, 1, 2]))
    assert (mapped.time_us - START_US).tolist() == [0, 4_000_000, 4_000_001]


@pytest.mark.parametrize("offset_us", [-2_500_000, 2_490_000, 1_700_000_000_000_000])
@pytest.mark.parametrize("first", [BOOT, USEC])
def test_two_counters_of_one_sender_are_one_clock(offset_us: int, first: int) -> None:
    """``time_usec`` lies seconds beside ``time_boot_ms``, or counts from 1970."""
    kinds = np.tile([first, 1 - first], 200)
    true = 60_000_000 + np.arange(400) * 50_000
    sent = np.where(kinds == USEC, (true + offset_us) % 2**32, true)
    mapped = follow(sent, START_US + true + 5_000 * (np.arange(400) % 3), kinds)
    late = mapped.time_us[240:] - true[240:]  # from 12 s on
    assert np.ptp(late) < 20_000
    assert not mapped.segment.any()


def test_latencies_of_the_types_are_no_offset_of_counters() -> None:
    """Where one type of a counter comes at once and another one late, the counters agree."""
    true = 60_000_000 + np.arange(600) * 50_000
    kinds = np.tile([BOOT, USEC, USEC], 200)
    latency = np.tile([0, 2_000_000, 0], 200)
    order = np.argsort(true + latency, kind="stable")
    sent, received = true[order], START_US + (true + latency)[order]
    mapped = follow(sent, received, kinds[order])
    assert np.array_equal(mapped.time_us - mapped.time_us[0], sent - sent[0])


def test_the_time_of_now_is_the_senders_newest_and_what_passed_since_it_came() -> None:
    """Of two components, the one that shows less; a time of before shows no less than the newest."""
    clock = VehicleClock()
    follow(array([5_000_000, 6_000_000]), START_US + array([0, 3_000_000]), clock=clock)
    asked = [START_US + us for us in (3_000_000, 3_250_000, 9_000_000, 2_000_000)]
    shown = [1_000_000, 1_250_000, 7_000_000, 1_000_000]
    assert [clock.at_us(us) - START_US for us in asked] == shown
    one = array([1])
    clock.map(2 * one, BOOT * one, one, START_US + 2_500_000 * one)  # shows what has been received: 2 s more
    assert [clock.at_us(us) - START_US for us in asked] == shown


def table(name: str, sent_ms: list[int], *, sequence: list[int], received_us: list[int]) -> Table:
    plain = name == "VFR_HUD"
    fields = np.array([(ms,) for ms in sent_ms], dtype=[("alt" if plain else "time_boot_ms", "u4")])
    frames = np.arange(len(sent_ms)) * 2 + plain
    return table_of(name, fields, frame=frames, time_us=START_US + array(received_us), sequence=sequence)


def test_each_component_has_a_clock_of_its_own() -> None:
    """A camera that was switched on 90 s after the autopilot: neither clock breaks the other's."""
    sent = [100_000, 10_000, 100_100, 10_100, 100_200, 10_200]
    both = table("ATTITUDE", sent, sequence=[1] * 6, received_us=[50_000 * k for k in range(6)])
    both.component[1::2] = 100
    clocks = Clocks()
    mapped = clocks.feed({"ATTITUDE": both})["ATTITUDE"]
    assert not clocks.broken
    assert (mapped.time_us - START_US).tolist() == [0, 50_000, 100_000, 150_000, 200_000, 250_000]


def test_a_reboot_of_several_components_is_one_jump() -> None:
    """The first of them in the log shows it."""
    sent = [100_000] * 2 + [10, 10, 20, 20, 30, 30]
    both = table("ATTITUDE", sent, sequence=[1] * 8, received_us=[1000 * k for k in range(8)])
    both.component[1::2] = 100
    clocks = Clocks()
    clocks.feed({"ATTITUDE": both})
    assert clocks.jumps() == [(1, START_US + 6000)]
    assert clocks.jumps() == []
    assert clocks.broken == {"ATTITUDE": 4}


def test_what_arrives_over_several_routes_is_one_message() -> None:
    sent = [1000, 1100, 1000, 1200, 1100, 1200, 1300]
    sequence = [1, 2, 1, 3, 2, 3, 4]
    received = [10_000 * k for k in range(7)]
    whole = table("ATTITUDE", sent, sequence=sequence, received_us=received)
    for size in (1, 2, 7):
        clocks, parts = Clocks(), np.split(np.arange(7), range(size, 7, size))
        kept = [clocks.feed({"ATTITUDE": whole.select(part)})["ATTITUDE"]["time_boot_ms"] for part in parts]
        assert np.concatenate(kept).tolist() == [1000, 1100, 1200, 1300]
        assert clocks.copies == {"ATTITUDE": 3}
        assert not clocks.broken


@pytest.mark.parametrize(("latency_us", "loose"), [(200_000, False), (1_500_000, True)])
def test_a_message_without_a_stamp_is_doubted_on_an_uneven_link(latency_us: int, loose: bool) -> None:
    """What the stamped messages' latencies differ by, the unstamped one's time may be wrong by."""
    true_ms = 1000 + np.arange(100) * 100
    late = np.where(np.arange(100) % 2, latency_us, 0)
    order = np.argsort(true_ms * 1000 + late, kind="stable")
    received = (true_ms * 1000 + late)[order].tolist()
    stamped = table("ATTITUDE", true_ms[order].tolist(), sequence=[0] * 100, received_us=received)
    plain = table("VFR_HUD", [0] * 100, sequence=[0] * 100, received_us=received)
    timed = Clocks().feed({"ATTITUDE": stamped, "VFR_HUD": plain})
    assert bool((timed["VFR_HUD"].flags[50:] & LOOSE_TIME).all()) is loose
    assert not (timed["ATTITUDE"].flags & LOOSE_TIME).any()


def doubled(*received_s: float, late_s: float = 0.01) -> dict[str, Table]:
    """Return stamped messages that arrive twice from the first second on, and plain ones at some times."""
    twice = [(1.0 + k / 2 + late, "ATTITUDE", k) for k in range(20) for late in (0.0, late_s)]
    rows = [*enumerate(sorted(twice + [(second, "VFR_HUD", 0) for second in received_s]))]
    found = {}
    for name in ("ATTITUDE", "VFR_HUD"):
        frames, seconds, numbers = zip(
            *[(n, at_s, k) for n, (at_s, one, k) in rows if one == name], strict=True
        )
        received_us = [round(second * 1e6) for second in seconds]
        sent_ms = [1000 + 500 * k for k in numbers]
        found[name] = table(name, sent_ms, sequence=[*numbers], received_us=received_us)
        found[name].frame[:] = frames
    return found


@pytest.mark.parametrize("cut", [1, 3, 1000])
@pytest.mark.parametrize(
    ("received_s", "kept_s"),
    [
        ([0.25, 0.5], [0.25, 0.5]),  # nothing has shown a second route yet
        ([0.25, 1.25], [0.25, 1.25]),  # the original came before the route was found
        ([1.25, 1.5], [1.25]),
        ([1.25, 2.25, 6.5], [1.25]),  # a copy of a copy
        ([1.25, 1.25 + 5.0], [1.25]),
        ([1.25, 1.25 + 5.001], [1.25, 1.25 + 5.001]),
    ],
)
def test_only_a_message_without_a_stamp_after_a_second_route_and_of_the_last_seconds_is_a_copy(
    received_s: list[float], kept_s: list[float], cut: int
) -> None:
    clocks, kept = Clocks(), list[int]()
    whole = doubled(*received_s)
    for first in range(0, sum(map(len, whole.values())), cut):
        inside = {name: part.select(part.frame // cut == first // cut) for name, part in whole.items()}
        kept += (clocks.feed(inside)["VFR_HUD"].time_us - START_US).tolist()
    assert kept == [round(second * 1e6) for second in kept_s]


def test_only_the_sender_with_a_second_route_has_copies() -> None:
    whole, clocks = doubled(1.25, 1.5, 2.25, 2.5), Clocks()
    whole["VFR_HUD"].component[2:] = 2
    kept = clocks.feed(whole)["VFR_HUD"].time_us - START_US
    assert kept.tolist() == [1_250_000, 2_250_000, 2_500_000]


def test_of_many_senders_only_the_last_messages_of_those_heard_last_are_remembered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(clocks_module, "_STREAMS", 6)  # three senders of two messages
    monkeypatch.setattr(clocks_module, "_REMEMBERED", 2)
    clocks = Clocks()
    for component in (1, 2, 3, 1, 4):
        whole = doubled(*(1.25 + k / 10 for k in range(8)))
        for part in whole.values():
            part.component[:] = component
        clocks.feed(whole)
    senders = [256 + component for component in (3, 1, 4)]
    assert [*clocks._seen] == [(name, one) for one in senders for name in ("ATTITUDE", "VFR_HUD")]
    assert {(times.size, codes.size) for times, codes in clocks._seen.values()} == {(2, 2)}
