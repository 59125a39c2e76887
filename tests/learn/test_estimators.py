"""Every estimator of the room goes through scikit-learn's own battery of checks."""

from collections.abc import Callable
from typing import Any

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
