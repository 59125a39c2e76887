"""The sequential test against its definition, and its promise of false alarms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from mavhums.health.sequential import SequentialTest

SHIFTS = np.array([0.5, 1.0, 2.0])


def fed(values: np.ndarray, false_alarm_s: float = 1e9) -> tuple[SequentialTest, list[bool]]:
    """Return a test of the mean of normal values, and in which units it saw a fault."""
    test = SequentialTest(np.ones(len(SHIFTS)), 360_000.0 / false_alarm_s)
    present = []
    for at, value in enumerate(values):
        ratios = SHIFTS * value - SHIFTS**2 / 2
        present.append(test.feed(at, ratios, float(ratios[test.likeliest])))
    return test, present


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=30))
def test_the_evidence_sums_the_likelihoods_of_all_onsets(values: list[float]) -> None:
    test, _ = fed(np.array(values))
    ratios = SHIFTS * np.array(values)[:, None] - SHIFTS**2 / 2
    onsets = sum(np.exp(ratios[first:].sum(axis=0)) for first in range(len(values)))
    assert test.evidence == pytest.approx(float(np.log(np.mean(onsets))), abs=1e-9)
    assert test.shares() == pytest.approx(onsets / np.sum(onsets))


def test_false_alarms_are_as_rare_as_promised() -> None:
    """Until a fifth of the time between two, at most a fifth of the flights have one."""
    rng, mean_s, runs = np.random.default_rng(1), 500.0, 400
    alarms = sum(any(fed(rng.normal(size=100), mean_s)[1]) for _ in range(runs))
    assert binomtest(alarms, runs, 0.2, alternative="greater").pvalue > 0.01


@pytest.mark.parametrize(("shift", "delay"), [(0.5, 120), (1.0, 35), (2.0, 10)])
def test_a_fault_is_found_and_its_end_and_its_onset(shift: float, delay: int) -> None:
    """The delay is the logarithm of the threshold by the information of a unit, shift² / 2."""
    values = np.random.default_rng(2).normal(size=700)
    values[200:500] += shift
    _, present = fed(values, 1e4)
    first, last = present.index(True), 699 - present[::-1].index(True)
    assert 200 < first < 200 + delay
    assert 500 < last < 500 + 2 * delay
    assert np.mean(present[first : last + 1]) > 0.9
    begun, _ = fed(values[:500])
    assert begun.since == pytest.approx(200, abs=10)
