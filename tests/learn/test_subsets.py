import random
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.datasets import make_moons

from mavhums.learn import Vectors, exhaustive_search, genetic_search, network_objective
from mavhums.learn.wrapper import all_subsets

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


def test_the_search_drops_what_only_makes_noise() -> None:
    parts = [Vectors(FEATURES[rows], SIDE[rows] == 1) for rows in (slice(0, 300), slice(300, 400))]
    objective = network_objective(parts[0], parts[1])
    for search in (exhaustive_search(objective, 4), genetic_search(objective, 4, evaluations=12)):
        assert search.best[2:].all()
        assert search.score > 0.9


def test_the_objective_is_the_validation_accuracy_of_the_subset_alone() -> None:
    vectors = Vectors(FEATURES, SIDE == 1)
    samples, validation = vectors.part(np.arange(200)), vectors.part(np.arange(200, 400))
    objective = network_objective(samples, validation, hidden=6)
    noise, moons = objective(np.array([[1, 1, 0, 0], [0, 0, 1, 1]], dtype=bool))
    assert noise < 0.65
    assert moons > 0.9
    changed = replace(validation, features=validation.features * [5, -3, 1, 1])
    same = network_objective(samples, changed, hidden=6)
    assert same(np.array([[0, 0, 1, 1]], dtype=bool))[0] == moons
