"""Learning: feature ranking and selection, the network, its training and its model file.

Submodules are imported on first use: an onboard computer that only runs a trained model needs
neither scikit-learn nor torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.lazy import lazy_exports

if TYPE_CHECKING:
    from mavhums.learn.calibration import brier_score, calibrate, expected_calibration_error
    from mavhums.learn.card import Calibration, Card, WindowCard
    from mavhums.learn.chain import Scheme, select_features
    from mavhums.learn.dependence import Dependence, RegressionRedundancyFilter
    from mavhums.learn.ensemble import TanhNetworkEnsemble
    from mavhums.learn.inference import Network, TanhNetwork, WindowNetwork
    from mavhums.learn.leakage import CommandLeak, CommandLeakWarning, check_command
    from mavhums.learn.model import (
        Answers,
        Model,
        ModelError,
        default_model,
        load_model,
        models,
        packaged_models,
        save_model,
    )
    from mavhums.learn.network import TanhNetworkClassifier
    from mavhums.learn.precedents import Precedent, PrecedentBase, PrecedentError, Provenance
    from mavhums.learn.ranking import ChiSquareRanking
    from mavhums.learn.redundancy import PairwiseRedundancyFilter
    from mavhums.learn.regression import NonlinearRegression
    from mavhums.learn.selection import Selection
    from mavhums.learn.subsets import SubsetSearch, exhaustive_search, genetic_search
    from mavhums.learn.thinning import VectorThinning
    from mavhums.learn.training import Candidate, TrainingResult, train_network
    from mavhums.learn.window_training import LabelledWindows, WindowResult, train_windows
    from mavhums.learn.wrapper import NetworkSubsetSelector, network_objective

__all__ = [
    "Answers",
    "Calibration",
    "Candidate",
    "Card",
    "ChiSquareRanking",
    "CommandLeak",
    "CommandLeakWarning",
    "Dependence",
    "LabelledWindows",
    "Model",
    "ModelError",
    "Network",
    "NetworkSubsetSelector",
    "NonlinearRegression",
    "PairwiseRedundancyFilter",
    "Precedent",
    "PrecedentBase",
    "PrecedentError",
    "Provenance",
    "RegressionRedundancyFilter",
    "Scheme",
    "Selection",
    "SubsetSearch",
    "TanhNetwork",
    "TanhNetworkClassifier",
    "TanhNetworkEnsemble",
    "TrainingResult",
    "VectorThinning",
    "WindowCard",
    "WindowNetwork",
    "WindowResult",
    "brier_score",
    "calibrate",
    "check_command",
    "default_model",
    "exhaustive_search",
    "expected_calibration_error",
    "genetic_search",
    "load_model",
    "models",
    "network_objective",
    "packaged_models",
    "save_model",
    "select_features",
    "train_network",
    "train_windows",
]

_MODULES = {
    "calibration": ("brier_score", "calibrate", "expected_calibration_error"),
    "card": ("Calibration", "Card", "WindowCard"),
    "chain": ("Scheme", "select_features"),
    "dependence": ("Dependence", "RegressionRedundancyFilter"),
    "ensemble": ("TanhNetworkEnsemble",),
    "inference": ("Network", "TanhNetwork", "WindowNetwork"),
    "leakage": ("CommandLeak", "CommandLeakWarning", "check_command"),
    "model": (
        "Answers",
        "Model",
        "ModelError",
        "default_model",
        "load_model",
        "models",
        "packaged_models",
        "save_model",
    ),
    "network": ("TanhNetworkClassifier",),
    "precedents": ("Precedent", "PrecedentBase", "PrecedentError", "Provenance"),
    "ranking": ("ChiSquareRanking",),
    "redundancy": ("PairwiseRedundancyFilter",),
    "regression": ("NonlinearRegression",),
    "selection": ("Selection",),
    "subsets": ("SubsetSearch", "exhaustive_search", "genetic_search"),
    "thinning": ("VectorThinning",),
    "training": ("Candidate", "TrainingResult", "train_network"),
    "window_training": ("LabelledWindows", "WindowResult", "train_windows"),
    "wrapper": ("NetworkSubsetSelector", "network_objective"),
}
__getattr__, __dir__ = lazy_exports(
    __name__,
    {name: module for module, names in _MODULES.items() for name in names},
    missing={"sklearn": ("training", "train")},
)
