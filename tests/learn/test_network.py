import sys
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.datasets import make_moons

from mavhums.core.errors import MissingExtraError
from mavhums.learn import TanhNetworkEnsemble
from mavhums.learn.batched import BatchLoss

MOONS, SIDE = make_moons(400, noise=0.2, random_state=0)


def fitted(**parameters: Any) -> TanhNetworkEnsemble:
    given: dict[str, Any] = {"n_networks": 1, "hidden": (8,), "random_state": 0} | parameters
    return TanhNetworkEnsemble(**given).fit(MOONS, SIDE)


def weights(classifier: TanhNetworkEnsemble) -> NDArray[np.float64]:
    return np.concatenate([tensor.ravel() for tensor in classifier.networks_[0].tensors.values()])


def test_learns_what_no_line_separates() -> None:
    corners = np.random.default_rng(0).uniform(-1, 1, (400, 2))
    emergency = corners[:, 0] * corners[:, 1] > 0
    classifier = TanhNetworkEnsemble(1, (6,), random_state=1).fit(corners, emergency)
    assert classifier.score(corners, emergency) > 0.97
    assert classifier.classes_.tolist() == [False, True]


def test_loss_is_the_cross_entropy_of_the_samples() -> None:
    classifier = fitted()
    chosen = classifier.predict_proba(MOONS)[np.arange(400), SIDE]
    assert classifier.losses_[0] == pytest.approx(-np.log(chosen).mean())


@pytest.mark.slow
def test_units_do_not_matter() -> None:
    probability = fitted().predict_proba(MOONS)
    scaled = MOONS * [1024, 2**-10]
    other = TanhNetworkEnsemble(1, (8,), random_state=0).fit(scaled, SIDE)
    np.testing.assert_array_equal(other.predict_proba(scaled), probability)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_network_whatever_the_state_of_torch() -> None:
    torch.manual_seed(1)
    first = fitted()
    torch.manual_seed(2)
    state = torch.get_rng_state()
    second = fitted()
    np.testing.assert_array_equal(weights(first), weights(second))
    assert torch.equal(torch.get_rng_state(), state)
    assert not np.array_equal(weights(first), weights(fitted(random_state=1)))


def test_trains_on_one_thread_and_restores_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    threads, used = torch.get_num_threads(), set()
    evaluate = BatchLoss.evaluate

    def spy(*given: Any) -> Any:
        used.add(torch.get_num_threads())
        return evaluate(*given)

    monkeypatch.setattr(BatchLoss, "evaluate", spy)
    torch.set_num_threads(2)
    try:
        fitted(max_iter=2)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert used == {1}


def test_weight_decay_keeps_the_weights_small() -> None:
    [small], [large] = (fitted(weight_decay=decay).networks_ for decay in (0.1, 1e-4))
    assert np.square(small.w1).sum() < np.square(large.w1).sum() / 10


def test_more_iterations_bring_the_loss_down_and_are_counted() -> None:
    brief, long = fitted(max_iter=15), fitted(max_iter=60)
    assert (*brief.n_iter_, *long.n_iter_) == (15, 60)
    assert long.losses_ < brief.losses_


def test_training_ends_when_it_has_converged() -> None:
    assert fitted(hidden=(1,), weight_decay=0.1, max_iter=5000).n_iter_ < 1000


@pytest.mark.parametrize(
    ("target", "message"),
    [([0, 1, 2, 0], "Only binary classification is supported"), ([1, 1, 1, 1], "one class")],
)
def test_needs_two_classes(target: list[int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TanhNetworkEnsemble().fit(MOONS[:4], target)


def test_without_torch_it_still_predicts_but_says_how_to_train(monkeypatch: pytest.MonkeyPatch) -> None:
    classifier = fitted()
    expected = classifier.predict(MOONS)
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "mavhums.learn.batched")
    np.testing.assert_array_equal(classifier.predict(MOONS), expected)
    with pytest.raises(MissingExtraError, match=r"pip install 'mavhums\[train\]'"):
        clone(classifier).fit(MOONS, SIDE)
