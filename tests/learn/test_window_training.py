"""The network of windows: trained by the paper's stages, calibrated, and sure only where it is right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mavhums.core.quantities import WINDOW_KEYS
from mavhums.learn import LabelledWindows, Scheme, TrainingOptions, WindowNetwork, train_windows
from mavhums.learn.evaluation import at_temperature, decides_at

KEYS = ("V5 way", "V4|V5", "V5 rms", "V7 rms")


def windows(seed: int, *, count: int = 600, overlap: float = 0.25) -> LabelledWindows:
    """Three classes: friction shifts one statistic, the winding another; the third repeats the first."""
    random = np.random.default_rng(seed)
    classes = random.integers(3, size=count)
    features = np.full((count, len(WINDOW_KEYS)), np.nan)
    friction = (classes == 1) + overlap * random.normal(size=count)
    winding = (classes == 2) + overlap * random.normal(size=count)
    for key, value in zip(KEYS, (friction, winding, 2 * friction, random.normal(size=count)), strict=True):
        features[:, WINDOW_KEYS.index(key)] = value
    return LabelledWindows(features, classes, np.arange(count) // 10)


@pytest.fixture(scope="module")
def network() -> WindowNetwork:
    pytest.importorskip("torch")
    result = train_windows(windows(1), 3, TrainingOptions(1, KEYS, Scheme(networks=5, vectors=300)))
    assert result.selection.thinned is not None
    assert result.selection.thinned.kept <= 303
    assert {each.quantity for each in result.selection.excluded} < {"V5 way", "V5 rms"}
    wrapped = result.selection.wrapped
    assert wrapped is not None
    assert wrapped.search == "elimination"
    assert wrapped.costs.keys() == {*result.inputs}
    assert min(wrapped.costs["V5 way"], wrapped.costs["V4|V5"]) > 0.1
    assert "V7 rms" not in result.inputs  # noise
    assert result.inputs == tuple(key for key in result.selection.selected if key in result.inputs)
    return WindowNetwork(keys=result.inputs, **result.network.tensors)


def test_the_stages_give_a_network_that_knows_other_flights(network: WindowNetwork) -> None:
    other = windows(2)
    found = network.probabilities(other.features)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert np.mean(found.argmax(axis=1) == other.classes) > 0.8


def test_the_temperature_makes_an_overconfident_network_honest(network: WindowNetwork) -> None:
    hot = replace(network, w2=8 * network.w2, b2=8 * network.b2)
    other, last = windows(3), windows(4, count=3000)
    cooled, temperature = at_temperature(hot, other.features, other.classes)
    assert temperature > 4
    found = cooled.probabilities(last.features)
    sure, right = found.max(axis=1), found.argmax(axis=1) == last.classes
    assert abs(sure.mean() - right.mean()) < 0.03
    assert (found.argmax(axis=1) == network.probabilities(last.features).argmax(axis=1)).all()


def test_it_decides_from_the_probability_that_keeps_the_goal(network: WindowNetwork) -> None:
    first, other = windows(3), windows(5, count=3000)
    fitted, _ = at_temperature(network, first.features, first.classes)
    levels = [decides_at(fitted, other.features, other.classes, goal) for goal in (0.5, 0.95, 0.99)]
    assert levels[0] == 0.5
    assert levels == sorted(levels)
    found = fitted.probabilities(other.features)
    decided = fitted.inside(other.features) & (found.max(axis=1) >= levels[1])
    assert np.mean((found.argmax(axis=1) == other.classes)[decided]) >= 0.95


def test_a_window_is_answered_alike_alone_and_among_others(network: WindowNetwork) -> None:
    features = windows(6).features
    together = network.probabilities(features)
    for k in range(0, 600, 7):
        np.testing.assert_array_equal(together[k], network.probabilities(features[k : k + 1])[0])


def test_wild_values_of_a_few_windows_hide_nothing_of_the_others() -> None:
    pytest.importorskip("torch")
    some = windows(1)
    for k, key in enumerate(KEYS):
        some.features[k::200, WINDOW_KEYS.index(key)] = 1000.0
    scheme = Scheme(networks=5, vectors=None, select="none")
    result = train_windows(some, 3, TrainingOptions(1, KEYS, scheme))
    found = WindowNetwork(keys=result.inputs, **result.network.tensors)
    others = windows(2)
    assert set(found.maximum.tolist()) == {1000.0}
    assert np.mean(found.probabilities(others.features).argmax(axis=1) == others.classes) > 0.9


def test_what_is_missing_or_foreign_is_not_inside(network: WindowNetwork) -> None:
    features = windows(7, count=3).features
    column = WINDOW_KEYS.index(network.keys[0])
    features[0, column], features[1, column] = np.nan, 100.0
    assert network.inside(features)[:2].tolist() == [False, False]
    assert np.isnan(network.probabilities(features)[0]).all()
    with pytest.raises(ValueError, match="features must have the shape"):
        network.probabilities(features[:, :3])


def test_a_network_of_unknown_statistics_is_refused(network: WindowNetwork) -> None:
    with pytest.raises(ValueError, match="'V13 rms' is not a statistic"):
        replace(network, keys=("V13 rms", *network.keys[1:]))
    with pytest.raises(ValueError, match="do not name"):
        replace(network, keys=network.keys[:-1])
