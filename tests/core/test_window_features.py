"""The statistics of a window: what they are of known motions, and that they follow from sums alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.core.quantities import (
    MOMENTS,
    SUMS,
    WINDOW_FEATURES,
    WINDOW_KEYS,
    of_window,
    products,
    shows_something,
    window_features,
)

Array = NDArray[np.float64]


def moments(count: int = 400, *, friction: float = 0.1, seed: int = 1) -> Array:
    """Samples whose current is friction, load, drag and inertia, and whose voltage 20 Ω and back-EMF."""
    random = np.random.default_rng(seed)
    speed, load, slope, angle = random.normal(size=(4, count))
    current = friction * np.sign(speed) + 0.2 * load + 0.03 * speed + 0.05 * slope
    gap = 0.3 + 0.1 * np.sign(current)
    made = {"1": np.ones(count), "way": np.sign(speed), "flank": np.sign(current), "gap": gap, "slope": slope}
    made |= {"V3": 10 * angle, "V4": 20 * current + 5 * speed + 0.5, "V5": current, "V7": speed, "V11": load}
    return np.stack([made[name] for name in MOMENTS], axis=1)


COUNT = 400
CARRIED = ("V1", "V2", "V4", "V11")


def slot(
    moving: Array, *, commanded: float = 10.0, flown: float = 9.0, peak: float = 12.0, **carried: int
) -> Array:
    """Return the sums of a slot of 400 samples, some of which move; each quantity has so many of them."""
    counts = [carried.get(key, COUNT) for key in CARRIED]
    others = [COUNT, commanded, flown, COUNT * 0.5, COUNT * 0.5, COUNT * 9.0, *counts, peak]
    return np.concatenate([products(moving).sum(axis=0), others])


def statistics(*slots: Array) -> dict[str, float]:
    found = window_features(of_window(np.stack(slots)[None]))[0]
    return dict(zip(WINDOW_KEYS, found.tolist(), strict=True))


def test_a_known_motion_has_the_statistics_of_its_physics() -> None:
    found = statistics(slot(moments()))
    assert found["V5|V11 way"] == pytest.approx(0.1, rel=0.05)
    assert found["V5|V11 load"] == pytest.approx(0.2, rel=0.02)
    assert found["V4|V5"] == pytest.approx(20.0, rel=0.02)
    assert found["V4|V7"] == pytest.approx(5.0, rel=0.05)
    assert found["V4 rest"] < 0.1
    assert found["gap mean"] == pytest.approx(0.3, abs=0.02)
    assert found["gap flank"] == pytest.approx(0.1, rel=0.02)
    assert found["flown"] == pytest.approx(0.9)
    assert found["missed mean"] == pytest.approx(0.5)
    assert found["missed std"] == pytest.approx(0.5)
    assert found["V4 all rms"] == pytest.approx(3.0)


@given(st.floats(0.05, 0.4), st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_friction_is_separate_from_load_drag_and_inertia(friction: float, seed: int) -> None:
    found = statistics(slot(moments(friction=friction, seed=seed)))
    assert found["V5|V11 way"] == pytest.approx(friction, rel=0.05)


@given(st.lists(st.integers(1, 399), max_size=9, unique=True))
@settings(max_examples=20, deadline=None)
def test_statistics_do_not_depend_on_the_division_into_slots(cuts: list[int]) -> None:
    parts = np.split(moments(), sorted(cuts))
    share = [len(part) / 400 for part in parts]
    found = statistics(
        *(
            slot(part, commanded=10 * one, flown=9 * one, peak=12.0 - k)
            for k, (part, one) in enumerate(zip(parts, share, strict=True))
        )
    )
    assert found == pytest.approx(statistics(slot(moments())), rel=1e-9, abs=1e-9)


def test_the_number_of_windows_asked_at_once_does_not_change_a_digit() -> None:
    sums = np.stack([slot(moments(seed=seed)) for seed in range(40)])
    together = window_features(sums)
    for k in range(40):
        np.testing.assert_array_equal(together[k], window_features(sums[k : k + 1])[0])


def test_a_window_of_too_few_samples_shows_nothing() -> None:
    for count, shown in ((75, True), (74, False)):
        sums = slot(moments(count))
        sums[len(sums) - 7 - len(CARRIED)] = count  # all samples, the first of the sums of all
        assert shows_something(sums[None]).tolist() == [shown]


def test_what_is_not_measured_is_missing_and_what_is_at_rest_is_zero() -> None:
    for key in CARRIED:
        needing = {name for name, needs in WINDOW_FEATURES.items() if key in needs}
        # A shaft at rest has sums of 0, also of what the log carries in too few samples.
        for count, expected in ((COUNT // 2, set[str]()), (COUNT // 2 - 1, needing)):
            still = statistics(slot(moments()[:0], **{key: count}))
            assert {name for name, value in still.items() if np.isnan(value)} == expected
            assert still["V5|V3 way"] == 0.0
    # What the samples in motion carry, those at rest need not.
    found = statistics(slot(moments(), V4=COUNT // 2 - 1))
    assert {name for name, value in found.items() if np.isnan(value)} == {"V4 all rms", "V4 peak"}
    samples = moments()
    samples[:, MOMENTS.index("V11")] = np.nan
    found = statistics(slot(samples))
    assert {name for name, value in found.items() if np.isnan(value)} == {
        k for k in WINDOW_KEYS if "V11" in k
    }


def test_a_window_is_asked_where_it_moves_both_ways_or_stays_behind_its_command() -> None:
    samples = moments(40)
    one_way = samples[samples[:, 1] > 0]
    held = [slot(samples[:0], commanded=by, flown=to) for by, to in ((10.0, 1.0), (4.0, 0.0), (10.0, 9.0))]
    rows = np.stack([slot(samples), slot(samples[:19]), slot(one_way), *held])
    assert rows.shape == (6, SUMS)
    assert shows_something(rows).tolist() == [True, False, False, True, False, False]
