"""What the estimators that need classes have in common."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.feature_selection import SelectorMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

__all__ = ["Classified", "SupportSelector"]


class Classified(BaseEstimator):
    """An estimator that cannot be fitted without the samples' classes."""

    def _checked(self, X: ArrayLike, y: ArrayLike, **wanted: Any) -> tuple[NDArray[np.float64], NDArray[Any]]:
        """Return samples (n, k) and classes (n,); ``wanted`` goes to ``validate_data``.

        Raises
        ------
        ValueError
            If they are not finite numbers and classes.
        """
        values, target = validate_data(self, X, y, dtype=np.float64, **wanted)
        check_classification_targets(target)
        return values, target

    def __sklearn_tags__(self) -> Any:
        """Say that the classes are needed."""
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


class SupportSelector(SelectorMixin, Classified):
    """A selector whose ``fit`` leaves the features that stay in ``support_``, shape (n_features,)."""

    support_: NDArray[np.bool_]

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_
