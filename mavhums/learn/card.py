"""The card of a model: what a network is for, and how it came to be."""

from __future__ import annotations

from math import tanh
from typing import Annotated, Final, Literal

from pydantic import Field, JsonValue

from mavhums.core.models import Contract

__all__ = ["FORMAT", "Calibration", "Card", "Selection"]

FORMAT: Final = "mavhums.model/1"

_Text = Annotated[str, Field(min_length=1)]


class Selection(Contract):
    """What the two stages of feature selection found (paper, section 3, figure 15).

    Attributes
    ----------
    chi_square
        Statistic of each quantity, by key.
    p_values
        Of those statistics, by key.
    groups
        Keys that explain one another; a constant quantity is in none.
    selected
        The quantity of each group with the largest statistic, in the order V1…V12.
    """

    chi_square: dict[str, float]
    p_values: dict[str, float]
    groups: tuple[tuple[str, ...], ...]
    selected: tuple[str, ...]


class Calibration(Contract):
    """The probability of an emergency as a logistic function of a window's share of votes for one.

    Attributes
    ----------
    slope, intercept
        Of the log-odds over the share.
    event
        What is probable, in words.
    metrics
        Brier score and expected calibration error of the bare share and of the probability, on
        flights that were neither trained on nor calibrated with; and how many windows there were.
    """

    slope: float
    intercept: float
    event: str = ""
    metrics: dict[str, float] = {}

    def probability(self, share: float) -> float:
        """Return the probability for a share of votes.

        Examples
        --------
        >>> round(Calibration(slope=10.0, intercept=-5.0).probability(0.7), 3)
        0.881
        """
        return 0.5 + 0.5 * tanh((self.slope * share + self.intercept) / 2)


class Card(Contract):
    """Everything about a model but its weights.

    Attributes
    ----------
    format
        Version of the model file.
    name
        Of the model, as verdicts quote it.
    airframe
        Name of the profile whose actuators it was trained for; it meets no others.
    features
        Keys of the network's inputs, in their order.
    tier
        What telemetry the training data are as if from.
    conditions
        Of training: flights, friction levels, options; free, but JSON.
    metrics
        Accuracies and other figures, by name.
    calibration
        Of the votes; None where they are taken as they are.
    selection
        Why these features.
    seed
        From which the training is repeatable.
    command
        That regenerates the file.
    versions
        Of the libraries that trained it, by name.
    """

    format: Literal["mavhums.model/1"] = FORMAT
    name: _Text
    airframe: _Text
    features: Annotated[tuple[_Text, ...], Field(min_length=1)]
    tier: _Text
    conditions: dict[str, JsonValue] = {}
    metrics: dict[str, float] = {}
    calibration: Calibration | None = None
    selection: Selection
    seed: int
    command: _Text
    versions: dict[str, str] = {}
