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
    times, values = times[times >= current[1][0]], values[times >= current[1][0]]
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


def settled_by(batches: list[list[Reading]]) -> list[float]:
    """The time of the latest sample that is final after each batch, s; −1 before any."""
    aligner, latest, out = Aligner(TRUST, 0.05), -1.0, []
    for batch in batches:
        for part in aligner.feed(batch):
            latest = float(part.utc_us[-1]) / 1e6
        out.append(latest)
    return out


def last_before(newest_ms: int) -> float:
    """The latest time of a source of 10 Hz, s, before the last eighth of a second that has passed."""
    return ((newest_ms // 125 * 125 - 1) // 100) / 10


def test_a_source_alone_is_not_kept_waiting() -> None:
    """Once ten seconds have shown what sources there are."""
    settled = settled_by([[reading(4, [k], [100 * k], [1.0])] for k in range(140)])
    assert settled[:90] == [-1.0] * 90
    assert settled[100:] == [last_before(100 * k) for k in range(100, 140)]


def test_a_sample_waits_for_every_source_that_speaks() -> None:
    current = [[reading(4, [k], [100 * k], [1.0])] for k in range(200)]
    command = reading(0, range(200, 316), [100 * k for k in range(116)], [2.0] * 116)
    later = reading(0, [316], [14_030], [2.0])
    early = reading(0, [317], [13_000], [2.0])
    settled = settled_by([[reading(0, [0], [0], [2.0])], *current, [command], [later], [early]])
    assert settled[-5:] == [-1.0, -1.0, 11.4, 13.9, 13.9]


def test_nothing_waits_for_a_source_that_died() -> None:
    batches = [[reading(0, [0, 1], [0, 5000], [2.0, 2.0])]]
    batches += [[reading(4, [k + 2], [100 * k], [1.0])] for k in range(800)]
    settled = settled_by(batches)
    assert settled[1 + 340] == 4.9  # it may still come
    assert settled[1 + 351] == 34.9  # none waits longer than the horizon
    assert settled[1 + 700 :] == [last_before(100 * k) for k in range(700, 800)]


@pytest.mark.parametrize("step", [1, 7, 200])
def test_what_comes_after_its_time_is_settled_does_not_count(step: int) -> None:
    """It is the same whether the rest came at once or in parts."""

    def command(first: int, end: int) -> Reading:
        numbers = range(first, min(end, 200))
        return reading(0, [n + 1 for n in numbers], [1000 * n for n in numbers], [float(n) for n in numbers])

    aligner, times = Aligner(TRUST, 0.05), []
    batches = [reading(4, [0], [0], [1.0])]
    batches += [command(n, n + step) for n in range(0, 200, step)]
    batches.append(reading(4, [500, 501], [155_000, 199_500], [1.0, 1.0]))
    for batch in batches:
        times += [part.utc_us for part in aligner.feed([batch])]
    times += [part.utc_us for part in aligner.feed([], final=True)]
    assert np.concatenate(times).tolist() == [0, 199_500_000]
    assert aligner.late == 1
