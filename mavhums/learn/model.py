"""The model file: a safetensors file of the weights, with the card as JSON in its metadata."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
import safetensors
import safetensors.numpy
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from mavhums.core.arrays import Array, Flags
from mavhums.core.errors import MavhumsError
from mavhums.core.output import written_whole
from mavhums.core.quantities import KEYS, WINDOW_FEATURES
from mavhums.learn.card import Card, WindowCard
from mavhums.learn.inference import Network, WindowNetwork

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
        """The conditions that the network distinguishes, in the order of its probabilities."""
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
