"""Training of tanh networks by L-BFGS, and the paper's fifty as a scikit-learn classifier (section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult, minimize
from sklearn.base import ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.multiclass import type_of_target
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data
from threadpoolctl import threadpool_limits

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.learn.inference import TanhNetwork, unit_interval
from mavhums.learn.ranking import LabelledEstimator, check_positive_integers

_MEMORY = 12
_TOLERANCE = 1e-5
"""A network has converged when its largest gradient component is below this."""
_LOOK_EVERY = 10
"""Iterations between two looks at the validation samples."""

Samples = tuple[Array, Flags]
"""Features, shape (n, k), and whether each sample is an emergency, (n,), or of each class, (n, classes)."""


@dataclass(frozen=True, eq=False)
class Examples:
    """Samples as columns: features on the unit interval above a row of ones, classes, and shares of all."""

    features: Array
    target: Array
    share: Array

    @classmethod
    def of(cls, scaled: Array, target: Flags, weight: Array | None = None) -> Examples:
        """Convert scaled features (n, k), classes as in :data:`Samples`, and weights (n,)."""
        weight = np.ones(len(scaled)) if weight is None else weight
        classes = np.stack([target, ~target]) if target.ndim == 1 else target.T
        features = np.vstack([scaled.T, np.ones(len(scaled))])
        return cls(features, classes.astype(np.float64), weight / weight.sum())

    def of_features(self, seen: Flags) -> Examples:
        """Return the samples with some of the rows of features alone."""
        return replace(self, features=self.features[seen])


class NetworkLoss:
    """Loss of one network and its gradient, as functions of its weights: W and V, each with its biases.

    Parameters
    ----------
    hidden
        Number of hidden neurons.
    examples
        The training samples.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean cross-entropy.
    """

    def __init__(self, hidden: int, examples: Examples, weight_decay: float) -> None:
        self._examples, self._target = examples, examples.target * examples.share
        self._shapes = (hidden, len(examples.features)), (len(examples.target), hidden + 1)
        penalties = [np.full(shape, weight_decay) for shape in self._shapes]
        for penalty in penalties:
            penalty[:, -1] = 0.0
        self._penalty = np.concatenate([penalty.ravel() for penalty in penalties])

    def initial(self, seed: int) -> Array:
        """Draw Glorot's uniform weights."""
        draw = np.random.default_rng(seed)
        (hidden, inputs), (classes, _) = self._shapes
        widths = (6 / (inputs + hidden)) ** 0.5, (6 / (hidden + classes)) ** 0.5
        parts = zip(widths, self._shapes, strict=True)
        return np.concatenate([width * draw.uniform(-1, 1, shape).ravel() for width, shape in parts])

    def split(self, weights: Array) -> tuple[Array, Array]:
        """Return W, shape (h, k + 1), and V, shape (classes, h + 1); the last columns are the biases."""
        first, second = self._shapes
        size = first[0] * first[1]
        return weights[:size].reshape(first), weights[size:].reshape(second)

    def __call__(self, weights: Array) -> tuple[float, Array]:
        """Return the loss and its gradient."""
        w, v = self.split(weights)
        features, share = self._examples.features, self._examples.share
        hidden, logits = _forward(w, v, features)
        logits -= logits.max(axis=0)
        slope = np.exp(logits)
        total = slope.sum(axis=0)
        loss = float(np.log(total) @ share) - float(np.vdot(self._target, logits))
        slope *= share / total
        slope -= self._target
        of_v = np.column_stack([slope @ hidden.T, slope.sum(axis=1)])
        inner = (v[:, :-1].T @ slope) * (1 - hidden * hidden)
        decay = self._penalty * weights
        return loss + float(decay @ weights) / 2, np.append(inner @ features.T, of_v) + decay

    def scores(self, weights: Array, examples: Examples) -> tuple[float, float]:
        """Return the mean cross-entropy without decay, and the share of samples that are classified right."""
        logits = _forward(*self.split(weights), examples.features)[1]
        right = logits.argmax(axis=0) == examples.target.argmax(axis=0)
        losses = np.logaddexp.reduce(logits, axis=0) - (logits * examples.target).sum(axis=0)
        return float(losses @ examples.share), float(right.mean())


def _forward(w: Array, v: Array, features: Array) -> tuple[Array, Array]:
    hidden = np.tanh(w @ features)
    return hidden, v[:, :-1] @ hidden + v[:, -1:]


class _Best:
    """The weights with the smallest validation loss so far; stops ``patience`` iterations after them."""

    def __init__(self, loss: NetworkLoss, validation: Examples, patience: int) -> None:
        self.weights = np.empty(0)
        self._of, self._validation, self._patience = loss, validation, patience
        self._loss, self._at, self._iteration = np.inf, 0, 0

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        self._iteration += 1
        if self._iteration % _LOOK_EVERY == 0:
            self.look(intermediate_result.x)
            if self._iteration - self._at >= self._patience:
                raise StopIteration

    def look(self, weights: Array) -> None:
        loss = self._of.scores(weights, self._validation)[0]
        if loss < self._loss:
            self.weights, self._loss, self._at = weights.copy(), loss, self._iteration


@dataclass(frozen=True, eq=False)
class Trained:
    """Trained networks, and arrays with a value of each.

    Attributes
    ----------
    loss
        Mean cross-entropy over the training samples.
    iterations
        Iterations of L-BFGS.
    validation_loss, validation_accuracy
        Loss and accuracy on the validation samples; NaN without validation samples.
    """

    networks: tuple[TanhNetwork, ...]
    loss: Array
    iterations: Integers
    validation_loss: Array
    validation_accuracy: Array


def train_networks(
    hidden: Sequence[int],
    seeds: Sequence[int],
    samples: Samples,
    subsets: Flags | None = None,
    *,
    weight: Array | None = None,
    validation: Samples | None = None,
    bounds: tuple[Array, Array] | None = None,
    beyond: float = 0.0,
    weight_decay: float = 1e-4,
    max_iter: int = 200,
    patience: int | None = 50,
    n_jobs: int | None = None,
) -> Trained:
    """Train networks on all features, or each on its own of ``subsets``, shape (networks, features).

    Parameters
    ----------
    hidden, seeds
        Hidden neurons of each network, and the seed of its initial weights.
    samples, validation
        Features, shape (n, k), and whether each sample is an emergency, shape (n,), or of each of
        several classes, shape (n, classes).
    weight
        Weight of each sample, not negative, shape (n,).
    bounds
        Minimum and maximum of each feature, shape (k,) each, which become 0 and 1; None takes those of the
        samples with nonzero weight.
    beyond
        Share of each feature's values that lie below 0, and above 1, while the networks learn: a few wild
        values would leave the others next to nothing of the interval. The networks have the ``bounds``.
    max_iter, weight_decay
        L-BFGS uses all samples in each iteration.
    patience
        Early stopping: a network stops after this many iterations without a smaller validation
        loss, and its best weights are restored; None disables early stopping.
    n_jobs
        Number of threads, as in joblib; each trains its own networks. The result does not depend
        on it.
    """
    used = samples[0] if weight is None else samples[0][weight > 0]
    minimum, maximum = bounds or (used.min(axis=0), used.max(axis=0))
    low, high = np.quantile(used, [beyond, 1.0 - beyond], axis=0) if beyond else (minimum, maximum)
    examples = Examples.of(unit_interval(samples[0], low, high), samples[1], weight)
    held_out = validation and Examples.of(unit_interval(validation[0], low, high), validation[1])
    if subsets is None:
        subsets = np.ones((len(hidden), len(low)), dtype=bool)

    def train(neurons: int, seed: int, subset: Flags) -> tuple[TanhNetwork, float, int, float, float]:
        seen = np.append(subset, True)
        own, checked = examples.of_features(seen), held_out and held_out.of_features(seen)
        loss = NetworkLoss(neurons, own, weight_decay)
        best = None if checked is None or patience is None else _Best(loss, checked, patience)
        options: Any = {
            "maxiter": max_iter,
            "maxcor": _MEMORY,
            "gtol": _TOLERANCE,
            "ftol": 0.0,
            "maxfun": np.inf,
        }
        found = minimize(
            loss, loss.initial(seed), jac=True, method="L-BFGS-B", callback=best, options=options
        )
        weights = found.x
        if best is not None:
            best.look(weights)
            weights = best.weights
        w, v = loss.split(weights)
        w1 = np.zeros((len(seen), neurons))
        w1[seen] = w.T
        network = TanhNetwork(
            minimum=low, maximum=high, w1=w1[:-1], b1=w1[-1], w2=v[:, :-1].T, b2=v[:, -1]
        ).within(minimum, maximum)
        unknown = np.nan, np.nan
        return (
            network,
            loss.scores(weights, own)[0],
            found.nit,
            *(unknown if checked is None else loss.scores(weights, checked)),
        )

    # One thread: the sums do not depend on the cores, and the threads of several networks hinder no other.
    with threadpool_limits(1):
        done = Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(train)(*one) for one in zip(hidden, seeds, subsets, strict=True)
        )
    networks, *figures = zip(*done, strict=True)
    return Trained(networks, *map(np.array, figures))


class TanhNetworkEnsemble(ClassifierMixin, LabelledEstimator):
    """Many k-h-2 networks with tanh neurons for two classes.

    The networks differ in their hidden neurons and initial weights. The ensemble's probability is
    the mean of theirs; their spread measures how much the result depends on the initial weights.
    Labels are coded as in the paper's table 3; features are scaled onto the unit interval.

    Parameters
    ----------
    n_networks
        Number of networks; the paper trains 50, and 1 gives a single one.
    hidden
        Numbers of hidden neurons; the networks cycle through them.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean
        cross-entropy. Without decay the decision boundary overfits the training data.
    max_iter
        Maximum number of L-BFGS iterations.
    patience
        Early stopping: a network stops after this many iterations without a smaller loss on the
        validation samples given to :meth:`fit`; None uses them only for :attr:`best_`.
    n_jobs
        Number of threads, as in joblib; the result does not depend on it.
    random_state
        Seed, generator or None, for the initial weights.

    Attributes
    ----------
    classes_
        The two classes, sorted.
    networks_
        The trained networks, numpy only.
    losses_, n_iter_
        Each network's mean cross-entropy over the training samples, and its number of iterations,
        shape (n_networks,).
    validation_losses_, validation_accuracies_
        Each network's validation loss and accuracy, shape (n_networks,); NaN without validation
        samples.
    best_
        Index of the network with the smallest validation loss (without validation samples, with
        the smallest training loss).
    n_features_in_
        Number of features seen by :meth:`fit`.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 5, tables 3 to 5.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    >>> ensemble = TanhNetworkEnsemble(n_networks=8, random_state=0).fit(corners, [0, 1, 1, 0])
    >>> ensemble.predict(corners)
    array([0, 1, 1, 0])
    >>> ensemble.spread(corners).shape
    (4,)
    """

    classes_: NDArray[Any]
    networks_: tuple[TanhNetwork, ...]
    losses_: Array
    n_iter_: Integers
    validation_losses_: Array
    validation_accuracies_: Array
    best_: int

    def __init__(
        self,
        n_networks: int = 50,
        hidden: Sequence[int] = tuple(range(4, 17)),
        *,
        weight_decay: float = 1e-4,
        max_iter: int = 200,
        patience: int | None = 50,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_networks = n_networks
        self.hidden = hidden
        self.weight_decay = weight_decay
        self.max_iter = max_iter
        self.patience = patience
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        *,
        validation: tuple[ArrayLike, ArrayLike] | None = None,
    ) -> TanhNetworkEnsemble:
        """Train the networks.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            One of two classes for each sample, shape (n_samples,).
        sample_weight
            Sample weights, not negative, shape (n_samples,).
        validation
            Samples of other flights and their classes, used for early stopping and for the choice
            of the best network, not for training.

        Raises
        ------
        ValueError
            If a parameter or the data are not as described.
        """
        check_positive_integers(
            self, "max_iter", "n_networks", *(() if self.patience is None else ("patience",))
        )
        if not isinstance(self.weight_decay, Real) or not 0 <= self.weight_decay < np.inf:
            raise ValueError(f"weight_decay must be finite and not negative, got {self.weight_decay!r}")
        if not len(self.hidden) or not all(isinstance(h, Integral) and h >= 1 for h in self.hidden):
            raise ValueError(f"hidden must be integers of at least 1, got {self.hidden!r}")
        values, target = self._checked(X, y)
        if type_of_target(target) != "binary":
            message = "Only binary classification is supported. The type of the target is "
            raise ValueError(f"{message}{type_of_target(target)}.")
        self.classes_ = np.unique(target)
        if len(self.classes_) != 2:
            raise ValueError(f"two classes are needed, the data hold one class: {self.classes_[0]!r}")
        weight = sample_weight
        if weight is not None:
            weight = _check_sample_weight(weight, values, dtype=np.float64, ensure_non_negative=True)
        held_out = None
        if validation is not None:
            held_out = (
                validate_data(self, validation[0], dtype=np.float64, reset=False),
                np.asarray(validation[1]) == self.classes_[1],
            )
        trained = train_networks(
            [int(h) for h in np.resize(np.asarray(self.hidden), self.n_networks)],
            check_random_state(self.random_state).randint(2**31 - 1, size=self.n_networks),
            (values, target == self.classes_[1]),
            weight_decay=self.weight_decay,
            max_iter=self.max_iter,
            weight=weight,
            validation=held_out,
            patience=self.patience,
            n_jobs=self.n_jobs,
        )
        self.networks_, self.losses_, self.n_iter_ = trained.networks, trained.loss, trained.iterations
        self.validation_losses_ = trained.validation_loss
        self.validation_accuracies_ = trained.validation_accuracy
        self.best_ = int(np.argmin(self.losses_ if validation is None else self.validation_losses_))
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the larger probability, shape (n_samples,)."""
        second = self._of_each(X).mean(axis=0) > 0.5
        classes: NDArray[Any] = self.classes_[second.astype(np.intp)]
        return classes

    def predict_proba(self, X: ArrayLike) -> Array:
        """Return the probabilities in the order of ``classes_``, shape (n_samples, 2)."""
        second = self._of_each(X).mean(axis=0)
        return np.column_stack([1 - second, second])

    def spread(self, X: ArrayLike) -> Array:
        """Return the standard deviation of the networks' probabilities, shape (n_samples,)."""
        deviation: Array = self._of_each(X).std(axis=0)
        return deviation

    def member_scores(self, X: ArrayLike, y: ArrayLike) -> Array:
        """Return the accuracy of each network (winner takes all), shape (n_networks,)."""
        scores: Array = ((self._of_each(X) > 0.5) == (np.asarray(y) == self.classes_[1])).mean(axis=1)
        return scores

    def _of_each(self, X: ArrayLike) -> Array:
        """Return each network's probability of the second class, shape (n_networks, n_samples)."""
        check_is_fitted(self)
        features = validate_data(self, X, dtype=np.float64, reset=False)
        return np.stack([network.p_first(features) for network in self.networks_])

    def __sklearn_tags__(self) -> Any:
        """Declare a binary classifier."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags
