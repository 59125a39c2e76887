"""Learning: feature ranking and selection, the network, its training and its model file.

Nothing is imported before it is used: a computer on board that only loads a model and asks it
needs neither scikit-learn nor torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mavhums.errors import MissingExtraError

if TYPE_CHECKING:
    from mavhums.learn.card import Card, Selection
    from mavhums.learn.inference import Network, TanhNetwork
    from mavhums.learn.model import Model, ModelError, default_model, load_model, save_model
    from mavhums.learn.network import TanhNetworkClassifier
    from mavhums.learn.ranking import ChiSquareRanking
    from mavhums.learn.redundancy import PairwiseRedundancyFilter
    from mavhums.learn.training import Candidate, TrainingResult, select_features, train_network

__all__ = [
    "Candidate",
    "Card",
    "ChiSquareRanking",
    "Model",
    "ModelError",
    "Network",
    "PairwiseRedundancyFilter",
    "Selection",
    "TanhNetwork",
    "TanhNetworkClassifier",
    "TrainingResult",
    "default_model",
    "load_model",
    "save_model",
    "select_features",
    "train_network",
]

_MODULES = {
    "card": ("Card", "Selection"),
    "inference": ("Network", "TanhNetwork"),
    "model": ("Model", "ModelError", "default_model", "load_model", "save_model"),
    "network": ("TanhNetworkClassifier",),
    "ranking": ("ChiSquareRanking",),
    "redundancy": ("PairwiseRedundancyFilter",),
    "training": ("Candidate", "TrainingResult", "select_features", "train_network"),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        module = import_module(f"{__name__}.{_HOME[name]}")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "sklearn":
            raise
        raise MissingExtraError("training", "train") from error
    value = getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
