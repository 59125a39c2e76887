"""Compose mavhums' feature selection with scikit-learn's models, whole flights kept together.

    python examples/selectors_in_a_pipeline.py

Flies both conditions of the elevator four times each, and cross-validates three classifiers behind
two of our selectors. ``GroupKFold`` never has samples of one flight on both sides of a split.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np

import mavhums
from mavhums.core.quantities import KEYS
from mavhums_sim import Flight, fly

if TYPE_CHECKING:
    from sklearn.feature_selection import SelectorMixin

FRICTION_NM = {"normal": 0.225, "emergency": 1.025}
FLIGHTS = 4


def flights(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return V1…V12, the condition and the flight of every fifth sample."""
    values, labels, groups = [], [], []
    for seed in range(FLIGHTS):
        for label, friction in FRICTION_NM.items():
            # Both conditions use the same cyclogram, so the command does not distinguish them.
            flight = Flight(seed=seed, duration_s=seconds, friction_nm={"elevator": (friction, friction)})
            flown = fly(flight).actuators["elevator"].values[::5]
            values.append(flown)
            labels += [label] * len(flown)
            groups += [f"{label} {seed}"] * len(flown)
    return np.concatenate(values), np.array(labels), np.array(groups)


def main(seconds: float = 60.0) -> dict[str, float]:
    """Print and return the mean accuracy of each pipeline."""
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import GroupKFold, cross_val_score
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import MinMaxScaler, PolynomialFeatures

    from mavhums.learn import (
        ChiSquareRanking,
        RegressionRedundancyFilter,
        TanhNetworkEnsemble,
        check_command,
    )

    values, labels, groups = flights(seconds)
    check_command(values[:, 0], labels == "emergency", groups)
    selectors: dict[str, SelectorMixin] = {
        "chi-square, best 6": ChiSquareRanking(k=6),
        "Algorithm 1": RegressionRedundancyFilter(threshold=0.99),
    }
    models = {
        "logistic regression, degree 3": make_pipeline(
            PolynomialFeatures(3), LogisticRegression(max_iter=5000)
        ),
        "gradient boosting": HistGradientBoostingClassifier(max_iter=20, random_state=0),
        "tanh networks": TanhNetworkEnsemble(10, max_iter=100, random_state=0),
    }
    folds = GroupKFold(n_splits=4)
    results = {}
    for name, selector in selectors.items():
        kept = selector.fit(values, labels).get_support()
        print(f"{name} (on all flights: {', '.join(np.array(KEYS)[kept])})")
        for model_name, model in models.items():
            pipeline = make_pipeline(selector, MinMaxScaler(), model)
            scores = cross_val_score(pipeline, values, labels, groups=groups, cv=folds)
            results[f"{name} → {model_name}"] = float(scores.mean())
            print(f"  {model_name:30} {100 * scores.mean():6.2f} % ± {100 * scores.std():.2f}")
    return results


if __name__ == "__main__":
    try:
        main()
    except ImportError as error:
        sys.exit(f"{error}: pip install 'mavhums[train]'")
    except mavhums.MavhumsError as error:
        sys.exit(str(error))
