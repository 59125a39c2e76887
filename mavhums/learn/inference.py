"""Inference with a trained network in numpy alone, for onboard computers without torch."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import exp
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mavhums.core.arrays import Array, Array1, Array2, Flags, Integers, Integers1
from mavhums.core.kernels import kernel
from mavhums.core.quantities import KEYS, WINDOW_KEYS


def unit_interval(values: Array, minimum: Array, maximum: Array) -> Array:
    """Map each feature's minimum to 0 and its maximum to 1; values beyond them are not clipped.

    Parameters
    ----------
    values
        Shape (n, k).
    minimum, maximum
        Range of each feature, shape (k,). A feature with equal minimum and maximum is shifted to 0.

    Returns
    -------
    NDArray
        Shape (n, k), dimensionless.

    Examples
    --------
    >>> import numpy as np
    >>> unit_interval(np.array([[10.0], [15.0], [20.0]]), np.array([10.0]), np.array([20.0])).ravel()
    array([0. , 0.5, 1. ])
    """
    # Half values, because the difference of two large floats of opposite sign overflows.
    span = maximum / 2 - minimum / 2
    scaled: Array = (values / 2 - minimum / 2) / np.where(span > 0, span, 0.5)
    return scaled


_MARGIN = 0.1
"""How far outside the training range an input may lie, as a fraction of that range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TanhNetwork:
    """A network with k inputs, one hidden layer of h tanh neurons, and a linear output for each class.

    Two outputs are the binary neurons of the paper's table 3: the first is the larger for an
    emergency (1, 0), the second for normal operation (0, 1).

    Attributes
    ----------
    minimum, maximum
        Range of each input in the training data, shape (k,); scales inputs onto the unit interval.
    w1, b1
        Weights and biases of the hidden layer, shapes (k, h) and (h,).
    w2, b2
        Weights and biases of the outputs, shapes (h, classes) and (classes,).

    Raises
    ------
    ValueError
        If the shapes do not fit together, a number is not finite, or a minimum exceeds its maximum.
    """

    minimum: Array
    maximum: Array
    w1: Array
    b1: Array
    w2: Array
    b2: Array
    _CLASSES: ClassVar[int | None] = None

    def __post_init__(self) -> None:
        """Store read-only copies of the arrays, and reject invalid ones."""
        inputs, hidden = np.shape(self.minimum)[:1], np.shape(self.b1)[:1]
        classes = np.shape(self.b2)[:1] if self._CLASSES is None else (self._CLASSES,)
        weights = {"w1": inputs + hidden, "b1": hidden, "w2": hidden + classes, "b2": classes}
        if 0 in inputs + hidden:
            raise ValueError("a network needs at least one input and one hidden neuron")
        for name, shape in {"minimum": inputs, "maximum": inputs, **weights}.items():
            array = np.array(getattr(self, name), dtype=np.float64, order="C")
            if array.shape != shape or not shape:
                raise ValueError(f"{name} has the shape {array.shape}, which does not fit the other tensors")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} contains a number that is not finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if (self.minimum > self.maximum).any():
            raise ValueError("a minimum exceeds its maximum")

    @property
    def tensors(self) -> dict[str, Array]:
        """The six arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(TanhNetwork)}

    def within(self, minimum: Array, maximum: Array) -> Self:
        """Return the network of the same outputs whose inputs have another range, shape (k,) each."""
        per_unit = np.diff(unit_interval(np.stack([minimum, maximum]), self.minimum, self.maximum), axis=0)[0]
        shift = unit_interval(minimum[None], self.minimum, self.maximum)[0] @ self.w1
        w1 = per_unit[:, None] * self.w1
        return replace(self, minimum=minimum, maximum=maximum, w1=w1, b1=self.b1 + shift)

    def outputs(self, features: Array) -> Array:
        """Return the outputs for ``features`` of shape (n, k), as shape (n, classes)."""
        hidden = np.tanh(unit_interval(features, self.minimum, self.maximum) @ self.w1 + self.b1)
        outputs: Array = hidden @ self.w2 + self.b2
        return outputs

    def p_first(self, features: Array) -> Array:
        """Return the softmax of the first of two outputs (emergency), shape (n,), within [0, 1]."""
        outputs = self.outputs(features)
        # The softmax of two outputs is a logistic function; this form of it cannot overflow.
        return 0.5 + 0.5 * np.tanh((outputs[:, 0] - outputs[:, 1]) / 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class _ColumnNetwork(TanhNetwork):
    """A network whose inputs are named columns of a table.

    Attributes
    ----------
    keys
        The columns in the order of the inputs, length k.

    Raises
    ------
    ValueError
        As for :class:`TanhNetwork`, or if a key names no column or appears twice.
    """

    keys: tuple[str, ...]
    _TABLE: ClassVar[str]
    _COLUMNS: ClassVar[tuple[str, ...]]
    _UNKNOWN: ClassVar[str]

    def __post_init__(self) -> None:
        """Reject keys that do not name the inputs."""
        super().__post_init__()
        object.__setattr__(self, "keys", tuple(self.keys))
        unknown = [key for key in self.keys if key not in self._COLUMNS]
        if unknown:
            raise ValueError(f"{unknown[0]!r} {self._UNKNOWN}")
        if len(set(self.keys)) != len(self.keys) or len(self.keys) != len(self.minimum):
            raise ValueError(f"{len(self.keys)} keys do not name {len(self.minimum)} inputs, each once")

    def inside(self, table: ArrayLike) -> Flags:
        """Return which rows lie inside the network's training range, slightly widened.

        Parameters
        ----------
        table
            Shape (n, columns); only the columns of ``keys`` are read.

        Returns
        -------
        NDArray
            Shape (n,): True if every input is finite and within the widened range.
        """
        inputs = self.inputs(table)
        low, high = self._envelope
        return np.asarray(((inputs >= low) & (inputs <= high)).all(axis=1))

    @cached_property
    def _places(self) -> Integers:
        return np.array([self._COLUMNS.index(key) for key in self.keys], dtype=np.int64)

    @cached_property
    def _envelope(self) -> tuple[Array, Array]:
        """Lower and upper bound of each input, shape (k,) each."""
        with np.errstate(over="ignore"):
            allowed = _MARGIN * (self.maximum - self.minimum)
            return self.minimum - allowed, self.maximum + allowed

    def _checked(self, table: ArrayLike) -> Array:
        array = np.ascontiguousarray(table, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != len(self._COLUMNS):
            raise ValueError(
                f"{self._TABLE} must have the shape (n, {len(self._COLUMNS)}), not {array.shape}"
            )
        return array

    def inputs(self, table: ArrayLike) -> Array:
        """Return the columns of ``keys``, shape (n, k).

        Raises
        ------
        ValueError
            If the table has another number of columns.
        """
        return self._checked(table)[:, self._places]


@dataclass(frozen=True, kw_only=True, eq=False)
class Network(_ColumnNetwork):
    """A network whose inputs are named quantities out of V1–V12.

    Attributes
    ----------
    keys
        The quantities in the order of the inputs, length k.

    Raises
    ------
    ValueError
        As for :class:`TanhNetwork`, or if a key is none of V1…V12 or appears twice.

    Examples
    --------
    >>> import numpy as np
    >>> network = Network(
    ...     keys=("V5",), minimum=[-1], maximum=[1], w1=[[4.0]], b1=[-2.0], w2=[[3.0, -3.0]], b2=[0.0, 0.0]
    ... )
    >>> values = np.zeros((3, 12))
    >>> values[:, 4] = [-1, 0, 1]
    >>> network.p_emergency(values).round(3)
    array([0.003, 0.5  , 0.997])
    """

    _CLASSES: ClassVar[int | None] = 2
    _TABLE: ClassVar[str] = "values"
    _COLUMNS: ClassVar[tuple[str, ...]] = KEYS
    _UNKNOWN: ClassVar[str] = "is none of V1…V12"

    def p_emergency(self, values: ArrayLike) -> Array:
        """Return the network's probability of an emergency for each sample.

        Parameters
        ----------
        values
            V1…V12, shape (n, 12); only the columns of ``keys`` are read.

        Returns
        -------
        NDArray
            Shape (n,), within [0, 1]; NaN where an input quantity is not finite, or so large that
            the sums overflow.

        Raises
        ------
        ValueError
            If ``values`` has not twelve columns.
        """
        features = self.inputs(values)
        finite: Flags = np.asarray(np.isfinite(features).all(axis=1))
        with np.errstate(over="ignore", invalid="ignore"):
            probability = self.p_first(np.where(finite[:, np.newaxis], features, self.minimum))
        return np.where(finite, probability, np.nan)

    def votes(self, values: ArrayLike) -> NDArray[np.int8]:
        """Return the network's vote on each sample: whether :meth:`p_emergency` exceeds one half.

        Parameters
        ----------
        values
            V1…V12, shape (n, 12).

        Returns
        -------
        NDArray
            Shape (n,): 1 for an emergency, 0 for none, -1 where the sample is not inside.

        Raises
        ------
        ValueError
            If ``values`` has not twelve columns.

        Examples
        --------
        >>> import numpy as np
        >>> network = Network(
        ...     keys=("V5",), minimum=[-1], maximum=[1], w1=[[4.0]], b1=[-2.0], w2=[[3.0, -3.0]], b2=[0, 0]
        ... )
        >>> values = np.zeros((3, 12))
        >>> values[:, 4] = [-1, 0.5, 2]
        >>> network.votes(values)
        array([ 0,  1, -1], dtype=int8)
        """
        low, high = self._envelope
        return np.asarray(vote(self._checked(values), self._places, low, high, *self._in_units))

    @cached_property
    def _in_units(self) -> tuple[Array, Array, Array, float]:
        """Weights, biases, and output difference and threshold for unscaled inputs."""
        half = self.maximum / 2 - self.minimum / 2
        weights = np.ascontiguousarray((self.w1 / np.where(half > 0, 2 * half, 1.0)[:, np.newaxis]).T)
        biases = self.b1 - weights @ self.minimum
        difference = np.ascontiguousarray(self.w2[:, 0] - self.w2[:, 1])
        return weights, biases, difference, float(self.b2[1] - self.b2[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowNetwork(_ColumnNetwork):
    """A network whose inputs are statistics of a window (:data:`mavhums.core.quantities.WINDOW_KEYS`).

    Attributes
    ----------
    keys
        The statistics in the order of the inputs, length k.

    Raises
    ------
    ValueError
        As for :class:`TanhNetwork`, or if a key is not a statistic or appears twice.
    """

    _TABLE: ClassVar[str] = "features"
    _COLUMNS: ClassVar[tuple[str, ...]] = WINDOW_KEYS
    _UNKNOWN: ClassVar[str] = "is not a statistic of a window"

    def probabilities(self, features: ArrayLike) -> Array:
        """Return the probability of each class, shape (n, classes), each row of sum 1.

        Parameters
        ----------
        features
            The windows' statistics, shape (n, len(WINDOW_KEYS)); only the columns of ``keys`` are read. A
            window one of whose inputs is not finite has NaN throughout.
        """
        inputs = self.inputs(features)
        finite: Flags = np.asarray(np.isfinite(inputs).all(axis=1))
        scaled = unit_interval(
            np.where(finite[:, np.newaxis], inputs, self.minimum), self.minimum, self.maximum
        )
        # Sums along an axis, not products of matrices, whose last digits depend on the number of windows.
        hidden = np.tanh((scaled[:, :, np.newaxis] * self.w1).sum(axis=1) + self.b1)
        outputs = (hidden[:, :, np.newaxis] * self.w2).sum(axis=1) + self.b2
        odds = np.exp(outputs - outputs.max(axis=1, keepdims=True))
        return np.where(finite[:, np.newaxis], odds / odds.sum(axis=1, keepdims=True), np.nan)


ABSTAINS = -1


@kernel
def vote(
    values: Array2,
    columns: Integers1,
    low: Array1,
    high: Array1,
    weights: Array2,
    biases: Array1,
    difference: Array1,
    threshold: float,
) -> NDArray[np.int8]:
    """Return 1 for an emergency, 0 for none, -1 for a sample outside ``low`` … ``high``, shape (n,).

    Parameters
    ----------
    values
        V1…V12, shape (n, 12).
    columns
        Columns of the network's k inputs in ``values``.
    low, high
        Bounds of each input, shape (k,).
    weights, biases
        Weights and biases of the h hidden neurons for unscaled inputs, shapes (h, k) and (h,).
    difference, threshold
        Output weights, first minus second, shape (h,), and the threshold for their sum.
    """
    n, k, h = len(values), len(columns), len(biases)
    votes = np.empty(n, dtype=np.int8)
    inputs = np.empty(k)
    for i in range(n):
        inside = True
        for j in range(k):
            x = values[i, columns[j]]
            if not low[j] <= x <= high[j]:
                inside = False
                break
            inputs[j] = x
        if not inside:
            votes[i] = ABSTAINS
            continue
        sum_ = -threshold
        for m in range(h):
            inner = biases[m]
            for j in range(k):
                inner += weights[m, j] * inputs[j]
            # tanh by the exponential is three times as fast; overflow gives infinity, which is correct here.
            sum_ += difference[m] * (1.0 - 2.0 / (exp(2.0 * inner) + 1.0))
        votes[i] = 1 if sum_ > 0.0 else 0
    return votes
