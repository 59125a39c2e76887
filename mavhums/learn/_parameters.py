"""Checks of estimators' parameters and of their target classes; every ``fit`` calls them."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.utils.multiclass import type_of_target

__all__ = ["check_choice", "check_positive_integers", "two_classes"]


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


def two_classes(target: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Return the two classes, and the index of each sample's class, shape (n_samples,).

    Raises
    ------
    ValueError
        If the target does not hold exactly two classes.
    """
    if type_of_target(target) != "binary":
        message = "Only binary classification is supported. The type of the target is "
        raise ValueError(f"{message}{type_of_target(target)}.")
    classes, codes = np.unique(target, return_inverse=True)
    if len(classes) != 2:
        raise ValueError(f"two classes are needed, the data hold one class: {classes[0]!r}")
    return classes, codes
