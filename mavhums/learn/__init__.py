"""Learning: feature ranking and selection, the network, its training and its model file.

Submodules are imported on first use: an onboard computer that only runs a trained model needs
neither scikit-learn nor torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.learn.card import Calibration, Card, Selection, WindowCard
    from mavhums.learn.chain import Scheme, select_features
    from mavhums.learn.evaluation import (
        CommandLeak,
        CommandLeakWarning,
        brier_score,
        calibrate,
        check_command,
        expected_calibration_error,
    )
    from mavhums.learn.inference import Network, TanhNetwork, WindowNetwork
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
    from mavhums.learn.networks import TanhNetworkEnsemble
    from mavhums.learn.precedents import Precedent, PrecedentBase, PrecedentError, Provenance
    from mavhums.learn.ranking import ChiSquareRanking, VectorThinning
    from mavhums.learn.redundancy import Dependence, PairwiseRedundancyFilter, RegressionRedundancyFilter
    from mavhums.learn.regression import NonlinearRegression
    from mavhums.learn.subsets import (
        SubsetSearch,
        exhaustive_search,
        genetic_search,
        network_objective,
    )
    from mavhums.learn.training import (
        LabelledWindows,
        NetworkScore,
        TrainingResult,
        WindowResult,
        train_network,
        train_windows,
    )

__all__ = [
    "Answers",
    "Calibration",
    "Card",
    "ChiSquareRanking",
    "CommandLeak",
    "CommandLeakWarning",
    "Dependence",
    "LabelledWindows",
    "Model",
    "ModelError",
    "Network",
    "NetworkScore",
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
    "card": "Calibration Card Selection WindowCard",
    "chain": "Scheme select_features",
    "evaluation": "CommandLeak CommandLeakWarning brier_score calibrate check_command "
    "expected_calibration_error",
    "inference": "Network TanhNetwork WindowNetwork",
    "model": "Answers Model ModelError default_model load_model models packaged_models save_model",
    "networks": "TanhNetworkEnsemble",
    "precedents": "Precedent PrecedentBase PrecedentError Provenance",
    "ranking": "ChiSquareRanking VectorThinning",
    "redundancy": "Dependence PairwiseRedundancyFilter RegressionRedundancyFilter",
    "regression": "NonlinearRegression",
    "subsets": "SubsetSearch exhaustive_search genetic_search network_objective",
    "training": "LabelledWindows NetworkScore TrainingResult WindowResult train_network train_windows",
}
__getattr__, __dir__ = lazy_exports(
    __name__,
    {name: module for module, names in _MODULES.items() for name in names.split()},
    missing={"sklearn": ("training", "train")},
)
