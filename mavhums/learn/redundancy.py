"""Exclusion of features that others explain: Algorithm 1, and regression in pairs (paper, section 3)."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from sklearn.base import clone

from mavhums.core.arrays import Array, Integers
from mavhums.learn._estimators import SupportSelector, check_positive_integers
from mavhums.learn.inference import unit_interval
from mavhums.learn.ranking import ChiSquareRanking
from mavhums.learn.regression import (
    IDENTITY,
    Elementary,
    NonlinearRegression,
    basis_products,
    basis_values,
    solve_least_squares,
)


@dataclass(frozen=True, eq=False)
class Dependence:
    """One excluded feature, and the features that explain it.

    Attributes
    ----------
    feature
        Column of the excluded feature.
    explained_by
        The smallest set of columns found whose R² still reaches the threshold.
    r2_all
        R² of the regression on all features not yet excluded.
    model
        The regression on ``explained_by``; its ``expression`` is the formula.
    """

    feature: int
    explained_by: tuple[int, ...]
    r2_all: float
    model: NonlinearRegression


class _RedundancyFilter(SupportSelector):
    """A filter that keeps some of the features that vary, by their chi-square."""

    threshold: float
    ranking: ChiSquareRanking | None
    groups_: tuple[tuple[int, ...], ...]
    ranking_: ChiSquareRanking

    def _ranked(self, X: ArrayLike, y: ArrayLike) -> tuple[Array, Integers]:
        """Return the samples, shape (n, k), and the columns that vary, and rank the features."""
        if not isinstance(self.threshold, Real) or not 0 < self.threshold <= 1:
            raise ValueError(f"threshold must lie above 0 and not above 1, got {self.threshold!r}")
        values, target = self._checked(X, y, ensure_min_samples=2)
        varying = np.flatnonzero(np.ptp(values, axis=0) > 0)
        if not varying.size:
            raise ValueError("every feature is constant, so none distinguishes the classes")
        self.ranking_ = clone(self.ranking or ChiSquareRanking()).fit(values, target)
        return values, varying


class RegressionRedundancyFilter(_RedundancyFilter):
    """Exclude features that the remaining ones explain, the least informative first.

    Features are visited in ascending order of chi-square. Algorithm 1 regresses each feature on
    all features not yet excluded, and excludes it if R² reaches the threshold. Backward
    elimination then drops the regressors that are not needed to reach the threshold, the least
    important first. The feature and the remaining regressors are interdependent; interdependent
    sets that share a feature form a group.

    Parameters
    ----------
    threshold
        R² from which a feature is excluded, above 0 and at most 1.
    functions, order, tolerance
        Parameters of :class:`NonlinearRegression`.
    ranking
        The :class:`ChiSquareRanking` that orders the features; it is cloned. None means its defaults.

    Attributes
    ----------
    dependences_
        The excluded features in the order of their exclusion, with their models.
    groups_
        Columns of each group, ascending; groups are sorted by first column. A feature without
        dependences is a group of its own; a constant feature is in no group.
    support_
        Mask of the kept features, shape (n_features,). Constant features are not kept.
    ranking_
        The fitted ranking.
    n_features_in_
        Number of features seen by :meth:`fit`.

    See Also
    --------
    PairwiseRedundancyFilter : Regresses on one feature at a time, which finds near-linear groups.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 3, stage 2.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> label = np.repeat([0, 1], 500)
    >>> voltage, current = rng.normal(size=1000), rng.normal(size=1000) + label
    >>> features = np.column_stack([voltage, current, voltage * current, rng.normal(size=1000)])
    >>> found = RegressionRedundancyFilter().fit(features, label)
    >>> found.groups_, [dependence.feature for dependence in found.dependences_]
    (((0, 1, 2), (3,)), [2])
    """

    dependences_: tuple[Dependence, ...]

    def __init__(
        self,
        threshold: float = 0.9,
        functions: Elementary | None = None,
        order: int = 2,
        tolerance: float = 1e-6,
        ranking: ChiSquareRanking | None = None,
    ) -> None:
        self.threshold = threshold
        self.functions = functions
        self.order = order
        self.tolerance = tolerance
        self.ranking = ranking

    def fit(self, X: ArrayLike, y: ArrayLike) -> RegressionRedundancyFilter:
        """Find the features that others explain, and exclude them.

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
        check_positive_integers(self, "order")
        values, columns = self._ranked(X, y)
        varying = columns.tolist()
        functions = IDENTITY if self.functions is None else self.functions
        squares = _Squares(values, varying, functions, self.order, self.tolerance)
        staying, found = list(varying), []
        for feature in sorted(varying, key=lambda column: (self.ranking_.scores_[column], -column)):
            others = [column for column in staying if column != feature]
            r2 = squares.r2(feature, others)
            if others and r2 >= self.threshold:
                staying = others
                found.append((feature, self._fewest(squares, feature, others), r2))
        self.dependences_ = tuple(
            Dependence(feature, needed, r2, self._model(values, feature, needed))
            for feature, needed, r2 in found
        )
        self.groups_ = _groups(varying, self.dependences_)
        self.support_ = np.isin(np.arange(values.shape[1]), staying)
        return self

    def _fewest(self, squares: _Squares, feature: int, others: list[int]) -> tuple[int, ...]:
        needed = list(others)
        while len(needed) > 1:
            r2, least = max(
                (squares.r2(feature, [c for c in needed if c != column]), column) for column in needed
            )
            if r2 < self.threshold:
                break
            needed.remove(least)
        return tuple(needed)

    def _model(self, values: Array, feature: int, needed: tuple[int, ...]) -> NonlinearRegression:
        model = NonlinearRegression(self.functions, self.order, self.tolerance)
        return model.fit(values[:, needed], values[:, feature])


class _Squares:
    """R² of any feature on any others, from one QR decomposition of all basis functions.

    The triangular factor preserves every inner product of the columns, so each regression has as
    many rows as columns, whatever the number of samples.
    """

    def __init__(
        self,
        values: Array,
        varying: list[int],
        functions: Elementary,
        order: int,
        tolerance: float,
    ) -> None:
        self._products = basis_products(len(functions), varying, order)
        self._targets = {feature: len(self._products) + place for place, feature in enumerate(varying)}
        self._tolerance = tolerance
        basis = basis_values(values, functions, self._products)
        columns = np.column_stack([basis, values[:, varying]])
        norm = np.linalg.norm(columns, axis=0)
        self._triangle: Array = np.asarray(np.linalg.qr(columns / np.where(norm > 0, norm, 1), mode="r"))

    def r2(self, feature: int, others: list[int]) -> float:
        """Return R² of the regression of a feature on others."""
        allowed = set(others)
        used = [i for i, product in enumerate(self._products) if all(f in allowed for f, _ in product)]
        target = self._triangle[:, self._targets[feature]]
        residual, total = (self._residual(columns, target) for columns in (used, used[:1]))
        return 1 - residual / total

    def _residual(self, columns: list[int], target: Array) -> float:
        basis = self._triangle[:, columns]
        coefficients, _ = solve_least_squares(basis, target, self._tolerance)
        return float(np.square(target - basis @ coefficients).sum())


def _groups(varying: list[int], dependences: tuple[Dependence, ...]) -> tuple[tuple[int, ...], ...]:
    place = {feature: number for number, feature in enumerate(varying)}
    links = [(place[found.feature], place[other]) for found in dependences for other in found.explained_by]
    rows, columns = np.array(links, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(links)), (rows, columns)), shape=(len(varying), len(varying)))
    count, labels = connected_components(graph, directed=False)
    return tuple(tuple(np.array(varying)[labels == label].tolist()) for label in range(count))


class PairwiseRedundancyFilter(_RedundancyFilter):
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

    r2_: Array

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
        check_positive_integers(self, "degree")
        values, varying = self._ranked(X, y)
        scaled = unit_interval(values, values.min(axis=0), values.max(axis=0))
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


def _pairwise_r2(scaled: Array, degree: int) -> Array:
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
