"""The model card: a network's purpose, inputs, how they were selected, training conditions and metrics."""

from __future__ import annotations

from math import tanh
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, JsonValue

from mavhums.core.models import Contract


class ExcludedQuantity(Contract):
    """A quantity that Algorithm 1 explains by others.

    Attributes
    ----------
    quantity
        Its key.
    r2
        R² of the regression.
    expression
        The regression as a formula.
    """

    quantity: str
    r2: float
    expression: str


class Thinned(Contract):
    """Vectors before and after those that resemble others were removed."""

    offered: int
    kept: int


Search = Literal["exhaustive", "genetic", "elimination"]


class Wrapped(Contract):
    """The search of the subset of quantities whose networks are best.

    Attributes
    ----------
    search
        All subsets; some of them by a genetic algorithm; or all quantities, and one less at each step.
    tried, possible
        Number of subsets scored, and of all.
    accuracy
        Accuracy of the chosen subset's best network on the samples held out, within [0, 1].
    accuracy_of_all
        The same with all quantities that were searched.
    costs
        How much the mean cross-entropy on the vectors held out rises when an input's values are shuffled
        among them, by key.
    """

    search: Search
    tried: int
    possible: int
    accuracy: float
    accuracy_of_all: float
    costs: dict[str, float] = {}


class Selection(Contract):
    """Result of the stages from the quantities to a network's inputs (paper, sections 2 and 3).

    Attributes
    ----------
    chi_square
        Statistic of each quantity, by key.
    p_values
        Of those statistics, by key.
    groups
        Keys that explain one another; a constant quantity is in none.
    selected
        The quantities that the filter kept, in the order V1…V12. The wrapper chooses the inputs of
        the network among them.
    filter
        Description of the filter that formed the groups.
    excluded
        The quantities that Algorithm 1 excluded, in the order of their exclusion.
    thinned, wrapped
        Results of the later stages; None for a stage that was left out.
    """

    chi_square: dict[str, float]
    p_values: dict[str, float]
    groups: tuple[tuple[str, ...], ...]
    selected: tuple[str, ...]
    filter: str = ""
    excluded: tuple[ExcludedQuantity, ...] = ()
    thinned: Thinned | None = None
    wrapped: Wrapped | None = None

    def chosen(self, mask: ArrayLike) -> tuple[str, ...]:
        """Return those of :attr:`selected` that a mask of the same length chooses."""
        return tuple(key for key, used in zip(self.selected, np.asarray(mask).tolist(), strict=True) if used)

    def stage_lines(self, inputs: tuple[str, ...] = ()) -> list[str]:
        """Return a line for each stage.

        Parameters
        ----------
        inputs
            The network's inputs, which the wrapper chose; its line needs them.

        Examples
        --------
        >>> found = Selection(
        ...     chi_square={"V5": 90.0, "V8": 80.0}, p_values={"V5": 0.0, "V8": 1e-9},
        ...     groups=(("V5", "V8"),), selected=("V5",), filter="R² ≥ 0.99",
        ...     excluded=(ExcludedQuantity(quantity="V8", r2=0.9999, expression="V8 = 0.02·V5"),),
        ... )
        >>> for line in found.stage_lines():
        ...     print(line)
        chi-square: V5 90 (p 0), V8 80 (p 1e-09)
        filter: R² ≥ 0.99; keeps V5
          drops V8 = 0.02·V5 (R² 0.99990)
        """
        ranked = sorted(self.chi_square.items(), key=lambda item: -item[1])
        of = (f"{key} {score:.4g} (p {self.p_values.get(key, 0):.1g})" for key, score in ranked)
        lines = [f"chi-square: {', '.join(of)}"]
        if self.filter:
            lines.append(f"filter: {self.filter}; keeps {' '.join(self.selected)}")
            lines += [f"  drops {each.expression} (R² {each.r2:.5f})" for each in self.excluded]
            silent = {key for key in self.chi_square if not any(key in group for group in self.groups)}
            lines += [f"  drops {key}: constant" for key in sorted(silent)]
            known = silent | {each.quantity for each in self.excluded} | set(self.selected)
            for group in self.groups:
                dropped = [key for key in group if key not in known]
                kept = [key for key in group if key in self.selected]
                lines += [f"  drops {' '.join(dropped)}: explained by {' '.join(kept)}"] if dropped else []
        if self.thinned:
            lines.append(f"thinning: {self.thinned.kept} of {self.thinned.offered} vectors represent all")
        if self.wrapped and inputs:
            lines.append(self._wrapper(self.wrapped, inputs))
        return lines

    def _wrapper(self, wrapped: Wrapped, inputs: tuple[str, ...]) -> str:
        dropped = " ".join(key for key in self.selected if key not in inputs)
        cheapest = min(wrapped.costs.items(), key=lambda item: item[1], default=None)
        cost = (
            f"; shuffled, {cheapest[0]} raises the loss by {cheapest[1]:.4f}, the least" if cheapest else ""
        )
        kept = (
            f"keeps {' '.join(inputs)}, the fewest within a standard error of the best, "
            f"and drops {dropped or 'nothing'}"
        )
        return (
            f"wrapper: {wrapped.tried} of {wrapped.possible} subsets tried ({wrapped.search}); {kept}: "
            f"{100 * wrapped.accuracy:.2f} % of the samples held out, with all "
            f"{100 * wrapped.accuracy_of_all:.2f} %{cost}"
        )


FORMAT: Final = "mavhums.model/1"
_Text = Annotated[str, Field(min_length=1)]


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
        The conditions that it distinguishes, in the order of its probabilities.
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
        The paper's two classes, in the order of the network's probabilities.
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
        Command that regenerates the file, with the same versions and instructions.
    versions
        Versions of the libraries used for training, by name, and the processor's vector instructions.
    """

    format: Literal["mavhums.model/1"] = FORMAT
    name: _Text
    airframe: _Text
    features: Annotated[tuple[_Text, ...], Field(min_length=1)]
    classes: tuple[Literal["normal"], Literal["emergency"]] = ("normal", "emergency")
    tier: _Text
    conditions: dict[str, JsonValue] = {}
    metrics: dict[str, float] = {}
    calibration: Calibration | None = None
    selection: Selection
    window: WindowCard | None = None
    seed: int
    command: _Text
    versions: dict[str, str] = {}
