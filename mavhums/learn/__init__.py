"""Learning: feature ranking and selection, the network, its training and its model file.

Submodules are imported on first use: an onboard computer that only runs a trained model needs
neither scikit-learn nor torch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.learn.card import Calibration as Calibration
    from mavhums.learn.card import Card as Card
    from mavhums.learn.card import Selection as Selection
    from mavhums.learn.card import WindowCard as WindowCard
    from mavhums.learn.chain import Scheme as Scheme
    from mavhums.learn.chain import TrainingOptions as TrainingOptions
    from mavhums.learn.chain import select_features as select_features
    from mavhums.learn.evaluation import CommandLeak as CommandLeak
    from mavhums.learn.evaluation import CommandLeakWarning as CommandLeakWarning
    from mavhums.learn.evaluation import brier_score as brier_score
    from mavhums.learn.evaluation import calibrate as calibrate
    from mavhums.learn.evaluation import check_command as check_command
    from mavhums.learn.evaluation import expected_calibration_error as expected_calibration_error
    from mavhums.learn.inference import Network as Network
    from mavhums.learn.inference import TanhNetwork as TanhNetwork
    from mavhums.learn.inference import WindowNetwork as WindowNetwork
    from mavhums.learn.model import Answers as Answers
    from mavhums.learn.model import Model as Model
    from mavhums.learn.model import ModelError as ModelError
    from mavhums.learn.model import default_model as default_model
    from mavhums.learn.model import load_model as load_model
    from mavhums.learn.model import models as models
    from mavhums.learn.model import packaged_models as packaged_models
    from mavhums.learn.model import save_model as save_model
    from mavhums.learn.networks import TanhNetworkEnsemble as TanhNetworkEnsemble
    from mavhums.learn.precedents import Precedent as Precedent
    from mavhums.learn.precedents import PrecedentBase as PrecedentBase
    from mavhums.learn.precedents import PrecedentError as PrecedentError
    from mavhums.learn.precedents import Provenance as Provenance
    from mavhums.learn.ranking import ChiSquareRanking as ChiSquareRanking
    from mavhums.learn.ranking import VectorThinning as VectorThinning
    from mavhums.learn.redundancy import Dependence as Dependence
    from mavhums.learn.redundancy import PairwiseRedundancyFilter as PairwiseRedundancyFilter
    from mavhums.learn.redundancy import RegressionRedundancyFilter as RegressionRedundancyFilter
    from mavhums.learn.regression import NonlinearRegression as NonlinearRegression
    from mavhums.learn.trainer import NetworkOptions as NetworkOptions
    from mavhums.learn.trainer import Vectors as Vectors
    from mavhums.learn.training import LabelledWindows as LabelledWindows
    from mavhums.learn.training import NetworkScore as NetworkScore
    from mavhums.learn.training import TrainingResult as TrainingResult
    from mavhums.learn.training import train_network as train_network
    from mavhums.learn.training import train_windows as train_windows
    from mavhums.learn.wrapper import SubsetSearch as SubsetSearch
    from mavhums.learn.wrapper import exhaustive_search as exhaustive_search
    from mavhums.learn.wrapper import genetic_search as genetic_search
    from mavhums.learn.wrapper import network_objective as network_objective

_MODULES = {
    "card": "Calibration Card Selection WindowCard",
    "chain": "Scheme TrainingOptions select_features",
    "evaluation": "CommandLeak CommandLeakWarning brier_score calibrate check_command "
    "expected_calibration_error",
    "inference": "Network TanhNetwork WindowNetwork",
    "model": "Answers Model ModelError default_model load_model models packaged_models save_model",
    "networks": "TanhNetworkEnsemble",
    "precedents": "Precedent PrecedentBase PrecedentError Provenance",
    "ranking": "ChiSquareRanking VectorThinning",
    "redundancy": "Dependence PairwiseRedundancyFilter RegressionRedundancyFilter",
    "regression": "NonlinearRegression",
    "wrapper": "SubsetSearch exhaustive_search genetic_search network_objective",
    "trainer": "NetworkOptions Vectors",
    "training": "LabelledWindows NetworkScore TrainingResult train_network train_windows",
}
__getattr__, __dir__, __all__ = lazy_exports(__name__, _MODULES, missing={"sklearn": ("training", "train")})
