"""The paper's networks as a scikit-learn classifier: fifty, or one (paper, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.multiclass import type_of_target
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from mavhums.core.arrays import Array, Integers
from mavhums.learn._estimators import LabelledEstimator, check_positive_integers
from mavhums.learn.inference import TanhNetwork
from mavhums.learn.trainer import NetworkOptions, Vectors, train_networks


class TanhNetworkEnsemble(ClassifierMixin, LabelledEstimator):
    """Many k-h-2 networks with tanh neurons for two classes, trained by L-BFGS.

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
        MissingExtraError
            If torch is not installed.
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
        weight, held_out = sample_weight, None
        if weight is not None:
            weight = _check_sample_weight(weight, values, dtype=np.float64, ensure_non_negative=True)
        if validation is not None:
            others = validate_data(self, validation[0], dtype=np.float64, reset=False)
            held_out = Vectors(others, np.asarray(validation[1]) == self.classes_[1])
        trained = train_networks(
            np.resize(np.asarray(self.hidden), self.n_networks),
            check_random_state(self.random_state).randint(2**31 - 1, size=self.n_networks),
            Vectors(values, target == self.classes_[1], weight),
            held_out,
            options=NetworkOptions(self.weight_decay, self.max_iter, self.patience, n_jobs=self.n_jobs),
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
