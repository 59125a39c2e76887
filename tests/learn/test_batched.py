import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.special import softmax
from sklearn.datasets import make_moons

from mavhums.learn import TanhNetwork
from mavhums.learn.batched import BatchLoss, Data, NetworkBatch, Trained, lbfgs, train_batch

MOONS, SIDE = make_moons(300, noise=0.2, random_state=0)
SIDE = SIDE == 1
BATCH = NetworkBatch([3, 7, 5], np.array([[1, 1], [1, 0], [1, 1]], dtype=bool), [4, 5, 6])


THREE = np.eye(3, dtype=bool)[np.where(MOONS[:, 1] < 0, 2, 1 - SIDE)]
"""Three classes; the first of two is the emergency."""
TARGETS = pytest.mark.parametrize("target", [SIDE, THREE], ids=["two classes", "three"])


def problem(
    weight_decay: float = 1e-2, dtype: torch.dtype = torch.float64, target: NDArray[np.bool_] = SIDE
) -> BatchLoss:
    scaled = (MOONS - MOONS.min(axis=0)) / np.ptp(MOONS, axis=0)
    weight = np.random.default_rng(0).uniform(1, 2, len(SIDE))
    return BatchLoss(BATCH, Data.of(scaled, target, weight, dtype=dtype), weight_decay)


def networks(of: BatchLoss, weights: torch.Tensor) -> list[TanhNetwork]:
    return of.networks(weights, MOONS.min(axis=0), MOONS.max(axis=0))


@pytest.mark.slow
@TARGETS
def test_the_gradient_is_that_of_the_loss(target: NDArray[np.bool_]) -> None:
    of = problem(target=target)
    weights, every = of.initial(), torch.arange(3)
    loss, gradient = of.evaluate(weights, every)
    numeric = torch.zeros_like(gradient)
    for place in range(weights.shape[1]):
        step = torch.zeros_like(weights)
        step[:, place] = 1e-6
        high, low = of.evaluate(weights + step, every)[0], of.evaluate(weights - step, every)[0]
        numeric[:, place] = (high - low) / 2e-6
    assert loss.shape == (3,)
    torch.testing.assert_close(gradient, numeric * of.mask, rtol=1e-5, atol=1e-8)


@TARGETS
def test_the_loss_is_cross_entropy_plus_the_decay_of_the_network_in_numpy(target: NDArray[np.bool_]) -> None:
    of = problem(target=target)
    truth = target if target.ndim == 2 else np.column_stack([target, ~target])
    weights = of.initial()
    loss, _ = of.evaluate(weights, torch.arange(3))
    share = of.data.weight.numpy()
    for network, found in zip(networks(of, weights), loss.tolist(), strict=True):
        p = softmax(network.outputs(MOONS), axis=1)[truth]
        decay = np.square(network.w1).sum() + np.square(network.w2).sum()
        assert found == pytest.approx(-np.log(p) @ share + 1e-2 / 2 * decay)


def test_outputs_are_those_of_the_network_in_numpy_whatever_the_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("mavhums.learn.batched._BLOCK", 3 * 7 * 64)
    of = problem()
    weights = of.initial()
    expected = [network.outputs(MOONS) @ [1, -1] for network in networks(of, weights)]
    np.testing.assert_allclose(of.logits(weights, of.data)[:, 0], expected, atol=1e-12)


def test_a_feature_that_is_masked_out_has_no_say() -> None:
    of = problem()
    blind = networks(of, lbfgs(of, max_iter=30).weights)[1]
    np.testing.assert_array_equal(blind.w1[1], 0)
    assert np.abs(blind.w1[0]).min() > 0
    assert [len(network.b1) for network in networks(of, of.initial())] == [3, 7, 5]


@pytest.mark.slow
@TARGETS
def test_lbfgs_reaches_what_torch_reaches(target: NDArray[np.bool_]) -> None:
    of = problem(target=target)
    found = lbfgs(of, max_iter=2000, tolerance=1e-8).weights
    loss, gradient = of.evaluate(found, torch.arange(3))
    assert gradient.abs().max() < 1e-4
    for row in range(3):
        free = found[row].clone().requires_grad_()
        optimiser = torch.optim.LBFGS([free], max_iter=200, line_search_fn="strong_wolfe")

        def closure(row: int = row, free: torch.Tensor = free) -> torch.Tensor:
            value, free.grad = (part[0] for part in of.evaluate(free.detach()[None], torch.tensor([row])))
            return value

        optimiser.step(closure)  # type: ignore[no-untyped-call]
        assert loss[row] == pytest.approx(float(closure()), abs=1e-6)


def trained(**options: object) -> Trained:
    return train_batch(BATCH, (MOONS, SIDE), **{"max_iter": 60, "precision": "double"} | options)  # type: ignore[arg-type]


def flat(found: Trained) -> NDArray[np.float64]:
    return np.concatenate([tensor.ravel() for net in found.networks for tensor in net.tensors.values()])


def test_neither_threads_nor_neighbours_change_a_network() -> None:
    together = trained(max_iter=20)
    np.testing.assert_array_equal(flat(together), flat(trained(max_iter=20, n_jobs=2)))
    alone = train_batch(BATCH.part([2]), (MOONS, SIDE), max_iter=20, precision="double")
    np.testing.assert_allclose(alone.networks[0].w1, together.networks[2].w1, rtol=1e-6)


@pytest.mark.slow
def test_single_precision_follows_the_same_loss() -> None:
    """At the same weights: where a training run ends up depends on the processor's rounding."""
    double, single = problem(), problem(dtype=torch.float32)
    weights, every = double.initial(), torch.arange(3)
    loss, gradient = double.evaluate(weights, every)
    rounded = single.evaluate(weights.float(), every)
    torch.testing.assert_close(rounded[0].double(), loss, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(rounded[1].double(), gradient, rtol=1e-3, atol=1e-5)


def test_early_stopping_keeps_the_weights_best_on_validation() -> None:
    random = np.random.default_rng(3)
    noise, sides = random.uniform(size=(60, 2)), random.integers(0, 2, 60) == 1
    held_out = random.uniform(size=(60, 2)), random.integers(0, 2, 60) == 1
    batch = NetworkBatch([12, 12], np.ones((2, 2), dtype=bool), [0, 1])

    def run(count: int, patience: int | None) -> Trained:
        options = {"validation": held_out, "weight_decay": 0.0, "precision": "double"}
        return train_batch(batch, (noise, sides), patience=patience, max_iter=count, **options)  # type: ignore[arg-type]

    stopped, to_the_end = run(300, 20), run(300, None)
    last = int(stopped.iterations.max())
    looked_at = np.array([run(count, None).validation_loss for count in range(10, last + 1, 10)])
    np.testing.assert_array_equal(stopped.iterations, 10 * (1 + looked_at.argmin(axis=0)) + 20)
    np.testing.assert_allclose(stopped.validation_loss, looked_at.min(axis=0), rtol=1e-6)
    assert (stopped.validation_loss < to_the_end.validation_loss).all()
    assert (to_the_end.loss < stopped.loss).all()
    p = stopped.networks[0].p_first(held_out[0])
    assert stopped.validation_accuracy[0] == pytest.approx(((p > 0.5) == held_out[1]).mean())
