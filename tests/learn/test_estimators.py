"""Every estimator of the room goes through scikit-learn's own battery of checks."""

from collections.abc import Callable
from typing import Any

from sklearn.utils.estimator_checks import parametrize_with_checks

from mavhums.learn import ChiSquareRanking, PairwiseRedundancyFilter, TanhNetworkClassifier

ESTIMATORS = [
    ChiSquareRanking(),
    ChiSquareRanking(strategy="quantile"),
    PairwiseRedundancyFilter(),
    TanhNetworkClassifier(random_state=0),
]


@parametrize_with_checks(ESTIMATORS)  # type: ignore[untyped-decorator]
def test_follows_the_conventions_of_scikit_learn(estimator: Any, check: Callable[[Any], None]) -> None:
    check(estimator)
