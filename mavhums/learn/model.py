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

from mavhums.core.errors import MavhumsError
from mavhums.core.files import written_whole
from mavhums.learn.card import Card
from mavhums.learn.inference import Network

__all__ = [
    "Answers",
    "Model",
    "ModelError",
    "default_model",
    "load_model",
    "models",
    "packaged_models",
    "save_model",
]

_CARD_KEY = "mavhums.card"
_PACKAGED = ("paper-instrumented", "paper-without-load", "paper-esc")
_LARGEST = 16 * 2**20
_TENSORS = frozenset({"minimum", "maximum", "w1", "b1", "w2", "b2"})
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

    probabilities: NDArray[np.float64]
    inside: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Model:
    """A network, its card, and the SHA-256 of its file in hexadecimal."""

    network: Network
    card: Card
    hash: str

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

    def votes(self, values: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return the vote on each sample, as :meth:`Network.votes` does."""
        return self.network.votes(values)

    def probability(self, share: float) -> float:
        """Return the probability of an emergency for a share of votes; the share if not calibrated."""
        calibration = self.card.calibration
        return share if calibration is None else calibration.probability(share)


def save_model(path: str | Path, network: Network, card: Card) -> Model:
    """Write a model file; the same network and card give the same bytes.

    The file appears whole or not at all: it is written beside its place and then moved there.

    Raises
    ------
    ModelError
        If the file cannot be written.
    ValueError
        If the card names other features than the network.
    """
    if card.features != network.keys:
        raise ValueError(f"the card names the features {card.features}, the network {network.keys}")
    data = safetensors.numpy.save(network.tensors, metadata={_CARD_KEY: card.model_dump_json()})
    with written_whole(path, error=ModelError, remedy="name a folder that exists") as temporary:
        temporary.write_bytes(data)
    return Model(network, card, hashlib.sha256(data).hexdigest())


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
    ('V5', 'V7')
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
        tensors[name] = _array(entry["data"], entry["shape"])
    if tensors.keys() != _TENSORS:
        raise ModelError(f"{source}: holds other tensors than {', '.join(sorted(_TENSORS))}", _REMEDY)
    try:
        network = Network(keys=card.features, **tensors)
    except ValueError as error:
        raise ModelError(f"{source}: {error}", _REMEDY) from error
    return Model(network, card, hashlib.sha256(data).hexdigest())


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


def _array(data: bytes | bytearray, shape: list[int]) -> NDArray[np.float64]:
    return np.frombuffer(data, dtype="<f8").reshape(shape).astype(np.float64)
