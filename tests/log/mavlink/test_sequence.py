"""What the sequence numbers of a sender say, whatever the link did to them."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Collection, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.log.base.decoder import SequenceLoss
from mavhums.log.base.scanner import ROW
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.sequence import StreamStats
from tests.present import present


def follow(frames: list[tuple[int, int]], *, system: int = 1, cut: int | None = None) -> SequenceLoss | None:
    """Return the account of one sender's frames, given as (sequence number, CRC)."""
    rows = np.zeros(len(frames), dtype=ROW)
    rows["system"], rows["component"] = system, 1
    rows["sequence"] = [sequence % 256 for sequence, _ in frames]
    rows["crc"] = [crc for _, crc in frames]
    stats = StreamStats(load_dialect())
    for part in np.split(rows, [cut or 0]):
        stats.add(part)
    return next(stats.sequence_losses(), None)


def numbered(sent: range, lost: Collection[int] = ()) -> list[tuple[int, int]]:
    return [(n, n * 40_503 % 65_536) for n in sent if n not in lost]


def figures(loss: SequenceLoss | None) -> tuple[int, int, int]:
    return (loss.missing, loss.reordered, loss.duplicated) if loss else (0, 0, 0)


@given(st.integers(0, 255), st.sets(st.integers(40, 900), max_size=29), st.integers(0, 900))
@settings(max_examples=60, deadline=None)
def test_lost_frames_are_counted(first: int, lost: set[int], cut: int) -> None:
    runs = [n for n in lost if n - 1 not in lost]
    frames = numbered(range(first, first + 1000), {first + n for n in lost})
    loss = follow(frames, cut=min(cut, len(frames)))
    assert figures(loss) == (len(lost), 0, 0)
    assert (loss.gaps if loss else 0) == len(runs)


@given(st.sampled_from([range(9), [0, 0, 40, 79, 80]]), st.integers(0, 2**32 - 1), st.integers(120, 400))
@settings(max_examples=100, deadline=None)
def test_frames_that_up_to_eighty_others_overtake_are_not_lost(
    delays: Sequence[int], seed: int, count: int
) -> None:
    waits = [*[0] * 90, *np.random.default_rng(seed).choice(delays, count).tolist(), *[0] * 90]
    arrival = sorted(range(len(waits)), key=lambda k: k + waits[k])
    frames = numbered(range(40, 40 + len(waits)))
    reordered = sum(n < max(arrival[:k]) for k, n in enumerate(arrival) if k)
    assert figures(follow([frames[k] for k in arrival])) == (0, reordered, 0)


@given(st.integers(0, 6), st.integers(100, 400))
@settings(max_examples=30, deadline=None)
def test_a_link_that_is_logged_twice_is_reported(lag: int, count: int) -> None:
    frames = numbered(range(count))
    twice = sorted((k + late, frame) for k, frame in enumerate(frames) for late in (0, lag + 0.5))
    assert figures(follow([frame for _, frame in twice])) == (0, 0, count)


@given(st.integers(60, 190), st.integers(200, 500))
@settings(max_examples=30, deadline=None)
def test_two_links_with_counters_of_their_own_lose_nothing(offset: int, count: int) -> None:
    one, other = numbered(range(count)), numbered(range(offset, offset + count))
    mixed = [frame for pair in zip(one, other, strict=True) for frame in pair]
    assert figures(follow(mixed)) == (0, 0, 0)


@pytest.mark.parametrize(("silent", "missing"), [(150, 150), (256 + 90, 90)])
def test_a_long_silence_is_one_gap_modulo_256(silent: int, missing: int) -> None:
    loss = present(follow(numbered(range(1000), set(range(300, 300 + silent)))))
    assert (loss.missing, loss.gaps, loss.frames) == (missing, 1, 1000 - silent)


def test_senders_do_not_disturb_each_other() -> None:
    stats = StreamStats(load_dialect())
    rows = np.zeros(20_000, dtype=ROW)
    senders = np.arange(rows.size) % 200
    rows["system"], rows["component"] = senders % 20, senders // 20
    rows["sequence"] = (np.arange(rows.size) // 200 + senders) % 256
    rows["definition"] = senders % 3
    rows["time_us"] = np.arange(rows.size)
    stats.add(rows)
    assert list(stats.sequence_losses()) == []
    assert len(stats.counts) == 200
    assert set(stats.counts.values()) == {100}
    assert (stats.first_time_us, stats.last_time_us) == (0, rows.size - 1)


def test_any_number_of_unknown_ids_fills_no_memory() -> None:
    rows = np.zeros(5000, dtype=ROW)
    rows["definition"], rows["number"] = -1, np.arange(5000) + 60_000
    stats = StreamStats(load_dialect())
    for part in np.split(rows, 10):
        stats.add(part)
        stats.add(part)
    assert len(stats.unknown) == 1001
    assert stats.unknown[60_000] == 2
    assert sum(stats.unknown.values()) == 10_000


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.integers(2, 40), st.sets(st.integers(1, 8999), max_size=5))
@settings(max_examples=15, deadline=None)
def test_any_number_of_senders_fills_no_memory_and_none_is_uncounted(
    seed: int, systems: int, cuts: set[int]
) -> None:
    """Those silent longest are counted as component 0 of their system, wherever blocks end."""
    dice = np.random.default_rng(seed)
    rows = np.zeros(9000, dtype=ROW)
    rows["system"], rows["component"] = dice.integers(0, systems, 9000), dice.integers(0, 256, 9000)
    rows["sequence"], rows["definition"] = dice.integers(0, 256, 9000), dice.integers(0, 2, 9000)
    steady = np.arange(0, 9000, 10)
    rows["system"][steady], rows["component"][steady] = 77, 1
    rows["sequence"][steady] = np.arange(steady.size) % 256
    whole, cut = StreamStats(load_dialect()), StreamStats(load_dialect())
    whole.add(rows)
    for part in np.split(rows, sorted(cuts)):
        cut.add(part)
    assert whole.counts == cut.counts
    assert list(whole.sequence_losses()) == list(cut.sequence_losses())
    assert whole._senders.size <= 1024
    names = [definition.name for definition in load_dialect().definitions.values()]
    counts: Counter[tuple[int, str]] = Counter()
    for (system, _, name), count in whole.counts.items():
        counts[system, name] += count
    for system, message in itertools.product(range(systems), range(2)):
        sent = np.count_nonzero((rows["system"] == system) & (rows["definition"] == message))
        assert counts[system, names[message]] == sent
    steadily = [count for (s, component, _), count in whole.counts.items() if (s, component) == (77, 1)]
    assert sum(steadily) == steady.size, "who goes on speaking is kept"
    assert not [loss for loss in whole.sequence_losses() if (loss.system, loss.component) == (77, 1)]
