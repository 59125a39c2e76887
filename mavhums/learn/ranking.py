"""Ranking of features by chi-square, and thinning of vectors (paper, sections 3 and 2)."""

from __future__ import annotations

from numbers import Integral
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2_contingency
from sklearn.cluster import KMeans
from sklearn.feature_selection import SelectorMixin
from sklearn.metrics import pairwise_distances_argmin
from sklearn.metrics.cluster import contingency_matrix
from sklearn.utils import check_random_state
from sklearn.utils.validation import _check_sample_weight, check_is_fitted
from threadpoolctl import threadpool_limits

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.learn._estimators import LabelledEstimator, check_choice, check_positive_integers
from mavhums.learn.inference import unit_interval


class ChiSquareRanking(SelectorMixin, LabelledEstimator):
    """Rank features by Pearson's chi-square between their bins and the classes.

    :func:`sklearn.feature_selection.chi2` treats feature values as counts and requires them to be
    non-negative. This ranking divides each feature into bins and computes the statistic of the
    contingency table bins × classes, without continuity correction. Empty bins are omitted. A
    feature with the same distribution in all classes scores 0; so does a constant feature.

    Parameters
    ----------
    bins
        Number of bins per feature. With twelve bins and two classes the statistic has up to 11
        degrees of freedom, which agrees with the p-level of V12 in the paper's figure 15.
    strategy
        ``"width"``: bins of equal width between a feature's minimum and maximum; the statistic is
        invariant under rescaling. ``"quantile"``: bins with about equal numbers of samples; the
        statistic is invariant under any increasing transformation.
    k
        Number of features that :meth:`transform` keeps: those with the largest statistics; ties go
        to the first column. ``"all"`` keeps all and only ranks.

    Attributes
    ----------
    scores_
        Chi-square statistic of each feature, shape (n_features,).
    degrees_of_freedom_
        (Occupied bins − 1) × (classes − 1) of each feature, shape (n_features,).
    p_values_
        Probability of a statistic this large if feature and class were independent. Successive
        samples of a time series are not independent draws, so use it for ranking, not as proof.
    n_features_in_
        Number of features seen by :meth:`fit`.

    Notes
    -----
    With two classes the statistic cannot exceed the number of samples.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 3, stage 1.

    Examples
    --------
    >>> import numpy as np
    >>> label = np.repeat([0, 1], 50)
    >>> informative, uninformative = label * 5.0, np.tile(np.arange(50.0), 2)
    >>> ranking = ChiSquareRanking(k=1).fit(np.column_stack([uninformative, informative]), label)
    >>> ranking.scores_
    array([  0., 100.])
    >>> ranking.get_support()
    array([False,  True])
    """

    scores_: Array
    degrees_of_freedom_: Integers
    p_values_: Array

    def __init__(
        self,
        bins: int = 12,
        strategy: Literal["width", "quantile"] = "width",
        k: int | Literal["all"] = "all",
    ) -> None:
        self.bins = bins
        self.strategy = strategy
        self.k = k

    def fit(self, X: ArrayLike, y: ArrayLike) -> ChiSquareRanking:
        """Compute the statistic of each feature.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            Class of each sample, shape (n_samples,).

        Raises
        ------
        ValueError
            If a parameter or the data are not as described.
        """
        if not isinstance(self.bins, Integral) or self.bins < 2:
            raise ValueError(f"bins must be an integer of at least 2, got {self.bins!r}")
        check_choice(self, "strategy", ("width", "quantile"))
        values, target = self._checked(X, y)
        limit = values.shape[1]
        if self.k != "all" and not (isinstance(self.k, Integral) and 1 <= self.k <= limit):
            raise ValueError(f"k must be 'all' or an integer from 1 to {limit}, got {self.k!r}")
        bins = _width_bins if self.strategy == "width" else _quantile_bins
        results = [
            chi2_contingency(contingency_matrix(bins(feature, self.bins), target), correction=False)
            for feature in values.T
        ]
        self.scores_ = np.array([result.statistic for result in results], dtype=np.float64)
        self.degrees_of_freedom_ = np.array([result.dof for result in results], dtype=np.int64)
        self.p_values_ = np.array([result.pvalue for result in results], dtype=np.float64)
        return self

    def _get_support_mask(self) -> Flags:
        check_is_fitted(self)
        mask = np.ones(len(self.scores_), dtype=np.bool_)
        if self.k != "all":
            mask[np.argsort(-self.scores_, kind="stable")[self.k :]] = False
        return mask


def _width_bins(feature: Array, bins: int) -> Integers:
    scaled = unit_interval(feature, feature.min(), feature.max())
    return np.minimum((scaled * bins).astype(np.int64), bins - 1)


def _quantile_bins(feature: Array, bins: int) -> Integers:
    inner = np.arange(1, bins) / bins
    edges = np.quantile(feature, inner, method="inverted_cdf")
    return np.searchsorted(edges, feature, side="left").astype(np.int64)


_ITERATIONS = 20


class VectorThinning(LabelledEstimator):
    """Keep representative vectors of each class, each weighted by the number it represents.

    Each class keeps its share of the vectors, at least one: the sample nearest to each k-means centre,
    weighted by the number of samples nearest to it. Similarity is measured on features scaled onto the unit
    interval.

    Parameters
    ----------
    n_vectors
        Number of vectors to keep, over all classes; all are kept if there are no more.
    random_state
        Seed, generator or None.

    Attributes
    ----------
    indices_
        Indices of the kept rows, ascending.
    weights_
        Number (or weight) of the samples that each kept row represents; the sum is that of all samples.
    n_features_in_
        Number of features seen by :meth:`fit`.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 2.

    Examples
    --------
    >>> import numpy as np
    >>> features = np.repeat([[0.0], [1.0], [5.0]], [6, 2, 4], axis=0)
    >>> kept = VectorThinning(n_vectors=3, random_state=0).fit(features, np.repeat([0, 1], [8, 4]))
    >>> features[kept.indices_].ravel(), kept.weights_
    (array([0., 1., 5.]), array([6., 2., 4.]))
    """

    indices_: Integers
    weights_: Array

    def __init__(
        self, n_vectors: int = 2000, random_state: int | np.random.RandomState | None = None
    ) -> None:
        self.n_vectors = n_vectors
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> VectorThinning:
        """Choose the vectors to keep.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            Class of each sample, shape (n_samples,).
        sample_weight
            How many samples each one counts for in :attr:`weights_`, shape (n_samples,); 1 if None.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described.
        """
        check_positive_integers(self, "n_vectors")
        values, target = self._checked(X, y)
        counts = _check_sample_weight(sample_weight, values, dtype=np.float64, ensure_non_negative=True)
        random = check_random_state(self.random_state)
        scaled = unit_interval(values, values.min(axis=0), values.max(axis=0))
        rows, weights = [], []
        for label in np.unique(target):
            members = np.flatnonzero(target == label)
            count = max(1, round(self.n_vectors * len(members) / len(target)))
            if count >= len(members):
                chosen, weight = np.arange(len(members)), counts[members]
            else:
                chosen, weight = _representatives(scaled[members], counts[members], count, random)
            rows.append(members[chosen])
            weights.append(weight)
        kept = np.concatenate(rows)
        order = np.argsort(kept)
        self.indices_, self.weights_ = kept[order], np.concatenate(weights)[order]
        return self


def _representatives(
    scaled: Array, counts: Array, count: int, random: np.random.RandomState
) -> tuple[Integers, Array]:
    distinct = len(np.unique(scaled, axis=0))
    # One thread: the sums do not depend on the cores, and a busy machine does not wait for its threads.
    with threadpool_limits(1):
        clusters = KMeans(min(count, distinct), n_init=1, max_iter=_ITERATIONS, random_state=random)
        clusters.fit(scaled)
    chosen = np.unique(pairwise_distances_argmin(clusters.cluster_centers_, scaled))
    represented_by = pairwise_distances_argmin(scaled, scaled[chosen])
    return chosen, np.bincount(represented_by, weights=counts, minlength=len(chosen)).astype(np.float64)
