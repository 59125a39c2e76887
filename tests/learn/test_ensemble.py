from typing import Any

import numpy as np
import pytest
from sklearn.datasets import make_moons

from mavhums.learn import TanhNetworkEnsemble

MOONS, SIDE = make_moons(300, noise=0.2, random_state=0)


def fitted(**parameters: Any) -> TanhNetworkEnsemble:
    return TanhNetworkEnsemble(**{"n_networks": 6, "max_iter": 80, "random_state": 0} | parameters).fit(
        MOONS, SIDE
    )


def test_the_ensemble_is_the_mean_of_its_networks_and_says_how_far_they_differ() -> None:
    ensemble = fitted()
    second = np.stack([network.p_first(MOONS) for network in ensemble.networks_])
    np.testing.assert_allclose(ensemble.predict_proba(MOONS)[:, 1], second.mean(axis=0))
    np.testing.assert_allclose(ensemble.spread(MOONS), second.std(axis=0))
    np.testing.assert_allclose(ensemble.member_scores(MOONS, SIDE), ((second > 0.5) == SIDE).mean(axis=1))
    assert ensemble.score(MOONS, SIDE) > 0.9
    assert ensemble.best_ == np.argmin(ensemble.losses_)


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


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("n_networks", 0), ("max_iter", 1.5), ("patience", 0), ("hidden", ()), ("hidden", (4, 0)),
        ("weight_decay", -1), ("weight_decay", float("nan")), ("weight_decay", "some"), ("precision", "half"),
    ],
)  # fmt: skip
def test_refuses_parameters_that_mean_nothing(parameter: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"^{parameter} must"):
        fitted(**{parameter: value})
