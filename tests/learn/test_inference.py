from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from mavhums.core.quantities import column
from mavhums.learn import Network, TanhNetwork

Values = NDArray[np.float64]


def test_agrees_with_torch(network: Network, values: Values) -> None:
    features = values[:, [column(key) for key in network.keys]]
    scaled = torch.tensor((features - network.minimum) / (network.maximum - network.minimum))
    w1, b1, w2, b2 = (torch.tensor(network.tensors[name]) for name in ("w1", "b1", "w2", "b2"))
    expected = torch.softmax(torch.tanh(scaled @ w1 + b1) @ w2 + b2, dim=1)[:, 0].numpy()
    np.testing.assert_allclose(network.p_emergency(values), expected, rtol=0, atol=1e-12)


def test_each_sample_is_judged_by_itself(network: Network, values: Values) -> None:
    together = network.p_emergency(values)
    alone = [network.p_emergency(sample[np.newaxis])[0] for sample in values]
    np.testing.assert_allclose(together, alone, rtol=1e-12)
    assert network.p_emergency(values[:0]).shape == (0,)
    assert network.inside(values[:0]).shape == (0,)


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_a_needed_quantity_that_is_missing_is_not_judged(
    network: Network, values: Values, missing: float
) -> None:
    expected = network.p_emergency(values)
    values[3, column("V5")] = missing
    probability, inside = network.p_emergency(values), network.inside(values)
    assert np.isnan(probability[3])
    assert not inside[3]
    np.testing.assert_array_equal(np.delete(probability, 3), np.delete(expected, 3))
    assert np.delete(inside, 3).all()


@pytest.mark.parametrize(
    ("v5", "inside"), [(1.0, True), (1.19, True), (-1.19, True), (1.21, False), (-1.21, False)]
)
def test_envelope_is_the_trained_range_widened(
    network: Network, values: Values, v5: float, inside: bool
) -> None:
    values[:, column("V5")] = v5
    assert network.inside(values).tolist() == [inside] * 50


def test_a_quantity_constant_in_training_must_be_that_constant(network: Network, values: Values) -> None:
    constant = replace(network, minimum=np.array([-100, 27, 0]), maximum=np.array([300, 27, 5]))
    values[:, column("V5")] = [27.0] * 25 + [27.05] * 25
    assert constant.inside(values).tolist() == [True] * 25 + [False] * 25
    assert np.isfinite(constant.p_emergency(values)).all()


@given(values=hnp.arrays(np.float64, (4, 12), elements=st.floats()), scale=st.sampled_from([1.0, 1e300]))
def test_any_floats_give_a_probability_or_nan(values: Values, scale: float) -> None:
    zero, one = np.zeros(2), np.ones(2)
    weights = {"w1": scale * np.eye(2), "b1": zero, "w2": scale * np.eye(2), "b2": zero}
    network = Network(keys=("V12", "V1"), minimum=-one, maximum=np.array([1.0, -1.0]), **weights)
    probability, inside = network.p_emergency(values), network.inside(values)
    judged = np.isfinite(values[:, [11, 0]]).all(axis=1)
    assert np.isnan(probability[~judged]).all()
    assert ((probability >= 0) & (probability <= 1))[inside].all()
    assert not inside[~judged].any()
    votes = [network.votes(sample[np.newaxis])[0] for sample in values]
    assert votes == np.where(inside, probability > 0.5, -1).tolist(), "each by itself"


def test_weights_are_copied_and_cannot_be_changed(network: Network) -> None:
    weights = np.zeros((3, 4))
    copy = replace(network, w1=weights)
    weights[0] = 1
    assert not copy.w1.any()
    with pytest.raises(ValueError, match="read-only"):
        copy.w1[0] = 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"w1": np.zeros((4, 3))}, "w1 has the shape"),
        ({"b1": 0.0}, "does not fit"),
        ({"minimum": 0.0}, "does not fit"),
        ({"maximum": np.zeros(2)}, "maximum has the shape"),
        ({"w2": np.zeros((4, 3))}, "w2 has the shape"),
        ({"b2": np.zeros(3)}, "b2 has the shape"),
        ({"b1": np.zeros(0), "w1": np.zeros((3, 0)), "w2": np.zeros((0, 2))}, "at least one"),
        ({"b2": [0, np.nan]}, "b2 contains a number that is not finite"),
        ({"w1": np.full((3, 4), np.inf)}, "w1 contains a number that is not finite"),
        ({"minimum": [400.0, -1, 0]}, "a minimum exceeds"),
        ({"keys": ("V2", "V5", "V13")}, "'V13' is none of V1"),
        ({"keys": ("V2", "V5", "V5")}, "each once"),
        ({"keys": ("V2", "V5")}, "2 keys do not name 3 inputs"),
    ],
)
def test_refuses_what_is_no_network(network: Network, change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(network, **change)


@pytest.mark.parametrize("shape", [(12,), (5, 3), (2, 12, 1)])
def test_refuses_values_that_are_not_twelve_columns(network: Network, shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="values must have the shape"):
        network.p_emergency(np.zeros(shape))
    with pytest.raises(ValueError, match="values must have the shape"):
        network.inside(np.zeros(shape))


def test_the_first_output_is_the_emergency() -> None:
    silent = {"minimum": np.zeros(1), "maximum": np.ones(1), "w1": np.ones((1, 1)), "b1": np.zeros(1)}
    network = TanhNetwork(**silent, w2=np.zeros((1, 2)), b2=np.array([2.0, 0.0]))
    assert network.p_first(np.array([[0.5]]))[0] == pytest.approx(1 / (1 + np.exp(-2)))
