"""Calibration: converts a share of votes to a probability, and scores such probabilities."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mavhums.learn.card import Calibration

__all__ = ["brier_score", "calibrate", "expected_calibration_error"]

_BINS = 10


def calibrate(share: ArrayLike, event: ArrayLike) -> Calibration:
    """Fit the probability of an event as a logistic function of the share of votes for it.

    Parameters
    ----------
    share
        Share of votes for the event in each window, within [0, 1], shape (n,).
    event
        Whether the event occurred in that window, shape (n,).

    Raises
    ------
    ValueError
        If the windows do not contain both outcomes.

    References
    ----------
    J. Platt: Probabilistic Outputs for Support Vector Machines and Comparisons to Regularized
    Likelihood Methods, 1999.

    Examples
    --------
    >>> calibrate([0.1, 0.2, 0.3, 0.7, 0.8, 0.9], [0, 0, 1, 0, 1, 1]).probability(0.9) > 0.8
    True
    """
    from sklearn.linear_model import LogisticRegression

    shares = np.asarray(share, dtype=np.float64)
    model = LogisticRegression(C=100.0).fit(shares[:, np.newaxis], np.asarray(event, dtype=np.bool_))
    # Rounded, so that a solver's last digits do not enter the model's hash.
    return Calibration(
        slope=round(float(model.coef_[0, 0]), 6), intercept=round(float(model.intercept_[0]), 6)
    )


def brier_score(probability: ArrayLike, event: ArrayLike) -> float:
    """Return the mean squared difference of probability and outcome: 0 is perfect, 0.25 is a coin toss.

    Examples
    --------
    >>> brier_score([0.0, 0.5], [False, True])
    0.125
    """
    said, was = np.asarray(probability, dtype=np.float64), np.asarray(event, dtype=np.float64)
    return float(np.mean((said - was) ** 2))


def expected_calibration_error(probability: ArrayLike, event: ArrayLike) -> float:
    """Return the mean |probability − observed frequency| over ten bins, weighted by their counts.

    Examples
    --------
    >>> expected_calibration_error([0.75, 0.75, 0.75, 0.75], [1, 1, 1, 0])
    0.0
    """
    said, was = np.asarray(probability, dtype=np.float64), np.asarray(event, dtype=np.float64)
    bins = np.minimum((said * _BINS).astype(np.intp), _BINS - 1)
    excess = np.bincount(bins, weights=said - was, minlength=_BINS)
    return float(np.abs(excess).sum() / len(said))
