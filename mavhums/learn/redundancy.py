"""Redundancy filter by regression between pairs of features (paper, section 3, stage 2)."""

from __future__ import annotations

from numbers import Real

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components
from sklearn.base import clone

from mavhums.learn._classified import SupportSelector
from mavhums.learn._parameters import check_positive_integers
from mavhums.learn.ranking import ChiSquareRanking
from mavhums.learn.scaling import unit_interval

__all__ = ["PairwiseRedundancyFilter"]


class PairwiseRedundancyFilter(SupportSelector):
    """Keep the most informative feature of each group of features that explain one another.

    A polynomial regresses each feature on each other feature. Two features are linked if R² of
    either regression reaches the threshold. The connected components are the groups; the filter
    keeps the feature with the largest chi-square of each group (ties go to the first column).

    This is the alternative to the paper's Algorithm 1 (:class:`RegressionRedundancyFilter`), which
    regresses each feature on all others at once. Regression of degree 2 on all others explains
    almost every feature, because V6 = V4·V5, V9 = V7·V8 and V12 ∝ V10·V11. Regression between
    pairs finds those groups of the paper's figure 15 that are nearly linear.

    Parameters
    ----------
    threshold
        Minimum R² that links two features, above 0 and at most 1.
    degree
        Degree of the polynomial, at least 1.
    ranking
        The :class:`ChiSquareRanking` that determines which feature of a group is kept; it is
        cloned. ``None`` means one with its defaults.

    Attributes
    ----------
    r2_
        ``r2_[i, j]`` is R² of the regression of feature i on feature j, shape
        (n_features, n_features). The row and column of a constant feature are 0.
    groups_
        Column indices of each group, ascending; groups are sorted by first column. A feature
        without links is a group of its own; a constant feature is in no group.
    support_
        Mask of the kept features, shape (n_features,). Constant features are not kept.
    ranking_
        The fitted ranking.
    n_features_in_
        Number of features seen by :meth:`fit`.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 3, stage 2.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> label = np.repeat([0, 1], 500)
    >>> angle, current = rng.normal(size=1000), rng.normal(size=1000) + label
    >>> features = np.column_stack([angle, current, 600 * angle, 0.024 * current])
    >>> PairwiseRedundancyFilter().fit(features, label).groups_
    ((0, 2), (1, 3))
    """

    r2_: NDArray[np.float64]
    groups_: tuple[tuple[int, ...], ...]
    ranking_: ChiSquareRanking

    def __init__(
        self, threshold: float = 0.9, degree: int = 2, ranking: ChiSquareRanking | None = None
    ) -> None:
        self.threshold = threshold
        self.degree = degree
        self.ranking = ranking

    def fit(self, X: ArrayLike, y: ArrayLike) -> PairwiseRedundancyFilter:
        """Find the groups, and choose the feature to keep of each.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            Class of each sample, shape (n_samples,).

        Raises
        ------
        ValueError
            If a parameter or the data are not as described, or every feature is constant.
        """
        if not isinstance(self.threshold, Real) or not 0 < self.threshold <= 1:
            raise ValueError(f"threshold must lie above 0 and not above 1, got {self.threshold!r}")
        check_positive_integers(self, "degree")
        values, target = self._checked(X, y, ensure_min_samples=2)
        scaled = unit_interval(values, values.min(axis=0), values.max(axis=0))
        varying = np.flatnonzero(scaled.any(axis=0))
        if not varying.size:
            raise ValueError("every feature is constant, so none distinguishes the classes")
        self.ranking_ = clone(self.ranking or ChiSquareRanking()).fit(values, target)
        self.r2_ = np.zeros((values.shape[1], values.shape[1]))
        self.r2_[np.ix_(varying, varying)] = _pairwise_r2(scaled[:, varying], self.degree)
        count, labels = connected_components(
            self.r2_[np.ix_(varying, varying)] >= self.threshold, directed=False
        )
        self.groups_ = tuple(tuple(varying[labels == label].tolist()) for label in range(count))
        self.support_ = np.zeros(values.shape[1], dtype=np.bool_)
        for group in self.groups_:
            self.support_[max(group, key=lambda feature: self.ranking_.scores_[feature])] = True
        return self


def _pairwise_r2(scaled: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    centred = scaled - scaled.mean(axis=0)
    total = np.square(centred).sum(axis=0)
    r2 = np.empty((scaled.shape[1], scaled.shape[1]))
    for column, regressor in enumerate(scaled.T):
        basis = chebvander(2 * regressor - 1, degree)
        coefficients = np.linalg.lstsq(basis, centred, rcond=None)[0]
        residual = np.square(centred - basis @ coefficients).sum(axis=0)
        r2[:, column] = np.clip(1 - residual / total, 0, 1)
    np.fill_diagonal(r2, 1)
    return r2
