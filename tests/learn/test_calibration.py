"""From a share of votes to a probability, and how far it can be trusted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.core.errors import MavhumsError
from mavhums.learn import Calibration, brier_score, calibrate, expected_calibration_error


def drawn(truth: Calibration, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    share = random.uniform(size=count)
    return share, random.uniform(size=count) < [truth.probability(each) for each in share]


def test_a_known_calibration_is_found_again() -> None:
    truth = Calibration(slope=9.0, intercept=-3.0)
    found = calibrate(*drawn(truth, 40_000, 0))
    assert found.slope == pytest.approx(9.0, rel=0.05)
    assert found.intercept == pytest.approx(-3.0, rel=0.05)


def test_calibration_makes_a_share_a_probability() -> None:
    truth = Calibration(slope=12.0, intercept=-9.0)
    fitted = calibrate(*drawn(truth, 5_000, 1))
    share, event = drawn(truth, 5_000, 2)
    said = [fitted.probability(each) for each in share]
    assert expected_calibration_error(share, event) > 0.1
    assert expected_calibration_error(said, event) < 0.02
    assert brier_score(said, event) < brier_score(share, event)


def test_one_outcome_alone_calibrates_nothing() -> None:
    with pytest.raises(ValueError, match="class"):
        calibrate([0.1, 0.2], [True, True])


@pytest.mark.parametrize("share", [[0.9, 0.8, 0.1, 0.2], [0.5, 0.5, 0.5, 0.5]])
def test_votes_against_the_flights_are_not_turned_round(share: list[float]) -> None:
    with pytest.raises(MavhumsError, match=r"the rarer is one \(slope .*: check that no label"):
        calibrate(share, [False, False, True, True])


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=50))
def test_the_scores_are_those_of_their_definitions(windows: list[tuple[float, bool]]) -> None:
    said, event = np.array([p for p, _ in windows]), np.array([was for _, was in windows])
    assert brier_score(said, event) == pytest.approx(sum((p - was) ** 2 for p, was in windows) / len(windows))
    expected = 0.0
    for k in range(10):
        there = [(p, was) for p, was in windows if min(int(p * 10), 9) == k]
        if there:
            gap = sum(p for p, _ in there) / len(there) - sum(was for _, was in there) / len(there)
            expected += abs(gap) * len(there) / len(windows)
    assert expected_calibration_error(said, event) == pytest.approx(expected, abs=1e-12)
