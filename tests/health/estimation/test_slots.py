"""Slots: every sample once, in the slot that confirms it, whatever the blocks."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.health.estimation.slots import COLUMNS, SlotCutter, Slots

GUARD_S = 0.06

Array = NDArray[np.float64]


def cut(times: Array, bounds: list[int]) -> list[Slots]:
    cutter = SlotCutter()
    values = np.repeat(times[:, None], COLUMNS, axis=1)
    ends = [min(bound, len(times)) for bound in bounds]
    found = [cutter.feed(times[a:b], values[a:b]) for a, b in zip([0, *ends], [*ends, None], strict=True)]
    return [slots for slots in [*found, cutter.finish()] if slots is not None]


def judged(parts: list[Slots]) -> list[tuple[int, float]]:
    """Every judged sample, with the slot in which it counts."""
    return [
        (int(number), float(time_s))
        for part in parts
        for number, own in zip(
            part.index, np.split(part.time_s[part.judged], part.start[1:].tolist()), strict=True
        )
        for time_s in own
    ]


def confirmed(at: Array) -> list[tuple[int, float]]:
    """The rule, one sample after the other; the last ones are never confirmed."""
    out = []
    for time_s in at:
        later = [other for other in at if other >= time_s + GUARD_S]
        if len(later) > 1:
            out.append((int(np.floor(later[1])), float(time_s)))
    return out


times = st.sets(st.integers(-2_000, 30_000), max_size=60).map(
    lambda ms: np.array(sorted(ms), dtype=float) / 1000
)
steps = st.lists(st.sampled_from([1, 10, 40, 100, 100, 100, 400, 3_000]), max_size=80)
steady = steps.map(lambda ms: np.cumsum(np.array(ms, dtype=float)) / 1000)
bounds = st.lists(st.integers(0, 80), max_size=6).map(sorted)


@given(st.one_of(times, steady), bounds)
@example(np.arange(200) / 10.0, [3, 77, 78])
def test_where_blocks_end_does_not_matter(at: Array, cuts: list[int]) -> None:
    assert judged(cut(at, cuts)) == judged(cut(at, []))


@given(st.one_of(times, steady), bounds)
def test_a_sample_counts_where_it_is_confirmed(at: Array, cuts: list[int]) -> None:
    assert judged(cut(at, cuts)) == confirmed(at)


@given(st.one_of(times, steady), bounds)
def test_every_judged_sample_has_its_own_values_and_its_neighbours(at: Array, cuts: list[int]) -> None:
    for part in cut(at, cuts):
        assert np.array_equal(part.values[:, 0], part.time_s)
        assert (np.diff(part.time_s) > 0).all()
        assert int(part.count().sum()) == len(part.time_s[part.judged])
        first = part.time_s[part.judged][0]
        near = at[(at > first - GUARD_S) & (at < first)]
        before = at[at <= first - GUARD_S][-2:]
        # Those before the first one that are needed, and no others: they cost memory.
        assert part.time_s[: part.judged.start].tolist() == [*before, *near]
