"""Every estimator of the room goes through scikit-learn's own battery of checks."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from mavhums.learn import (
    ChiSquareRanking,
    NonlinearRegression,
    PairwiseRedundancyFilter,
    RegressionRedundancyFilter,
    TanhNetworkEnsemble,
    VectorThinning,
)

ESTIMATORS = [
    ChiSquareRanking(),
    PairwiseRedundancyFilter(),
    TanhNetworkEnsemble(n_networks=2, max_iter=60, random_state=0),
    RegressionRedundancyFilter(),
    NonlinearRegression(),
    VectorThinning(n_vectors=20, random_state=0),
]


@pytest.mark.slow
@parametrize_with_checks(ESTIMATORS)  # type: ignore[untyped-decorator]
def test_follows_the_conventions_of_scikit_learn(estimator: Any, check: Callable[[Any], None]) -> None:
    check(estimator)


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (
            TanhNetworkEnsemble,
            {"n_networks": [0], "max_iter": [1.5], "patience": [0], "hidden": [(), (4, 0)]},
        ),
        (TanhNetworkEnsemble, {"weight_decay": [-1, float("nan"), "some"]}),
        (ChiSquareRanking, {"bins": [1, 2.5], "strategy": ["depth"], "k": [0, 3, 1.5, "some"]}),
        (PairwiseRedundancyFilter, {"threshold": [0, 1.01, "high"], "degree": [0, 1.5]}),
        (RegressionRedundancyFilter, {"threshold": [0]}),
        (NonlinearRegression, {"order": [0]}),
        (VectorThinning, {"n_vectors": [0]}),
    ],
)
def test_parameters_that_mean_nothing_are_refused(kind: Callable[..., Any], wrong: dict[str, Any]) -> None:
    features, label = np.random.default_rng(0).normal(size=(40, 2)), np.arange(40) % 2
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(ValueError, match=f"^{name} must"):
                kind(**{name: value}).fit(features, label)
