"""The sender's clock on the time axis of reception."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.log import Table
from mavhums.vehicle.clock import SenderClock
from mavhums.vehicle.clocks import Clocks

Times = NDArray[np.int64]
START_US = 1_700_000_000_000_000


def array(values: list[int]) -> Times:
    return np.array(values, dtype=np.int64)


@given(st.lists(st.integers(0, 900_000), min_size=1, max_size=30), st.integers(0, 2**40))
def test_latency_does_not_bend_the_senders_time(latency_us: list[int], boot_us: int) -> None:
    sent = array([boot_us + 10_000 * k for k in range(len(latency_us))])
    received = sent + array(latency_us)
    clock = SenderClock()
    utc = clock.to_utc_us(sent, received)
    assert np.array_equal(np.diff(utc), np.diff(sent))
    assert utc[0] == received[0]
    assert clock.segments == 1


@given(st.lists(st.sampled_from([0, 1_000_000, 5_000_000, 9_000_000]), max_size=30), st.data())
def test_where_blocks_end_does_not_matter(lags_us: list[int], data: st.DataObject) -> None:
    sent = array([10_000 * k for k in range(len(lags_us))])
    received = sent + array(lags_us)
    whole = SenderClock()
    expected = whole.to_utc_us(sent, received)
    clock = SenderClock()
    cut = data.draw(st.lists(st.booleans(), min_size=len(lags_us), max_size=len(lags_us)))
    bounds = [0, *np.flatnonzero(cut), len(lags_us)]
    parts = [clock.to_utc_us(sent[a:b], received[a:b]) for a, b in itertools.pairwise(bounds)]
    assert np.array_equal(np.concatenate(parts), expected)
    assert clock.segments == whole.segments


def test_a_reboot_starts_a_segment_after_three_samples() -> None:
    sent = array([100_000_000, 100_010_000, 5_000, 15_000, 25_000, 35_000])
    received = array(
        [10**9, 10**9 + 10_000, 10**9 + 8_000_000, *(10**9 + 8_000_000 + 10_000 * k for k in (1, 2, 3))]
    )
    clock = SenderClock()
    utc = clock.to_utc_us(sent, received)
    assert clock.segments == 2
    assert utc[:2].tolist() == received[:2].tolist()
    assert utc[4:].tolist() == received[4:].tolist()


def test_one_damaged_time_stamp_starts_no_segment() -> None:
    sent = array([0, 10_000, 20_000, 30_000])
    received = array([10**9, 10**9 + 10_000, 10**9 + 2**31, 10**9 + 30_000])
    clock = SenderClock()
    assert clock.to_utc_us(sent, received).tolist() == [10**9, 10**9 + 10_000, 10**9 + 20_000, 10**9 + 30_000]
    assert clock.segments == 1


def test_a_clock_set_ahead_does_not_stand_before_what_follows() -> None:
    sent = np.arange(10) * 100_000
    sent[5:] += 3_600_000_000
    received = np.arange(10) * 100_000 + 7_000_000
    for size in (1, 4, 10):
        clock = SenderClock()
        utc = np.concatenate(
            [clock.to_utc_us(sent[k : k + size], received[k : k + size]) for k in range(0, 10, size)]
        )
        assert np.array_equal(utc, received)
        assert clock.segments == 2


def message_table(sent_ms: Times, received: Times, first: int) -> Table:
    count = len(sent_ms)
    ones = np.ones(count, dtype=np.uint8)
    fields = np.array([(int(ms),) for ms in sent_ms], dtype=[("time_boot_ms", "u4")])
    frames = np.arange(first, first + count, dtype=np.int64)
    return Table("NAMED_VALUE_FLOAT", frames, received, ones, ones, ones, ones, fields)


@given(st.lists(st.integers(1, 79), max_size=6), st.sampled_from([1.0, 2.0, 5.0]))
def test_readers_of_the_same_messages_do_not_disturb_each_other(cuts: list[int], squeezed: float) -> None:
    """A clock that runs off, as in a replay faster than it was flown, jumps again and again."""
    sent_ms = np.arange(80, dtype=np.int64) * 150
    received = START_US + (sent_ms * 1000 / squeezed).astype(np.int64)
    expected = SenderClock().to_utc_us(sent_ms * 1000, received)
    clocks, found = Clocks(), []
    for a, b in itertools.pairwise(sorted({0, *cuts, 80})):
        table = message_table(sent_ms[a:b], received[a:b], a)
        one, other = (clocks.utc_us(table, 1000, "time_boot_ms") for _ in range(2))
        assert np.array_equal(one, other)
        found.append(one)
    assert np.array_equal(np.concatenate(found), expected)
