"""Base classes of the estimators that need class labels."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.feature_selection import SelectorMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from mavhums.learn._parameters import check_positive_integers, two_classes

__all__ = ["Classified", "SupportSelector", "TwoClasses"]


class Classified(BaseEstimator):
    """An estimator whose ``fit`` requires the samples' classes."""

    def _checked(self, X: ArrayLike, y: ArrayLike, **wanted: Any) -> tuple[NDArray[np.float64], NDArray[Any]]:
        """Return samples (n, k) and classes (n,); ``wanted`` goes to ``validate_data``.

        Raises
        ------
        ValueError
            If the samples are not finite numbers, or the targets are not classes.
        """
        values, target = validate_data(self, X, y, dtype=np.float64, **wanted)
        check_classification_targets(target)
        return values, target

    def __sklearn_tags__(self) -> Any:
        """Declare that the target is required."""
        tags = super().__sklearn_tags__()
        tags.target_tags.required = True
        return tags


class SupportSelector(SelectorMixin, Classified):
    """A selector whose ``fit`` stores the mask of kept features in ``support_``, shape (n_features,)."""

    support_: NDArray[np.bool_]

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_


class TwoClasses(ClassifierMixin, Classified):
    """A classifier of two classes, which ``fit`` stores in ``classes_``."""

    classes_: NDArray[Any]
    weight_decay: float

    def _coded(self, X: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return samples (n, k) and the index of each sample's class in ``classes_``, shape (n,).

        Raises
        ------
        ValueError
            If the samples are not finite numbers, or the classes are not two.
        """
        values, target = self._checked(X, y)
        self.classes_, codes = two_classes(target)
        return values, codes

    def _features(self, X: ArrayLike) -> NDArray[np.float64]:
        check_is_fitted(self)
        features: NDArray[np.float64] = validate_data(self, X, dtype=np.float64, reset=False)
        return features

    def _check_training(self, *integers: str) -> None:
        """Check the parameters that must be integers of at least 1, and the weight decay."""
        check_positive_integers(self, *integers)
        if not isinstance(self.weight_decay, Real) or not 0 <= self.weight_decay < np.inf:
            raise ValueError(f"weight_decay must be finite and not negative, got {self.weight_decay!r}")

    def __sklearn_tags__(self) -> Any:
        """Declare a binary classifier."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags
