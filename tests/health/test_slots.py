"""Slots of one second: every sample once, whatever the blocks."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.health.slots import Slot, SlotCutter

Array = NDArray[np.float64]


def cut(times: Array, bounds: list[int]) -> tuple[list[Slot], int]:
    cutter = SlotCutter(lateness_s=0.25)
    values = np.repeat(times[:, None], 12, axis=1)
    slots: list[Slot] = []
    for a, b in zip([0, *bounds], [*bounds, len(times)], strict=True):
        slots += list(cutter.feed(times[a:b], values[a:b]))
    slots += list(cutter.finish())
    return slots, cutter.late


times = st.lists(st.integers(-2_000, 30_000), max_size=60).map(lambda ms: np.array(ms, dtype=float) / 1000)


@given(times, st.lists(st.integers(0, 60), max_size=6).map(sorted))
def test_where_blocks_end_does_not_matter(at: Array, bounds: list[int]) -> None:
    expected, late = cut(at, [])
    slots, same_late = cut(at, [min(bound, len(at)) for bound in bounds])
    assert late == same_late
    assert [slot.index for slot in slots] == [slot.index for slot in expected]
    for one, other in zip(slots, expected, strict=True):
        assert np.array_equal(one.time_s, other.time_s)
        assert np.array_equal(one.values, other.values)


@given(times)
def test_every_sample_in_time_is_in_its_slot_once(at: Array) -> None:
    slots, late = cut(at, [])
    own = [slot.time_s[np.floor(slot.time_s) == slot.index] for slot in slots]
    together = np.concatenate(own) if own else np.empty(0)
    assert np.array_equal(together, np.unique(together))
    if late == 0:
        assert np.array_equal(together, np.unique(at))
    for slot in slots:
        assert np.array_equal(slot.values[:, 0], slot.time_s)
        assert (np.diff(slot.time_s) > 0).all()


def test_reordering_within_the_allowance_is_mended() -> None:
    at = np.array([0.1, 0.5, 1.05, 0.9, 1.2, 2.5])
    slots, late = cut(at, [1, 2, 3, 4, 5])
    assert late == 0
    assert [slot.time_s.tolist() for slot in slots] == [
        [0.1, 0.5, 0.9],
        [0.5, 0.9, 1.05, 1.2],
        [1.05, 1.2, 2.5],
    ]


def test_what_comes_after_its_slot_was_closed_is_counted() -> None:
    slots, late = cut(np.array([0.1, 1.3, 0.2, 1.4]), [])
    assert late == 1
    assert 0.2 not in np.concatenate([slot.time_s for slot in slots])
