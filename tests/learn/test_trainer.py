import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.special import softmax
from sklearn.datasets import make_moons
from sklearn.neural_network import MLPClassifier
from sklearn.preprocessing import MinMaxScaler

from mavhums.learn.trainer import NetworkOptions, Trained, Vectors, train_networks

MOONS, SIDE = make_moons(300, noise=0.2, random_state=0)
SIDE = SIDE == 1
WEIGHT = np.random.default_rng(0).uniform(1, 2, len(SIDE))
THREE = np.eye(3, dtype=bool)[np.where(MOONS[:, 1] < 0, 2, 1 - SIDE)]
"""Three classes; the first of two is the emergency."""
FEW, SIXTY = (NetworkOptions(max_iter=count) for count in (20, 60))
TARGETS = pytest.mark.parametrize("target", [SIDE, THREE], ids=["two classes", "three"])


def trained(
    target: NDArray[np.bool_] = SIDE,
    validation: Vectors | None = None,
    *,
    weight: NDArray[np.float64] | None = None,
    subsets: NDArray[np.bool_] | None = None,
    options: NetworkOptions = SIXTY,
) -> Trained:
    vectors = Vectors(MOONS, target, weight)
    return train_networks([3, 7, 5], [4, 5, 6], vectors, validation, subsets=subsets, options=options)


def flat(found: Trained) -> NDArray[np.float64]:
    return np.concatenate([tensor.ravel() for net in found.networks for tensor in net.tensors.values()])


@TARGETS
def test_the_loss_is_the_cross_entropy_of_the_network_in_numpy(target: NDArray[np.bool_]) -> None:
    truth = target if target.ndim == 2 else np.column_stack([target, ~target])
    found = trained(target, Vectors(MOONS[:50], target[:50]), weight=WEIGHT)
    assert [len(network.b1) for network in found.networks] == [3, 7, 5]
    for k, network in enumerate(found.networks):
        p = softmax(network.outputs(MOONS), axis=1)
        assert found.loss[k] == pytest.approx(-np.log(p[truth]) @ WEIGHT / WEIGHT.sum())
        assert found.validation_loss[k] == pytest.approx(-np.log(p[:50][truth[:50]]).mean())
        assert found.validation_accuracy[k] == (p[:50].argmax(axis=1) == truth[:50].argmax(axis=1)).mean()


def test_a_sample_that_lacks_an_input_counts_as_a_guess() -> None:
    held_out = np.where(np.arange(len(MOONS))[:, None] % 2 == 1, np.nan, MOONS)
    found, whole = (trained(THREE, Vectors(x, y)) for x, y in ((held_out, THREE), (MOONS[::2], THREE[::2])))
    np.testing.assert_allclose(found.validation_loss, (whole.validation_loss + np.log(3)) / 2)
    np.testing.assert_allclose(found.validation_accuracy, whole.validation_accuracy / 2)


def test_converges_to_what_scikit_learn_reaches() -> None:
    """Three classes: scikit-learn has a softmax for them alone."""
    decay, seeds = 1e-2, range(4)
    found = train_networks([7] * 4, seeds, Vectors(MOONS, THREE), options=NetworkOptions(decay, 2000))
    assert found.iterations.max() < 2000
    ours = [
        loss + decay / 2 * (np.square(network.w1).sum() + np.square(network.w2).sum())
        for loss, network in zip(found.loss, found.networks, strict=True)
    ]
    scaled, alpha = MinMaxScaler().fit_transform(MOONS), decay * len(MOONS)
    theirs = [
        MLPClassifier((7,), activation="tanh", solver="lbfgs", alpha=alpha, max_iter=2000, random_state=seed)
        .fit(scaled, THREE.argmax(axis=1))
        .loss_
        for seed in seeds
    ]
    assert min(ours) == pytest.approx(min(theirs), abs=1e-4)


def test_a_feature_outside_the_subset_has_no_say() -> None:
    subsets = np.array([[1, 1], [1, 0], [0, 1]], dtype=bool)
    found = trained(subsets=subsets)
    for network, subset in zip(found.networks, subsets, strict=True):
        np.testing.assert_array_equal(network.w1.any(axis=1), subset)
    alone = train_networks([7], [5], Vectors(MOONS[:, :1], SIDE), options=NetworkOptions(max_iter=60))
    np.testing.assert_array_equal(alone.networks[0].outputs(MOONS[:, :1]), found.networks[1].outputs(MOONS))


def test_the_same_seed_gives_the_same_network_whatever_the_threads_and_torch() -> None:
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        torch.manual_seed(1)
        first = trained(options=FEW)
        torch.manual_seed(2)
        state = torch.get_rng_state()
        np.testing.assert_array_equal(
            flat(trained(options=NetworkOptions(max_iter=20, n_jobs=2))), flat(first)
        )
        assert torch.equal(torch.get_rng_state(), state)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    other = train_networks([3, 7, 5], [4, 5, 7], Vectors(MOONS, SIDE), options=FEW)
    np.testing.assert_array_equal(other.networks[1].w1, first.networks[1].w1)
    assert not np.allclose(other.networks[2].w1, first.networks[2].w1)


def test_weights_count_as_repetitions() -> None:
    weight = np.arange(len(SIDE)) % 3
    rows = np.repeat(np.arange(len(SIDE)), weight)
    repeated = train_networks([3, 7, 5], [4, 5, 6], Vectors(MOONS[rows], SIDE[rows]), options=FEW)
    weighted = trained(options=FEW, weight=weight.astype(float))
    np.testing.assert_allclose(weighted.loss, repeated.loss)
    np.testing.assert_allclose(flat(weighted), flat(repeated), rtol=1e-4)


def test_early_stopping_keeps_the_weights_best_on_validation() -> None:
    random = np.random.default_rng(3)
    noise, sides = random.uniform(size=(60, 2)), random.integers(0, 2, 60) == 1
    held_out = Vectors(random.uniform(size=(60, 2)), random.integers(0, 2, 60) == 1)

    def run(count: int, patience: int | None) -> Trained:
        options = NetworkOptions(weight_decay=0.0, max_iter=count, patience=patience)
        return train_networks([12, 12], [0, 1], Vectors(noise, sides), held_out, options=options)

    stopped, to_the_end = run(300, 20), run(300, None)
    last = int(stopped.iterations.max())
    looked_at = np.array([run(count, None).validation_loss for count in range(10, last + 1, 10)])
    np.testing.assert_array_equal(stopped.iterations, 10 * (1 + looked_at.argmin(axis=0)) + 20)
    np.testing.assert_allclose(stopped.validation_loss, looked_at.min(axis=0), rtol=1e-6)
    assert (stopped.validation_loss < to_the_end.validation_loss).all()
    assert (to_the_end.loss < stopped.loss).all()
