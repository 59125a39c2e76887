import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from mavhums.paper.cyclograms import (
    CONDITIONS,
    CYCLOGRAMS,
    PILOT,
    TABLE_4,
    TABLE_5,
    TEST_NM,
    TRAINING_NM,
    fly_condition,
)
from mavhums.paper.experiment import held_decision


def test_the_decision_in_motion_is_kept_through_standstill() -> None:
    decisions = np.array([1, 1, 0, 1, 1, 1, 0], dtype=bool)
    moving = np.array([0, 1, 1, 0, 0, 1, 0], dtype=bool)
    decision, decided = held_decision(decisions, moving)
    assert decided.tolist() == [False, True, True, True, True, True, True]
    assert decision[1:].tolist() == [True, False, False, False, True, True]


def test_a_majority_of_the_last_votes_decides() -> None:
    decisions = np.array([1, 1, 1, 0, 0, 0], dtype=bool)
    decision, _ = held_decision(decisions, np.ones(6, dtype=bool), votes=3)
    assert decision.tolist() == [True, True, True, True, False, False]


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.booleans(), st.booleans()), min_size=2, max_size=40), st.integers(1, 5), st.data()
)
def test_what_follows_never_changes_a_decision(
    rows: list[tuple[bool, bool]], votes: int, data: st.DataObject
) -> None:
    decisions, moving = (np.array(part) for part in zip(*rows, strict=True))
    cut = data.draw(st.integers(1, len(rows)))
    whole, part = held_decision(decisions, moving, votes), held_decision(decisions[:cut], moving[:cut], votes)
    np.testing.assert_array_equal(whole[0][:cut], part[0])
    np.testing.assert_array_equal(whole[1][:cut], part[1])


@pytest.mark.slow
def test_all_conditions_of_a_cyclogram_fly_the_same_command_at_the_same_times() -> None:
    for name in CYCLOGRAMS:
        first, *others = fly_condition(name, (0.225, 0.875))
        for flown in others:
            np.testing.assert_array_equal(first.values[:, 0], flown.values[:, 0])
            np.testing.assert_array_equal(first.time_s, flown.time_s)
        assert first.values.shape == (10_000, 12)


@pytest.mark.slow
def test_the_main_cyclogram_is_what_it_is_said_to_be() -> None:
    flights = fly_condition(PILOT, CONDITIONS)
    assert np.abs(flights[0].values[:, 0]).max() > 19.9
    assert min(flown.moving_fraction for flown in flights) >= 0.9
    assert max(flown.moving_fraction for flown in flights) < 0.96


def test_the_split_is_the_paper_s() -> None:
    assert set(TRAINING_NM) | set(TEST_NM) == set(CONDITIONS)
    assert not set(TRAINING_NM) & set(TEST_NM)
    assert max(row.test for row in TABLE_4) == 96.70167
    assert max(row.test for row in TABLE_5) == 98.01
    assert np.isclose(chi2.sf(26.56, 11), 0.005352, atol=1e-6)
