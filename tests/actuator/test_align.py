"""One clock for several sources, whatever the blocks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.actuator.align import Aligned, Aligner
from mavhums.actuator.profile import load_airframe
from mavhums.actuator.telemetry import Reading, in_columns

ACTUATOR = load_airframe("paper").actuators[2]
TRUST = ("instrumented", "esc-signed", "named", "esc-unsigned", "pwm")
TIERS = {4: "esc-signed", 0: "pwm", 2: "named"}
Array = NDArray[np.float64]


def reading(
    column: int, frames: Sequence[int], times_ms: Sequence[int], values: Sequence[float], tier: str = ""
) -> Reading:
    key, tier = f"V{column + 1}", tier or TIERS[column]
    at, times_us = np.array(frames, dtype=np.int64), np.array(times_ms, dtype=np.int64) * 1000
    samples = in_columns([key], np.array(values)[:, None])
    return Reading(1, ACTUATOR, f"{tier}-{key}", tier, {key: "x"}, at, times_us, samples)


def align(batches: list[list[Reading]], loose: NDArray[np.int64] | None = None) -> tuple[Array, Array]:
    aligner = Aligner(TRUST, 0.05)
    out: list[Aligned] = []
    for batch in batches:
        out += aligner.feed(batch, loose=loose)
    out += aligner.feed([], final=True)
    times = np.concatenate([part.utc_us for part in out]) if out else np.empty(0)
    values = np.concatenate([part.values for part in out]) if out else np.empty((0, 12))
    return times / 1000, values


NAN = np.nan


@pytest.mark.parametrize(
    ("current", "command", "expected"),
    [
        # frames and times, ms, of the current; those of the command and its values
        (([0, 4, 7], [10, 110, 210]), ([1, 3, 6, 9], [0, 100, 200, 300], [0, 10, 20, 30]), [1, 11, 21]),
        (([0, 2], [10, 20]), ([1, 3], [10, 20], [5, 7]), [5, 7]),
        (([1, 2, 3, 5], [0, 100, 31_000, 31_100]), ([0, 4], [0, 200], [0, 0]), [0, NAN, NAN, NAN]),
    ],
    ids=["between", "equal times", "after the horizon"],
)  # fmt: skip
def test_the_current_gives_the_clock_and_others_are_interpolated(
    current: tuple[list[int], list[int]],
    command: tuple[list[int], list[int], list[float]],
    expected: list[float],
) -> None:
    sizes = [float(k) for k in range(len(current[0]))]
    times, values = align([[reading(4, *current, sizes), reading(0, *command)]])
    assert times.tolist() == current[1]
    assert values[:, 4].tolist() == sizes
    np.testing.assert_allclose(values[:, 0], expected)


def test_a_slow_current_does_not_thin_positions() -> None:
    """A current once a second beside positions at 20 Hz: each sample of the position counts."""
    current = reading(4, [*range(0, 400, 100)], [*range(0, 4000, 1000)], [1.0, 2.0, 3.0, 4.0])
    where = list(range(1, 320, 5))
    shaft = reading(2, where, [10 * k for k in where], [float(k) for k in where])
    times, values = align([[current, shaft]])
    assert (times > 1000).sum() == sum(10 * k > 1000 for k in where)
    # The current repeats: nothing takes it for one that is sampled at the rate of the position.
    assert set(values[(times > 1000) & (times < 3000), 4].tolist()) == {2.0, 3.0}


def test_an_angle_once_a_second_is_unknown_between() -> None:
    shaft = reading(2, [0, 3], [0, 1000], [0.0, 8.0])
    current = reading(4, [1, 2, 4, 5], [300, 600, 1000, 1100], [1.0] * 4)
    _, values = align([[shaft, current]])
    assert np.isnan(values[1:3, 2]).all()


def test_the_more_trusted_source_wins_where_it_speaks() -> None:
    current = reading(4, [0, 3, 6], [10, 20, 30], [1.0, 2.0, 3.0])
    poor = reading(0, [1, 4, 7], [10, 20, 30], [5.0, 5.0, 5.0])
    better = reading(0, [2, 5], [10, 20], [6.0, float("nan")], tier="named")
    assert align([[current, poor, better]])[1][:, 0].tolist() == [6.0, 5.0, 5.0]


def test_a_better_clock_takes_over_where_it_first_speaks() -> None:
    command = reading(0, [0, 1, 3, 5], [0, 100, 200, 300], [0.0, 1.0, 2.0, 3.0])
    current = reading(4, [2, 4, 6], [150, 250, 350], [1.0, 1.0, 1.0])
    times, _ = align([[command, current]])
    assert times.tolist() == [0, 100, 150, 250, 350]


def test_a_late_message_is_not_a_lost_one() -> None:
    current = reading(4, list(range(60)), [100 * k for k in range(60)], [1.0] * 60)
    command = reading(
        0, list(range(60, 120)), [100 * k + 50 for k in range(60)], [float(k) for k in range(60)]
    )
    values = align([[current], [command]])[1]
    assert values[1:, 0] == pytest.approx(np.arange(59) + 0.5)


@pytest.mark.slow
@given(st.data())
@settings(max_examples=300, deadline=None)
def test_where_blocks_end_does_not_matter(data: st.DataObject) -> None:
    """Messages of three sources in any order, late and reordered, some from later on, cut anywhere."""
    count, step_ms = data.draw(st.integers(1, 40)), data.draw(st.sampled_from([20, 200, 1000, 5000]))
    speaks_from = {column: data.draw(st.sampled_from([0, 0, 8, 20])) for column in (0, 2, 4)}
    late_ms = st.sampled_from([0, 0, 0, -300, 300, -8000, -40_000])
    rows = []
    for k in range(count):
        column = data.draw(st.sampled_from([c for c in (0, 2, 4) if speaks_from[c] <= k] or [4]))
        rows.append((column, k, step_ms * k + data.draw(late_ms), float(k)))

    def batch(start: int, end: int) -> list[Reading]:
        parts = {column: [row[1:] for row in rows[start:end] if row[0] == column] for column in (0, 2, 4)}
        sent = {column: [*zip(*mine, strict=True)] for column, mine in parts.items() if mine}
        return [reading(column, frames, times, values) for column, (frames, times, values) in sent.items()]

    edges = [0, *sorted(data.draw(st.lists(st.integers(0, count), max_size=10))), count]
    loose = np.array(sorted(data.draw(st.sets(st.integers(0, count), max_size=10))), dtype=np.int64)
    whole = align([batch(0, count)], loose)
    parts = align([batch(a, b) for a, b in itertools.pairwise(edges)], loose)
    assert np.array_equal(whole[0], parts[0])
    assert np.array_equal(whole[1], parts[1], equal_nan=True)


def test_values_whose_time_is_blurred_are_not_combined() -> None:
    current = reading(4, [0, 2, 4], [0, 100, 200], [1.0, 2.0, 3.0])
    command = reading(0, [1, 3, 5], [0, 100, 200], [5.0, 6.0, 7.0])
    of_clock = align([[current, command]], np.array([2]))[1]
    assert of_clock[:, 4].tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(of_clock[:, 0], [5.0, np.nan, 7.0], equal_nan=True)
    of_other = align([[current, command]], np.array([3]))[1]
    assert np.array_equal(of_other[:, 0], [5.0, np.nan, 7.0], equal_nan=True)


@pytest.mark.parametrize("clock_speaks", [True, False])
def test_memory_does_not_grow_whether_or_not_the_clock_falls_silent(clock_speaks: bool) -> None:
    aligner, settled = Aligner(TRUST, 0.05), 0
    aligner.feed([reading(4, [0, 1], [0, 10], [1.0, 2.0])])
    for k in range(1, 200):
        frames = range(100 * k, 100 * k + 100)
        times = [100 * frame - 10_000 for frame in frames]
        columns = (4, 0) if clock_speaks else (0,)
        new = aligner.feed([reading(column, frames, times, [1.0] * 100) for column in columns])
        settled += sum(part.utc_us.size for part in new)
    assert clock_speaks or settled == 2
    assert aligner.kept < 700


def settled_by(batches: list[list[Reading]]) -> list[list[float]]:
    """The times that each batch settles, in milliseconds."""
    aligner = Aligner(TRUST, 0.05)
    return [[time / 1000 for part in aligner.feed(batch) for time in part.utc_us] for batch in batches]


def test_a_source_alone_is_not_kept_waiting() -> None:
    """Once ten seconds have shown what sources there are."""
    batches = [[reading(4, [k], [100 * k], [1.0])] for k in range(140)]
    settled = settled_by(batches)
    assert settled[:100] == [[]] * 100
    assert settled[100] == [100 * k for k in range(101)]
    assert settled[101:] == [[100 * k] for k in range(101, 140)]


@pytest.mark.parametrize("has_all", [False, True])
def test_a_sample_waits_for_the_source_that_gives_what_it_lacks(has_all: bool) -> None:
    current = [
        [both(2 * k, 100 * k) if has_all else reading(4, [2 * k], [100 * k], [1.0])] for k in range(140)
    ]
    command = [[reading(0, [2 * k + 1], [100 * k + 30], [2.0])] for k in range(140)]
    settled = settled_by([batch for pair in zip(current, command, strict=True) for batch in pair])
    assert settled[220:222] == ([[11_000], []] if has_all else [[], [11_000]])


def test_nothing_waits_for_a_source_that_died() -> None:
    batches = [[reading(0, [0, 1], [0, 5000], [2.0, 2.0])]]
    batches += [[reading(4, [k + 2], [100 * k], [1.0])] for k in range(800)]
    settled = settled_by(batches)
    assert settled[1 + 200] == []  # 20 s: it may still come
    assert settled[1 + 400] == [10_000]  # none waits longer than the horizon
    assert settled[1 + 700 :] == [[100 * k] for k in range(700, 800)]


def both(frame: int, time_ms: int) -> Reading:
    """A message that carries command and current."""
    values, fields = in_columns(["V1", "V5"], np.array([[1.0, 2.0]])), {"V1": "x", "V5": "y"}
    at, times_us = np.array([frame]), np.array([time_ms * 1000])
    return Reading(1, ACTUATOR, "both", "instrumented", fields, at, times_us, values)


@pytest.mark.parametrize("behind_ms", [120_000, 142_500, 155_000])
@pytest.mark.parametrize("step", [7, 10, 13])
def test_what_was_forgotten_while_the_clock_was_silent_never_counts(behind_ms: int, step: int) -> None:
    """A sample seconds behind the rest is the same whether the rest came at once or in parts."""
    first = reading(4, [0], [0], [1.0])

    def command(start: int, end: int) -> Reading:
        numbers = range(start, min(end, 200))
        return reading(0, [n + 1 for n in numbers], [1000 * n for n in numbers], [float(n) for n in numbers])

    behind = reading(4, [500], [behind_ms], [1.0])
    at_once = align([[first, command(0, 200)], [behind]])
    in_parts = align([[first], *([command(n, n + step)] for n in range(0, 200, step)), [behind]])
    assert at_once[0].tolist() == in_parts[0].tolist() == [0, behind_ms]
    assert np.isnan(at_once[1][1]).all()
    assert np.isnan(in_parts[1][1]).all()
