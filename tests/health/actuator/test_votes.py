"""The networks' votes: who is asked, who abstains, and what a window of votes amounts to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.core.quantities import MOMENTS, SUMS, WINDOW_KEYS, column, products
from mavhums.health.actuator.votes import (
    VoteOutcome,
    by_votes,
    count_votes,
    network_inputs,
    outcome,
    window_outcomes,
)
from tests.present import present

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Threshold:
    """Calls an emergency where V5 exceeds one ampere; knows only positive currents."""

    keys: tuple[str, ...] = ("V5",)
    slope: float = 1.0

    def votes(self, values: Array) -> NDArray[np.int8]:
        current = values[:, 4]
        return np.where(current > 0, current > 1.0, -1).astype(np.int8)

    def probability(self, share: float) -> float:
        return self.slope * share

    window_classes: tuple[str, ...] = ()
    window_level: float = 0.7

    def classify_windows(self, features: Array) -> tuple[Array, NDArray[np.bool_]]:
        raise AssertionError("it has no network of windows")


def samples(currents: list[float], speeds: list[float] | None = None) -> Array:
    values = np.zeros((len(currents), 12))
    values[:, 4] = currents
    values[:, 6] = 1.0 if speeds is None else speeds
    values[:, 1:3] = np.random.default_rng(0).normal(size=(len(currents), 2))
    return values


def row(network: int, moving: int, voters: tuple[int, int], emergency: tuple[int, int]) -> list[int]:
    return [network, moving, *voters, *emergency]


def test_samples_inside_the_envelope_vote_by_direction() -> None:
    values = samples([2.0, 2.0, 0.5, -1.0, 2.0], [1.0, -1.0, 1.0, 1.0, -1.0])
    assert count_votes([Threshold()], values, [0, 5]).tolist() == [row(0, 5, (2, 2), (2, 1))]


@given(
    st.lists(st.sampled_from([0.5, 2.0, -1.0, np.nan]), max_size=30),
    st.lists(st.integers(0, 30), max_size=4),
    st.data(),
)
def test_a_slot_does_not_depend_on_its_neighbours(
    currents: list[float], cuts: list[int], data: st.DataObject
) -> None:
    speeds = data.draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=len(currents), max_size=len(currents)))
    networks = [Threshold(("V5", "V11")), Threshold(("V4",))]
    values = samples(currents, speeds)
    values[::3, 10] = np.nan
    bounds = [0, *sorted(min(cut, len(values)) for cut in cuts), len(values)]
    together = count_votes(networks, values, bounds)
    for k in range(len(bounds) - 1):
        own = values[bounds[k] : bounds[k + 1]]
        np.testing.assert_array_equal(together[k], count_votes(networks, own, [0, len(own)])[0])


def test_the_first_network_whose_quantities_are_there_is_asked() -> None:
    networks = [Threshold(("V5", "V11")), Threshold(("V3", "V5")), Threshold(("V5",))]

    def asked(values: Array) -> int:
        return int(count_votes(networks, values, [0, len(values)])[0, 0])

    values = samples([2.0] * 4)
    assert asked(values) == 0
    values[:2, column("V11")] = np.nan
    assert asked(values) == 0
    values[:3, column("V11")] = np.nan
    assert asked(values) == 1
    values = network_inputs(values, np.array([[True, False]] * 4))
    assert asked(values) == 2
    values[:, column("V5")] = np.nan
    assert asked(values) == -1


def window(*rows: list[int]) -> NDArray[np.int64]:
    return np.array(rows, dtype=np.int64).reshape(-1, 6)


def test_the_directions_count_alike_whatever_their_number() -> None:
    votes = window(row(0, 50, (10, 40), (10, 0)), row(0, 50, (10, 40), (0, 0)))
    assert outcome([Threshold(slope=0.5)], votes) == by_votes(0.125, 0)


def test_the_networks_abstain_on_few_or_foreign_samples() -> None:
    networks = [Threshold()]
    assert outcome(networks, window()) is None
    assert outcome([], window(row(-1, 100, (0, 0), (0, 0)))) is None
    assert outcome(networks, window(row(0, 19, (9, 10), (9, 10)))) is None
    assert outcome(networks, window(row(0, 100, (90, 9), (9, 9)))) is None
    assert outcome(networks, window(row(0, 100, (90, 10), (90, 10)))) == by_votes(1.0, 0)
    assert outcome(networks, window(row(0, 50, (10, 10), (9, 9)))) is None
    assert outcome(networks, window(row(0, 40, (10, 10), (5, 10)))) == by_votes(0.75, 0)
    assert outcome(networks, window(row(0, 20, (10, 10), (5, 10)), row(-1, 21, (0, 0), (0, 0)))) is None


def test_where_the_telemetry_changes_the_network_with_most_votes_decides() -> None:
    networks = [Threshold(), Threshold()]
    few, many = row(0, 40, (20, 20), (20, 20)), row(1, 60, (30, 30), (0, 15))
    assert outcome(networks, window(few, many)) == by_votes(0.25, 1)
    assert outcome(networks, window(few, row(1, 40, (20, 20), (0, 0)))) == by_votes(1.0, 0)


@dataclass(frozen=True)
class ByWindow(Threshold):
    """Answers from the current's half difference, and knows only windows below two amperes."""

    needs: str = "V5 way"
    window_classes: tuple[str, ...] = ("normal", "friction_emergency")

    def classify_windows(self, features: Array) -> tuple[Array, NDArray[np.bool_]]:
        seen = features[:, WINDOW_KEYS.index(self.needs)]
        p = np.clip(seen, 0.0, 1.0)
        return np.column_stack([1 - p, p]), seen < 2.0


def slots(current: float, load: float = 0.5, moving: int = 20) -> Array:
    """The sums of one window's only slot: a current with the motion, forward and backward in turn."""
    way = np.resize([1.0, -1.0], moving)
    moments = np.zeros((moving, len(MOMENTS)))
    moments[:, MOMENTS.index("1")] = 1.0
    for name, factor in {"way": 1.0, "V5": current, "V7": 1.0, "V11": load}.items():
        moments[:, MOMENTS.index(name)] = factor * way
    others = np.zeros(SUMS - products(moments).shape[1])
    others[[0, 6]] = 100, 100 if np.isfinite(load) else 0
    return np.concatenate([products(moments).sum(axis=0), others])[None, None]


@dataclass(frozen=True)
class Ranks(Threshold):
    """Gives every window the same probabilities."""

    window_classes: tuple[str, ...] = ("normal", "friction_degraded", "friction_emergency", "backlash", "jam")
    probabilities: tuple[float, ...] = ()

    def classify_windows(self, features: Array) -> tuple[Array, NDArray[np.bool_]]:
        return np.tile(self.probabilities, (len(features), 1)), np.ones(len(features), dtype=np.bool_)


@pytest.mark.parametrize(
    ("probabilities", "said", "severity", "leaning"),
    [
        ((0.9, 0.1, 0.0, 0.0, 0.0), "normal", 0, 0),
        ((0.1, 0.9, 0.0, 0.0, 0.0), "friction_degraded", 1, 1),
        ((0.0, 0.5, 0.5, 0.0, 0.0), "abstained", 1, 2),  # surely no less than degraded
        ((0.0, 0.2, 0.0, 0.8, 0.0), "backlash", 1, 1),
        ((0.0, 0.2, 0.4, 0.0, 0.4), "abstained", 2, 2),
        ((0.5, 0.5, 0.0, 0.0, 0.0), "abstained", -1, 1),
        ((0.6, 0.2, 0.2, 0.0, 0.0), "abstained", -1, 0),
    ],
)
def test_a_window_is_as_grave_as_its_probabilities_make_sure(
    probabilities: tuple[float, ...], said: str, severity: int, leaning: int
) -> None:
    (found,) = window_outcomes(
        [Ranks(probabilities=probabilities)], window(row(0, 40, (20, 20), (0, 0)))[None], slots(0.25)
    )
    shown = present(found)
    assert (shown.said, shown.severity, shown.leaning) == (said, severity, leaning)
    assert (shown.p_fault, shown.probability) == pytest.approx((1 - probabilities[0], max(probabilities)))


def test_a_network_of_windows_abstains_outside_its_range_and_where_nothing_moves() -> None:
    ballots = window(row(0, 40, (20, 20), (20, 20)))[None]
    assert window_outcomes([ByWindow()], ballots, slots(3.0)) == [
        VoteOutcome(0, "outside", "friction_emergency", -1, 2, 1.0, 1.0)
    ]
    assert window_outcomes([ByWindow()], ballots, slots(0.25, moving=18)) == [None]


def test_a_network_of_windows_that_lacks_a_quantity_leaves_it_to_votes_and_to_other_networks() -> None:
    ballots = window(row(0, 40, (20, 20), (10, 10)))[None]
    without_load = slots(0.25, load=np.nan)
    loaded = ByWindow(needs="V11 rms")
    assert window_outcomes([loaded], ballots, without_load) == [by_votes(0.5, 0)]
    assert window_outcomes([loaded, ByWindow()], ballots, without_load) == [by_votes(0.5, 0)]
    silent = window(row(-1, 40, (0, 0), (0, 0)))[None]
    assert window_outcomes([loaded, ByWindow()], silent, without_load) == [
        VoteOutcome(1, "normal", "normal", 0, 0, 0.75, 0.25)
    ]
    assert window_outcomes([Threshold(), ByWindow()], ballots, without_load) == [by_votes(0.5, 0)]


def test_samples_of_an_unknown_sign_leave_the_others_no_vote() -> None:
    """They called 268 of 6,341 windows of ESC_TELEMETRY normal that were degraded."""
    ballots = window(row(0, 40, (20, 20), (0, 0)))[None]
    assert window_outcomes([ByWindow()], ballots, slots(np.nan)) == [None]
