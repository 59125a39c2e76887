"""What the estimators share: base classes and checks of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.feature_selection import SelectorMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from mavhums.core.arrays import Array, Flags


def check_positive_integers(estimator: object, *names: str) -> None:
    """Raise ``ValueError`` unless these parameters are integers of at least 1."""
    for name in names:
        value = getattr(estimator, name)
        if not isinstance(value, Integral) or value < 1:
            raise ValueError(f"{name} must be an integer of at least 1, got {value!r}")


def check_choice(estimator: object, name: str, choices: Sequence[str]) -> None:
    """Raise ``ValueError`` unless a parameter is one of the choices."""
    value = getattr(estimator, name)
    if value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, got {value!r}")


class LabelledEstimator(BaseEstimator):
    """An estimator whose ``fit`` requires the samples' classes."""

    def _checked(self, X: ArrayLike, y: ArrayLike, **wanted: Any) -> tuple[Array, NDArray[Any]]:
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


class SupportSelector(SelectorMixin, LabelledEstimator):
    """A selector whose ``fit`` stores the mask of kept features in ``support_``, shape (n_features,)."""

    support_: Flags

    def _get_support_mask(self) -> Flags:
        check_is_fitted(self)
        return self.support_
