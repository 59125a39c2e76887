"""The model file: a safetensors file of the weights, with the card as JSON in its metadata.

The card has a network's purpose, inputs, how they were selected, training conditions and metrics.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from importlib import resources
from math import tanh
from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field, JsonValue, ValidationError

from mavhums.core.arrays import Array, Flags
from mavhums.core.errors import MavhumsError
from mavhums.core.models import Contract
from mavhums.core.output import written_whole
from mavhums.core.quantities import KEYS, WINDOW_FEATURES
from mavhums.learn.inference import Network, WindowNetwork


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


class Wrapped(Contract):
    """The search of the subset of quantities whose networks are best.

    Attributes
    ----------
    search
        All subsets; some of them by a genetic algorithm; or all quantities, and one less at each step.
    tried, possible
        Number of subsets scored, and of all.
    accuracy
        Accuracy of the best subset's networks on the samples held out, within [0, 1].
    accuracy_of_all
        The same with all quantities that were searched.
    costs
        How much the mean cross-entropy on the vectors held out rises when an input's values are shuffled
        among them, by key.
    """

    search: Literal["exhaustive", "genetic", "elimination"]
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
        Command that regenerates the file, with the same versions and instructions.
    versions
        Versions of the libraries used for training, by name, and the processor's vector instructions.
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


_CARD_KEY = "mavhums.card"
_PACKAGED = ("paper-instrumented", "paper-without-load", "paper-esc")
_LARGEST = 16 * 2**20
_TENSORS = frozenset({"minimum", "maximum", "w1", "b1", "w2", "b2"})
_WINDOW = "window."
"""Before the names of the tensors of the network of windows."""
FRICTION_EMERGENCY = "friction_emergency"
"""The class of windows that is an emergency by friction."""
_REMEDY = "train one with `mavhums train -o MODEL`"


class ModelError(MavhumsError):
    """A model file is missing, damaged, or not supported by this version."""


class Answers(NamedTuple):
    """A model's answers for n samples.

    Attributes
    ----------
    probabilities
        Shape (n, classes), in the order of :attr:`Model.classes`, each row of sum 1; NaN where an
        input quantity is not finite.
    inside
        Whether the sample lies within the range of the training data, slightly widened, shape (n,).
        Outside it the network abstains, whatever its probabilities.
    """

    probabilities: Array
    inside: Flags


@dataclass(frozen=True, eq=False)
class Model:
    """A network of samples, its card, the SHA-256 of its file in hexadecimal, and the network of windows."""

    network: Network
    card: Card
    hash: str
    window: WindowNetwork | None = None

    @property
    def keys(self) -> tuple[str, ...]:
        """The network's input quantities."""
        return self.network.keys

    @property
    def classes(self) -> tuple[str, ...]:
        """The conditions that the network tells apart, in the order of its probabilities."""
        return self.card.classes

    @property
    def emergency(self) -> int:
        """Index in :attr:`classes` of the condition that is an emergency by friction."""
        return self.classes.index("emergency")

    def classify(self, values: ArrayLike) -> Answers:
        """Return the probability of each class, and whether the network may be asked, for each sample.

        Parameters
        ----------
        values
            V1…V12, shape (n, 12); only the columns of :attr:`keys` are read.

        Raises
        ------
        ValueError
            If ``values`` has not twelve columns.
        """
        second = self.network.p_emergency(values)
        return Answers(np.column_stack([1 - second, second]), self.network.inside(values))

    @property
    def window_classes(self) -> tuple[str, ...]:
        """The conditions of windows, in the order of their probabilities; empty without such a network."""
        return self.card.window.classes if self.window and self.card.window else ()

    @property
    def window_quantities(self) -> tuple[str, ...]:
        """The quantities of whose statistics the network of windows knows; empty without one."""
        keys = self.window.keys if self.window else ()
        needed = {quantity for key in keys for quantity in WINDOW_FEATURES[key]}
        return tuple(key for key in KEYS if key in needed)

    @property
    def window_level(self) -> float:
        """Probability from which a window is decided; 1 without a network of windows."""
        return self.card.window.decides_at if self.card.window else 1.0

    def classify_windows(self, features: ArrayLike) -> Answers:
        """Return the calibrated probability of each condition for each window, and whether it may be asked.

        Parameters
        ----------
        features
            The windows' statistics, shape (n, features), as
            :func:`mavhums.core.quantities.window_features` returns them.

        Returns
        -------
        Answers
            Probabilities in the order of :attr:`window_classes`; a window of which a statistic is missing
            has NaN, and is not inside.

        Raises
        ------
        ValueError
            If the model has no network of windows, or the shape is another.
        """
        if self.window is None:
            raise ValueError("the model has no network of windows")
        return Answers(self.window.probabilities(features), self.window.inside(features))

    def votes(self, values: Array) -> NDArray[np.int8]:
        """Return the vote on each sample, as :meth:`Network.votes` does."""
        return self.network.votes(values)

    def probability(self, share: float) -> float:
        """Return the probability of an emergency for a share of votes; the share if not calibrated."""
        calibration = self.card.calibration
        return share if calibration is None else calibration.probability(share)


def save_model(path: str | Path, network: Network, card: Card, window: WindowNetwork | None = None) -> Model:
    """Write a model file; the same networks and card give the same bytes.

    The file appears whole or not at all: it is written beside its place and then moved there.

    Raises
    ------
    ModelError
        If the file cannot be written.
    ValueError
        If the card names other features than a network.
    """
    if card.features != network.keys:
        raise ValueError(f"the card names the features {card.features}, the network {network.keys}")
    named = window.keys if window else None
    if (card.window.features if card.window else None) != named:
        raise ValueError(f"the card's features of windows are not the network's, {named}")
    tensors = network.tensors
    if window:
        tensors |= {_WINDOW + name: tensor for name, tensor in window.tensors.items()}
    data = safetensors.numpy.save(tensors, metadata={_CARD_KEY: card.model_dump_json()})
    with written_whole(path, error=ModelError, remedy="name a folder that exists") as temporary:
        temporary.write_bytes(data)
    return Model(network, card, hashlib.sha256(data).hexdigest(), window)


def models() -> tuple[str, ...]:
    """Return the names of the packaged models; the one that needs the most telemetry comes first.

    Examples
    --------
    >>> models()
    ('paper-instrumented', 'paper-without-load', 'paper-esc')
    """
    return _PACKAGED


def load_model(name_or_path: str | Path) -> Model:
    """Load a packaged model by name, or a model file by path.

    Raises
    ------
    ModelError
        If there is no such model, or its file is damaged, of another version, or holds no network over
        V1–V12.

    Examples
    --------
    >>> load_model("paper-esc").keys
    ('V1', 'V5', 'V7')
    >>> load_model("paper-ecs")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    mavhums.learn.model.ModelError: paper-ecs: no readable model file, and no packaged model: name one of ...
    """
    name = str(name_or_path)
    if name in _PACKAGED:
        return _packaged(name)
    try:
        with Path(name_or_path).open("rb") as file:
            data = file.read(_LARGEST + 1)
    except (OSError, ValueError) as error:
        remedy = f"name one of {', '.join(_PACKAGED)}, or {_REMEDY}"
        raise ModelError(f"{name}: no readable model file, and no packaged model", remedy) from error
    return _parse(data, name)


def default_model() -> Model:
    """Return the packaged model for all twelve quantities: the first of :func:`packaged_models`.

    Raises
    ------
    ModelError
        If the installation lacks it.
    """
    return _packaged(_PACKAGED[0])


def packaged_models() -> tuple[Model, ...]:
    """Return the models packaged with mavhums; the one that needs the most telemetry comes first.

    Raises
    ------
    ModelError
        If the installation lacks one.

    Examples
    --------
    >>> [model.card.name for model in packaged_models()]
    ['paper-instrumented', 'paper-without-load', 'paper-esc']
    """
    return tuple(_packaged(name) for name in _PACKAGED)


def _packaged(name: str) -> Model:
    file = f"models/{name}.safetensors"
    try:
        data = resources.files("mavhums.learn").joinpath(file).read_bytes()
    except OSError as error:
        raise ModelError(f"the packaged model {file} is missing", "reinstall mavhums") from error
    return _parse(data, file)


def _parse(data: bytes, source: str) -> Model:
    if len(data) > _LARGEST:
        raise ModelError(f"{source}: larger than any model ({_LARGEST // 2**20} MiB)", _REMEDY)
    try:
        entries = safetensors.deserialize(data)  # type: ignore[no-untyped-call]
    except safetensors.SafetensorError as error:
        raise ModelError(f"{source}: not a whole safetensors file", f"copy it again or {_REMEDY}") from error
    card = _card(data, source)
    tensors = {}
    for name, entry in entries:
        if entry["dtype"] != "F64":
            raise ModelError(f"{source}: tensor {name} is not of 64-bit floats", _REMEDY)
        tensors[name] = np.frombuffer(entry["data"], dtype="<f8").reshape(entry["shape"]).astype(np.float64)
    wanted = _TENSORS | ({_WINDOW + name for name in _TENSORS} if card.window else set())
    if tensors.keys() != wanted:
        raise ModelError(f"{source}: contains other tensors than {', '.join(sorted(wanted))}", _REMEDY)
    try:
        network = Network(keys=card.features, **{name: tensors[name] for name in _TENSORS})
        window = _window(card.window, tensors) if card.window else None
    except ValueError as error:
        raise ModelError(f"{source}: {error}", _REMEDY) from error
    return Model(network, card, hashlib.sha256(data).hexdigest(), window)


def _window(card: WindowCard, tensors: dict[str, Array]) -> WindowNetwork:
    network = WindowNetwork(keys=card.features, **{name: tensors[_WINDOW + name] for name in _TENSORS})
    if len(network.b2) != len(card.classes):
        raise ValueError(f"{len(card.classes)} classes do not name {len(network.b2)} outputs")
    return network


def _card(data: bytes, source: str) -> Card:
    # safetensors returns no metadata for bytes; it has already validated this header.
    length = int.from_bytes(data[:8], "little")
    metadata = json.loads(data[8 : 8 + length]).get("__metadata__") or {}
    if _CARD_KEY not in metadata:
        raise ModelError(f"{source}: has no card, so it is no model of mavhums", _REMEDY)
    try:
        return Card.model_validate_json(metadata[_CARD_KEY])
    except ValidationError as error:
        first = error.errors(include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "card"
        remedy = "use the mavhums that wrote it" if place == "format" else _REMEDY
        raise ModelError(f"{source}: {place}: {first['msg']}", remedy) from error
