"""The paper's networks as scikit-learn classifiers: one, and fifty trained together (paper, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import ClassifierMixin
from sklearn.model_selection import train_test_split
from sklearn.utils import check_random_state
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from mavhums.core.arrays import Array, Integers
from mavhums.learn._estimators import (
    LabelledEstimator,
    check_choice,
    check_positive_integers,
    train_networks,
    two_classes,
)
from mavhums.learn.inference import TanhNetwork


class _Networks(ClassifierMixin, LabelledEstimator):
    """A classifier of two classes by networks; ``fit`` stores the classes in ``classes_``."""

    classes_: NDArray[Any]
    weight_decay: float
    max_iter: int

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the larger probability, shape (n_samples,)."""
        second = self._second(X) > 0.5
        classes: NDArray[Any] = self.classes_[second.astype(np.intp)]
        return classes

    def predict_proba(self, X: ArrayLike) -> Array:
        """Return the probabilities in the order of ``classes_``, shape (n_samples, 2)."""
        second = self._second(X)
        return np.column_stack([1 - second, second])

    def _second(self, X: ArrayLike) -> Array:
        """Return the probability of the second class, shape (n_samples,)."""
        raise NotImplementedError

    def _features(self, X: ArrayLike) -> Array:
        check_is_fitted(self)
        features: Array = validate_data(self, X, dtype=np.float64, reset=False)
        return features

    def _check_training(self, *integers: str) -> None:
        """Check the parameters that must be integers of at least 1, and the weight decay."""
        check_positive_integers(self, "max_iter", *integers)
        if not isinstance(self.weight_decay, Real) or not 0 <= self.weight_decay < np.inf:
            raise ValueError(f"weight_decay must be finite and not negative, got {self.weight_decay!r}")

    def _coded(
        self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None
    ) -> tuple[Array, Integers, Array | None]:
        """Return samples (n, k), the index of each one's class in ``classes_``, and its weight, (n,)."""
        values, target = self._checked(X, y)
        self.classes_, codes = two_classes(target)
        if sample_weight is None:
            return values, codes, None
        weight = _check_sample_weight(sample_weight, values, dtype=np.float64, ensure_non_negative=True)
        return values, codes, weight

    def __sklearn_tags__(self) -> Any:
        """Declare a binary classifier."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags


class TanhNetworkClassifier(_Networks):
    """A k-h-2 network with tanh neurons for two classes; the class with the larger output wins.

    Features are scaled onto the unit interval by the range of the training data. Labels are coded
    as in the paper's table 3: the first class of ``classes_`` (normal) as (0, 1), the second
    (emergency) as (1, 0). Training needs torch; a fitted classifier predicts with numpy alone.

    Parameters
    ----------
    hidden
        Neurons in the hidden layer; the paper takes 4 to 16.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean
        cross-entropy. Without decay the decision boundary overfits the training data.
    max_iter
        Maximum number of L-BFGS iterations, each on all samples.
    validation_fraction
        Fraction of the samples held out at random, stratified by class, for early stopping; 0
        disables it. Neighbouring samples of a time series are correlated, so for flights keep 0
        and hold out whole flights, as :func:`mavhums.learn.train_network` does.
    patience
        Training stops after this many iterations without a smaller validation loss, which is
        evaluated every tenth iteration.
    random_state
        Seed, generator or None, for the initial weights and the choice of held-out samples.

    Attributes
    ----------
    classes_
        The two classes, sorted.
    network_
        The trained :class:`~mavhums.learn.inference.TanhNetwork`, numpy only.
    loss_
        Mean cross-entropy over the training samples.
    n_iter_
        Number of iterations.
    n_features_in_
        Number of features seen by :meth:`fit`.

    Notes
    -----
    The paper does not name its optimiser. This is a batch of one for the trainer of
    :class:`TanhNetworkEnsemble`, by L-BFGS in double precision on the processor.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 5, tables 3 to 5.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    >>> network = TanhNetworkClassifier(hidden=4, random_state=0).fit(corners, [0, 1, 1, 0])
    >>> network.predict(corners)
    array([0, 1, 1, 0])
    """

    classes_: NDArray[Any]
    network_: TanhNetwork
    loss_: float
    n_iter_: int

    def __init__(
        self,
        hidden: int = 11,
        *,
        weight_decay: float = 1e-4,
        max_iter: int = 200,
        validation_fraction: float = 0.0,
        patience: int = 50,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.hidden = hidden
        self.weight_decay = weight_decay
        self.max_iter = max_iter
        self.validation_fraction = validation_fraction
        self.patience = patience
        self.random_state = random_state

    def fit(
        self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None
    ) -> TanhNetworkClassifier:
        """Train the network.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            One of two classes for each sample, shape (n_samples,).
        sample_weight
            Weight of each sample in training, not negative, shape (n_samples,).

        Raises
        ------
        ValueError
            If a parameter or the data are not as described.
        MissingExtraError
            If torch is not installed.
        """
        self._check_training("hidden", "patience")
        if not isinstance(self.validation_fraction, Real) or not 0 <= self.validation_fraction < 1:
            raise ValueError(f"validation_fraction must lie in [0, 1), got {self.validation_fraction!r}")
        values, codes, weight = self._coded(X, y, sample_weight)
        random = check_random_state(self.random_state)
        # The range of all samples, those held out included, becomes the unit interval.
        used = values if weight is None else values[weight > 0]
        kept, held_out = np.arange(len(codes)), None
        if self.validation_fraction:
            kept, rest = train_test_split(
                kept, test_size=self.validation_fraction, stratify=codes, random_state=random
            )
            held_out = values[rest], codes[rest] == 1
        trained = train_networks(
            [self.hidden],
            [int(random.randint(2**31 - 1))],
            (values[kept], codes[kept] == 1),
            weight_decay=self.weight_decay,
            max_iter=self.max_iter,
            weight=None if weight is None else weight[kept],
            validation=held_out,
            bounds=(used.min(axis=0), used.max(axis=0)),
            patience=self.patience,
            precision="double",
            device="cpu",
        )
        self.network_ = trained.networks[0]
        self.loss_, self.n_iter_ = float(trained.loss[0]), int(trained.iterations[0])
        return self

    def _second(self, X: ArrayLike) -> Array:
        features = self._features(X)
        return self.network_.p_first(features)


class TanhNetworkEnsemble(_Networks):
    """Many k-h-2 networks with tanh neurons for two classes, trained as one tensor program.

    The networks differ in their hidden neurons and initial weights. The ensemble's probability is
    the mean of theirs; their spread measures how much the result depends on the initial weights.
    Labels are coded as in the paper's table 3; features are scaled onto the unit interval.

    Parameters
    ----------
    n_networks
        Number of networks; the paper trains 50.
    hidden
        Numbers of hidden neurons; the networks cycle through them.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean
        cross-entropy.
    max_iter
        Maximum number of L-BFGS iterations.
    patience
        Early stopping: a network stops after this many iterations without a smaller loss on the
        validation samples given to :meth:`fit`; None uses them only for :attr:`best_`.
    precision
        ``"single"`` is twice as fast as ``"double"``.
    device
        ``"auto"`` (a GPU if one is available), ``"cpu"`` or another torch device.
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
        precision: Literal["single", "double"] = "double",
        device: str = "auto",
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_networks = n_networks
        self.hidden = hidden
        self.weight_decay = weight_decay
        self.max_iter = max_iter
        self.patience = patience
        self.precision = precision
        self.device = device
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
        self._check_training("n_networks", *(() if self.patience is None else ("patience",)))
        if not len(self.hidden) or not all(isinstance(h, Integral) and h >= 1 for h in self.hidden):
            raise ValueError(f"hidden must be integers of at least 1, got {self.hidden!r}")
        check_choice(self, "precision", ("single", "double"))
        values, codes, weight = self._coded(X, y, sample_weight)
        held_out = None
        if validation is not None:
            held_out = (
                validate_data(self, validation[0], dtype=np.float64, reset=False),
                np.asarray(validation[1]) == self.classes_[1],
            )
        trained = train_networks(
            [int(h) for h in np.resize(np.asarray(self.hidden), self.n_networks)],
            check_random_state(self.random_state).randint(2**31 - 1, size=self.n_networks),
            (values, codes == 1),
            weight_decay=self.weight_decay,
            max_iter=self.max_iter,
            weight=weight,
            validation=held_out,
            patience=self.patience,
            precision=self.precision,
            device=self.device,
            n_jobs=self.n_jobs,
        )
        self.networks_, self.losses_, self.n_iter_ = trained.networks, trained.loss, trained.iterations
        self.validation_losses_ = trained.validation_loss
        self.validation_accuracies_ = trained.validation_accuracy
        self.best_ = int(np.argmin(self.losses_ if validation is None else self.validation_losses_))
        return self

    def spread(self, X: ArrayLike) -> Array:
        """Return the standard deviation of the networks' probabilities, shape (n_samples,)."""
        deviation: Array = self._of_each(X).std(axis=0)
        return deviation

    def member_scores(self, X: ArrayLike, y: ArrayLike) -> Array:
        """Return the accuracy of each network (winner takes all), shape (n_networks,)."""
        scores: Array = ((self._of_each(X) > 0.5) == (np.asarray(y) == self.classes_[1])).mean(axis=1)
        return scores

    def _of_each(self, X: ArrayLike) -> Array:
        features = self._features(X)
        return np.stack([network.p_first(features) for network in self.networks_])

    def _second(self, X: ArrayLike) -> Array:
        mean: Array = self._of_each(X).mean(axis=0)
        return mean
