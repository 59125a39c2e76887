from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import approx_fprime
from scipy.special import softmax
from sklearn.datasets import make_moons
from threadpoolctl import threadpool_info, threadpool_limits

from mavhums.learn import TanhNetwork, TanhNetworkEnsemble
from mavhums.learn.inference import unit_interval
from mavhums.learn.networks import Examples, NetworkLoss, Trained, train_networks

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


def test_the_same_seed_gives_the_same_network() -> None:
    first = fitted()
    np.testing.assert_array_equal(weights(first), weights(fitted()))
    assert not np.array_equal(weights(first), weights(fitted(random_state=1)))


def test_trains_on_one_thread_and_restores_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def threads() -> set[int]:
        return {each["num_threads"] for each in threadpool_info()}

    used = set[int]()
    call = NetworkLoss.__call__

    def spy(*given: Any) -> Any:
        used.update(threads())
        return call(*given)

    monkeypatch.setattr(NetworkLoss, "__call__", spy)
    with threadpool_limits(2):
        fitted(max_iter=2)
        assert threads() == {2}
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


SUBSETS = np.array([[1, 1], [1, 0], [1, 1]], dtype=bool)
THREE = np.eye(3, dtype=bool)[np.where(MOONS[:, 1] < 0, 2, 1 - SIDE)]
"""Three classes; the first of two is the emergency."""
TARGETS = pytest.mark.parametrize("target", [SIDE == 1, THREE], ids=["two classes", "three"])


def loss_of(target: NDArray[np.bool_]) -> NetworkLoss:
    scaled = (MOONS - MOONS.min(axis=0)) / np.ptp(MOONS, axis=0)
    weight = np.random.default_rng(0).uniform(1, 2, len(SIDE))
    return NetworkLoss(7, Examples.of(scaled, target, weight), 1e-2)


@TARGETS
def test_the_gradient_is_that_of_the_loss(target: NDArray[np.bool_]) -> None:
    loss = loss_of(target)
    weights = loss.initial(5)

    def value(at: NDArray[np.float64]) -> float:
        return loss(at)[0]

    numeric = approx_fprime(weights, value, 1e-7)
    np.testing.assert_allclose(loss(weights)[1], numeric, rtol=1e-4, atol=1e-6)


@TARGETS
def test_the_loss_is_cross_entropy_plus_the_decay_of_the_network(target: NDArray[np.bool_]) -> None:
    loss = loss_of(target)
    w, v = loss.split(loss.initial(5))
    limits = {"minimum": MOONS.min(axis=0), "maximum": MOONS.max(axis=0)}
    network = TanhNetwork(**limits, w1=w[:, :-1].T, b1=w[:, -1], w2=v[:, :-1].T, b2=v[:, -1])
    truth = target if target.ndim == 2 else np.column_stack([target, ~target])
    share = np.random.default_rng(0).uniform(1, 2, len(SIDE))
    entropy = -np.log(softmax(network.outputs(MOONS), axis=1)[truth]) @ share / share.sum()
    decay = np.square(network.w1).sum() + np.square(network.w2).sum()
    assert loss(loss.initial(5))[0] == pytest.approx(entropy + 1e-2 / 2 * decay)
    assert loss.scores(loss.initial(5), Examples.of(network_input(network), target))[1] == pytest.approx(
        (network.outputs(MOONS).argmax(axis=1) == truth.argmax(axis=1)).mean()
    )


def network_input(network: TanhNetwork) -> NDArray[np.float64]:
    return unit_interval(MOONS, network.minimum, network.maximum)


def trained(**options: Any) -> Trained:
    return train_networks([3, 7, 5], [4, 5, 6], (MOONS, SIDE == 1), SUBSETS, **{"max_iter": 60} | options)


def test_a_feature_that_a_network_does_not_see_has_no_say() -> None:
    blind = trained().networks[1]
    np.testing.assert_array_equal(blind.w1[1], 0)
    assert np.abs(blind.w1[0]).min() > 0
    assert [len(network.b1) for network in trained(max_iter=2).networks] == [3, 7, 5]


def test_neither_threads_nor_neighbours_change_a_network() -> None:
    together, parallel = trained(), trained(n_jobs=2)
    alone = train_networks([5], [6], (MOONS, SIDE == 1), max_iter=60)
    for others, k in ((parallel, 2), (alone, 0)):
        for name, tensor in together.networks[2].tensors.items():
            np.testing.assert_array_equal(others.networks[k].tensors[name], tensor)


def test_early_stopping_keeps_the_weights_best_on_validation() -> None:
    random = np.random.default_rng(3)
    noise, sides = random.uniform(size=(60, 2)), random.integers(0, 2, 60) == 1
    held_out = random.uniform(size=(60, 2)), random.integers(0, 2, 60) == 1

    def run(count: int, patience: int | None) -> Trained:
        options: dict[str, Any] = {"validation": held_out, "weight_decay": 0.0}
        return train_networks([12] * 2, [0, 1], (noise, sides), patience=patience, max_iter=count, **options)

    stopped, to_the_end = run(300, 20), run(300, None)
    last = int(stopped.iterations.max())
    looked_at = np.array([run(count, None).validation_loss for count in range(10, last + 1, 10)])
    np.testing.assert_array_equal(stopped.iterations, 10 * (1 + looked_at.argmin(axis=0)) + 20)
    np.testing.assert_allclose(stopped.validation_loss, looked_at.min(axis=0), rtol=1e-6)
    assert (stopped.validation_loss < to_the_end.validation_loss).all()
    assert (to_the_end.loss < stopped.loss).all()
    p = stopped.networks[0].p_first(held_out[0])
    assert stopped.validation_accuracy[0] == pytest.approx(((p > 0.5) == held_out[1]).mean())
