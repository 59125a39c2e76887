"""What a network says over a flight: counts, the first emergency, and a condition by runs of windows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.core.conditions import SEVERITY
from mavhums.health.actuator.detector import sharp
from mavhums.health.actuator.network_tally import NetworkTally
from mavhums.health.actuator.votes import VoteOutcome, by_votes
from mavhums.learn import packaged_models
from mavhums.results.sections import NetworkAnswer
from tests.present import present

ONE = packaged_models()[:1]
GRAVE, SOUND, EVEN = by_votes(0.8, 0), by_votes(0.3, 0), by_votes(0.5, 0)
WORN = VoteOutcome(0, "friction_degraded", "friction_degraded", 1, 1, 0.99, 1.0)
PLAY = VoteOutcome(0, "backlash", "backlash", 1, 1, 0.99, 0.99)
UNSURE = VoteOutcome(0, "abstained", "backlash", -1, 1, 0.6, 0.6)
ALIEN = VoteOutcome(0, "outside", "jam", -1, 2, 1.0, 1.0)


def fed(tally: NetworkTally, *said: VoteOutcome | None) -> list[tuple[int, str, float]]:
    """Feed windows of 10 s that end a second after one another; return each change."""
    ends = [10.0 + k for k in range(len(said))]
    return [(k, change.condition, change.since_s) for k, change in tally.feed(said, ends)]


def counted(found: NetworkAnswer) -> dict[str, int]:
    return {said: one.windows for said, one in found.classes.items()}


def test_two_windows_that_share_no_sample_decide_and_doubts_that_lean_alike_do_not_matter() -> None:
    assert fed(NetworkTally(ONE), *[GRAVE] * 10) == []
    assert fed(NetworkTally(ONE), *[GRAVE] * 11) == [(10, "emergency", 0.0)]
    assert fed(NetworkTally(ONE), WORN, *[UNSURE, None, ALIEN] * 4, WORN) == [(13, "degraded", 0.0)]
    assert fed(NetworkTally(ONE), SOUND, *[UNSURE] * 9, SOUND) == []
    assert fed(NetworkTally(ONE), *[EVEN, None] * 20) == [(10, "normal", 0.0)]


@given(st.lists(st.sampled_from([SOUND, WORN, PLAY, GRAVE, UNSURE, ALIEN]), max_size=80))
def test_what_is_held_lies_within_what_the_windows_say(said: list[VoteOutcome]) -> None:
    """Worse windows are never a milder verdict: each taken one class up, the worst is no less."""
    worse = {SOUND: WORN, WORN: GRAVE, PLAY: GRAVE}
    tally, other = NetworkTally(ONE), NetworkTally(ONE)
    fed(tally, *said)
    fed(other, *[worse.get(one, one) for one in said])
    assert SEVERITY[other.worst] >= SEVERITY[tally.worst]
    sure = [one.severity for one in said if one.severity >= 0]
    if tally.worst != "undecided":
        assert min(sure) <= SEVERITY[tally.worst] <= max(sure)


def test_degraded_windows_among_emergencies_are_at_least_degraded() -> None:
    assert fed(NetworkTally(ONE), *[GRAVE, WORN] * 10) == [(10, "degraded", 0.0)]
    assert fed(NetworkTally(ONE), *[SOUND, WORN] * 10) == []


def test_a_change_counts_from_the_middle_of_its_first_window_and_the_worst_stays() -> None:
    tally = NetworkTally(ONE)
    assert tally.answer() is None
    changes = fed(tally, *[SOUND] * 20, *[GRAVE] * 20, *[SOUND] * 20)
    assert changes == [(10, "normal", 0.0), (30, "emergency", 25.0), (50, "normal", 45.0)]
    found = present(tally.answer())
    assert (found.windows, found.first_emergency_s, found.condition) == (60, 25.0, "emergency")
    assert (found.latest, found.probability) == (SOUND.said, 0.7)
    assert counted(found) == {"normal": 40, "friction_emergency": 20}
    assert [one.probability for one in found.classes.values()] == pytest.approx([0.7, 0.8])
    spans = [(one.start_s, one.end_s) for one in tally.evidence()]
    assert spans == [(0.0, 25.0), (25.0, 45.0), (45.0, 69.0)]
    episodes = [(one.rule.split(":")[0], one.value) for one in tally.evidence()]
    assert episodes == [("normal", 0.7), ("emergency", 0.8), ("normal", 0.7)]


@pytest.mark.parametrize(
    ("said", "condition", "fault"),
    [(GRAVE, "emergency", "friction"), (WORN, "degraded", "friction"), (PLAY, "degraded", "backlash")],
)
def test_the_condition_is_that_of_the_class(said: VoteOutcome, condition: str, fault: str) -> None:
    tally = NetworkTally(ONE)
    assert tally.suspect() is None
    assert fed(tally, *[said] * 20) == [(10, condition, 0.0)]
    suspect, found = present(tally.suspect()), present(tally.answer())
    assert (suspect.fault, suspect.confidence) == (fault, said.probability)
    assert (found.condition, found.says) == (condition, said.said)


def test_windows_are_counted_by_class_and_those_that_are_not_sure_decide_nothing() -> None:
    tally = NetworkTally(ONE)
    fed(tally, *[UNSURE] * 30, *[WORN] * 9, *[ALIEN] * 2)
    found = present(tally.answer())
    assert (found.condition, found.says, found.windows) == ("undecided", None, 9)
    assert counted(found) == {"abstained": 30, "friction_degraded": 9, "outside": 2}
    assert (found.latest, found.probability) == (ALIEN.said, 1.0)


def test_the_network_with_most_votes_answers_for_its_share_of_samples() -> None:
    """Columns: network, moving, voters backward and forward, emergencies backward and forward."""
    tally = NetworkTally(packaged_models()[:2])
    tally.count(np.array([[0, 9, 2, 2, 1, 0], [1, 9, 5, 3, 2, 4], [-1, 9, 0, 0, 0, 0], [1, 9, 1, 1, 0, 0]]))
    tally.count(np.array([[0, 9, 2, 3, 0, 0]]))
    fed(tally, GRAVE)
    found = present(tally.answer())
    assert (found.model.hash, found.share_of_samples) == (packaged_models()[1].hash, 0.6)


def test_why_a_network_decides_nothing() -> None:
    tally = NetworkTally(ONE)
    assert tally.why_undecided(physics=True).code == "network_unfed"
    fed(tally, GRAVE, SOUND)
    unsure, blank = (tally.why_undecided(physics=physics) for physics in (True, False))
    assert unsure.code == "network_unsure"
    assert "sure of 2 of 2 windows" in unsure.text
    assert unsure.remedy.endswith("(--decide physics)")
    assert blank.remedy.endswith("fill in the profile's constants and limits")
    fed(tally, *[ALIEN] * 3)
    outside = tally.why_undecided(physics=True)
    assert outside.code == "network_outside"
    assert " 3 of 5 windows" in outside.text


@pytest.mark.parametrize(
    ("value", "error", "limit", "expected"),
    [
        (0.1, 0.039, 0.2, True),
        (0.1, 0.041, 0.2, False),
        (0.4, 0.079, 0.2, True),  # twice the limit allows twice the error
        (-0.4, 0.079, 0.2, True),
        (0.4, 0.081, 0.2, False),
        (9.0, 1.0, None, True),
    ],
)
def test_beyond_its_limit_a_quantity_may_be_less_certain(
    value: float, error: float, limit: float | None, expected: bool
) -> None:
    assert sharp(np.array([value]), np.array([error]), limit).tolist() == [expected]
    if limit is not None:
        assert sharp(np.array([value]), np.array([error / 2]), limit, limit / 2).tolist() == [expected]
