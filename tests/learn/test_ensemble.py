import sys
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.datasets import make_moons

from mavhums.core.errors import MissingExtraError
from mavhums.learn import TanhNetworkEnsemble

MOONS, SIDE = make_moons(300, noise=0.2, random_state=0)


def fitted(features: NDArray[np.float64] = MOONS, **parameters: Any) -> TanhNetworkEnsemble:
    return TanhNetworkEnsemble(**{"n_networks": 6, "max_iter": 80, "random_state": 0} | parameters).fit(
        features, SIDE
    )


def one(features: NDArray[np.float64] = MOONS, **parameters: Any) -> TanhNetworkEnsemble:
    return fitted(features, **{"n_networks": 1, "hidden": (8,), "max_iter": 200} | parameters)


def test_the_ensemble_is_the_mean_of_its_networks_and_says_how_far_they_differ() -> None:
    ensemble = fitted()
    second = np.stack([network.p_first(MOONS) for network in ensemble.networks_])
    np.testing.assert_allclose(ensemble.predict_proba(MOONS)[:, 1], second.mean(axis=0))
    np.testing.assert_allclose(ensemble.spread(MOONS), second.std(axis=0))
    np.testing.assert_allclose(ensemble.member_scores(MOONS, SIDE), ((second > 0.5) == SIDE).mean(axis=1))
    assert ensemble.score(MOONS, SIDE) > 0.9
    assert ensemble.best_ == np.argmin(ensemble.losses_)
    chosen = np.where(SIDE == 1, second, 1 - second)
    np.testing.assert_allclose(ensemble.losses_, -np.log(chosen).mean(axis=1))


def test_hidden_neurons_are_gone_through_in_turn() -> None:
    ensemble = fitted(n_networks=5, hidden=(4, 16), max_iter=2)
    assert [len(network.b1) for network in ensemble.networks_] == [4, 16, 4, 16, 4]


def test_validation_samples_choose_the_best_and_are_not_trained_on() -> None:
    held_out = np.arange(0, 300, 4)
    kept = np.setdiff1d(np.arange(300), held_out)
    ensemble = TanhNetworkEnsemble(n_networks=6, max_iter=80, random_state=0)
    ensemble.fit(MOONS[kept], SIDE[kept], validation=(MOONS[held_out], SIDE[held_out]))
    assert ensemble.best_ == np.argmin(ensemble.validation_losses_)
    scores = ensemble.member_scores(MOONS[held_out], SIDE[held_out])
    np.testing.assert_allclose(scores, ensemble.validation_accuracies_)


def test_samples_without_weight_are_as_if_absent() -> None:
    weight = np.arange(300) % 3 > 0
    outlier = np.where(weight[:, None], MOONS, 100.0)
    weighted = TanhNetworkEnsemble(3, random_state=0, max_iter=30).fit(outlier, SIDE, weight.astype(float))
    absent = TanhNetworkEnsemble(3, random_state=0, max_iter=30).fit(MOONS[weight], SIDE[weight])
    np.testing.assert_allclose(weighted.predict_proba(MOONS), absent.predict_proba(MOONS), atol=1e-6)


@pytest.mark.slow
def test_units_do_not_matter() -> None:
    scaled = MOONS * [1024, 2**-10]
    np.testing.assert_array_equal(one(scaled).predict_proba(scaled), one().predict_proba(MOONS))


def test_weight_decay_keeps_the_weights_small_and_training_ends_when_it_has_converged() -> None:
    small, large = one(weight_decay=0.1, max_iter=5000), one(weight_decay=1e-4, max_iter=60)
    assert np.square(small.networks_[0].w1).sum() < np.square(large.networks_[0].w1).sum() / 10
    assert small.n_iter_ < 1000
    assert large.n_iter_ == 60


@pytest.mark.parametrize(
    ("target", "message"),
    [([0, 1, 2, 0], "Only binary classification is supported"), ([1, 1, 1, 1], "one class")],
)
def test_needs_two_classes(target: list[int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TanhNetworkEnsemble().fit(MOONS[:4], target)


def test_without_torch_it_still_predicts_but_says_how_to_train(monkeypatch: pytest.MonkeyPatch) -> None:
    classifier = one()
    expected = classifier.predict(MOONS)
    monkeypatch.setitem(sys.modules, "torch", None)
    np.testing.assert_array_equal(classifier.predict(MOONS), expected)
    with pytest.raises(MissingExtraError, match=r"pip install 'mavhums\[train\]'"):
        clone(classifier).fit(MOONS, SIDE)
