import random

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.datasets import make_moons

from mavhums.learn import NetworkSubsetSelector, exhaustive_search, genetic_search, network_objective
from mavhums.learn.subsets import Objective, all_subsets

WORTH = np.random.default_rng(1).normal(size=10)


def rugged(subsets: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Worth of features, less what pairs of neighbours repeat."""
    return np.asarray(subsets @ WORTH - 0.8 * (subsets[:, 1:] & subsets[:, :-1]).sum(axis=1))


def test_enumeration_finds_the_optimum() -> None:
    search = exhaustive_search(rugged, 10)
    assert len(np.unique(search.subsets, axis=0)) == len(search.scores) == 1023
    assert search.subsets.any(axis=1).all()
    assert rugged(search.best[None])[0] == search.score == rugged(all_subsets(10)).max()


def test_among_equals_the_smallest_subset_wins() -> None:
    search = exhaustive_search(lambda subsets: subsets[:, 2].astype(float), 4)
    assert search.best.tolist() == [False, False, True, False]


@pytest.mark.parametrize("seed", range(5))
def test_the_genetic_search_comes_close_with_a_tenth_of_the_evaluations(seed: int) -> None:
    calls: list[NDArray[np.bool_]] = []

    def counted(subsets: NDArray[np.bool_]) -> NDArray[np.float64]:
        calls.append(subsets)
        return rugged(subsets)

    found = genetic_search(counted, 10, evaluations=102, population=20, random_state=seed)
    asked = np.concatenate(calls)
    assert len(asked) == len(np.unique(asked, axis=0)) == len(found.scores) <= 102
    assert asked.any(axis=1).all()
    values = np.sort(rugged(all_subsets(10)))
    assert found.score >= values[-10]
    np.testing.assert_allclose(rugged(found.subsets), found.scores)


def test_the_genetic_search_repeats_and_leaves_the_global_generators_alone() -> None:
    random.seed(3)
    np.random.seed(3)  # noqa: NPY002
    expected = (random.random(), np.random.rand())  # noqa: NPY002
    random.seed(3)
    np.random.seed(3)  # noqa: NPY002
    first = genetic_search(rugged, 10, evaluations=60, random_state=1)
    assert (random.random(), np.random.rand()) == expected  # noqa: NPY002
    again = genetic_search(rugged, 10, evaluations=60, random_state=1)
    np.testing.assert_array_equal(first.subsets, again.subsets)


MOONS, SIDE = make_moons(400, noise=0.15, random_state=0)
FEATURES = np.column_stack([np.random.default_rng(0).normal(size=(400, 2)), MOONS])


@pytest.mark.parametrize("search", ["exhaustive", "genetic"])
def test_the_selector_drops_what_only_makes_noise(search: str) -> None:
    selector = NetworkSubsetSelector(search, evaluations=12, random_state=0).fit(FEATURES, SIDE)  # type: ignore[arg-type]
    assert selector.get_support()[2:].all()
    assert selector.search_.score > 0.9
    assert len(selector.search_.scores) == (15 if search == "exhaustive" else 12)


def test_the_selector_scores_on_whole_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    flights = np.repeat(np.arange(8), 50)
    side = flights % 2 == 1
    values = np.column_stack([flights, np.random.default_rng(0).normal(size=400)]).astype(float)
    seen = {}

    def spy(*parts: tuple[NDArray[np.float64], NDArray[np.bool_]], **_: object) -> Objective:
        seen["training"], seen["validation"] = (set(part[0][:, 0]) for part in parts)
        return lambda subsets: subsets.sum(axis=1).astype(float)

    monkeypatch.setattr("mavhums.learn.subsets.network_objective", spy)
    NetworkSubsetSelector(random_state=0).fit(values, side, groups=flights)
    assert not seen["training"] & seen["validation"]
    assert {flight % 2 for flight in seen["validation"]} == {0, 1}


def test_the_objective_is_the_validation_accuracy_of_the_subset_alone() -> None:
    samples, validation = (FEATURES[:200], SIDE[:200] == 1), (FEATURES[200:], SIDE[200:] == 1)
    objective = network_objective(samples, validation, hidden=6, max_iter=60)
    noise, moons = objective(np.array([[1, 1, 0, 0], [0, 0, 1, 1]], dtype=bool))
    assert noise < 0.65
    assert moons > 0.9
    changed = (FEATURES * [5, -3, 1, 1], validation[1])
    same = network_objective(samples, (changed[0][200:], changed[1]), hidden=6, max_iter=60)
    assert same(np.array([[0, 0, 1, 1]], dtype=bool))[0] == moons


def test_refuses_what_means_nothing() -> None:
    with pytest.raises(ValueError, match=r"^search must"):
        NetworkSubsetSelector("greedy").fit(FEATURES, SIDE)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^evaluations must"):
        NetworkSubsetSelector(evaluations=0).fit(FEATURES, SIDE)
    with pytest.raises(ValueError, match="one class"):
        NetworkSubsetSelector().fit(FEATURES, np.ones(400))
    with pytest.raises(ValueError, match="Only binary"):
        NetworkSubsetSelector().fit(FEATURES, np.arange(400) % 3)
