"""The model card: a network's purpose, inputs, training conditions and metrics."""

from __future__ import annotations

from math import tanh
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, JsonValue

from mavhums.core.models import Contract
from mavhums.learn.selection import Selection

__all__ = ["CLASSES", "FORMAT", "Calibration", "Card", "Selection", "WindowCard"]

FORMAT: Final = "mavhums.model/1"
CLASSES: Final = ("normal", "emergency")
"""The paper's two classes, by rising severity."""

_Text = Annotated[str, Field(min_length=1)]


def _told_apart(classes: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(classes)) != len(classes) or not set(CLASSES) <= set(classes):
        raise ValueError("classes must be distinct, normal and emergency among them")
    return classes


class Calibration(Contract):
    """The probability of an emergency as a logistic function of a window's share of votes for one.

    Attributes
    ----------
    slope, intercept
        Coefficients of the log-odds as a linear function of the share.
    event
        Description of the event whose probability this is.
    metrics
        Brier score and expected calibration error of the raw share and of the probability, on
        flights used neither for training nor for calibration; and the number of windows.
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


class WindowCard(Contract):
    """The network of windows: what it knows, how it was chosen, and what it says on flights of their own.

    Attributes
    ----------
    features
        Keys of its inputs, statistics of a window, in order.
    classes
        The conditions that it tells apart, in the order of its probabilities.
    decides_at
        The least probability with which the most probable condition is a decision; below it abstains.
    conditions
        Training conditions: flights, severities; any JSON.
    metrics
        Accuracies and other metrics on flights that nothing was trained on, by name.
    confusion
        Number of windows of those flights: condition flown, then condition decided, or ``abstained``.
    selection
        Result of the stages.
    """

    features: Annotated[tuple[_Text, ...], Field(min_length=1)]
    classes: Annotated[tuple[_Text, ...], Field(min_length=2)]
    decides_at: Annotated[float, Field(ge=0, le=1)] = 0.5
    conditions: dict[str, JsonValue] = {}
    metrics: dict[str, float] = {}
    confusion: dict[str, dict[str, int]] = {}
    selection: Selection


class Card(Contract):
    """All metadata of a model, without its weights.

    Attributes
    ----------
    format
        Version of the model file.
    name
        Name of the model, as verdicts quote it.
    airframe
        Name of the profile whose actuators the model was trained for; it is applied to no others.
    features
        Keys of the network's inputs, in order.
    classes
        The conditions that the network tells apart, in the order of its probabilities.
    tier
        Telemetry tier of the training data.
    conditions
        Training conditions: flights, friction levels, options; any JSON.
    metrics
        Accuracies and other metrics, by name.
    calibration
        Calibration of the share of votes; None if the share is used uncalibrated.
    selection
        Result of feature selection.
    window
        The network of windows; None if the model has none.
    seed
        Random seed; it makes training repeatable.
    command
        Command that regenerates the file.
    versions
        Versions of the libraries used for training, by name.
    """

    format: Literal["mavhums.model/1"] = FORMAT
    name: _Text
    airframe: _Text
    features: Annotated[tuple[_Text, ...], Field(min_length=1)]
    classes: Annotated[tuple[_Text, ...], AfterValidator(_told_apart)] = CLASSES
    tier: _Text
    conditions: dict[str, JsonValue] = {}
    metrics: dict[str, float] = {}
    calibration: Calibration | None = None
    selection: Selection
    window: WindowCard | None = None
    seed: int
    command: _Text
    versions: dict[str, str] = {}
