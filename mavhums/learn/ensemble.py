"""The paper's fifty networks, trained together, as one scikit-learn classifier (paper, section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import check_random_state
from sklearn.utils.validation import _check_sample_weight, validate_data

from mavhums.core.errors import MissingExtraError
from mavhums.learn._classified import TwoClasses
from mavhums.learn._parameters import check_choice
from mavhums.learn.inference import TanhNetwork

__all__ = ["TanhNetworkEnsemble"]


class TanhNetworkEnsemble(TwoClasses):
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
    optimiser
        ``"lbfgs"``, on all samples, or ``"adam"``, on mini-batches of 200.
    weight_decay
        Half of it times the sum of squared weights, biases excepted, is added to the mean
        cross-entropy.
    max_iter
        Maximum number of L-BFGS iterations, or of Adam epochs.
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
    losses_: NDArray[np.float64]
    n_iter_: NDArray[np.int64]
    validation_losses_: NDArray[np.float64]
    validation_accuracies_: NDArray[np.float64]
    best_: int

    def __init__(
        self,
        n_networks: int = 50,
        hidden: Sequence[int] = tuple(range(4, 17)),
        *,
        optimiser: Literal["lbfgs", "adam"] = "lbfgs",
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
        self.optimiser = optimiser
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
        self._check_parameters()
        values, codes = self._coded(X, y)
        weight = None
        if sample_weight is not None:
            weight = _check_sample_weight(sample_weight, values, dtype=np.float64, ensure_non_negative=True)
        try:
            from mavhums.learn.batch_training import Batch, train_batch
        except ModuleNotFoundError as error:
            raise MissingExtraError("training", "train") from error
        held_out = None
        if validation is not None:
            held_out = (
                validate_data(self, validation[0], dtype=np.float64, reset=False),
                np.asarray(validation[1]) == self.classes_[1],
            )
        trained = train_batch(
            Batch(
                hidden=[int(h) for h in np.resize(np.asarray(self.hidden), self.n_networks)],
                subsets=np.ones((self.n_networks, values.shape[1]), dtype=bool),
                seeds=check_random_state(self.random_state).randint(2**31 - 1, size=self.n_networks),
            ),
            (values, codes == 1),
            weight=weight,
            validation=held_out,
            optimiser=self.optimiser,
            weight_decay=self.weight_decay,
            max_iter=self.max_iter,
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

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the larger mean probability, shape (n_samples,)."""
        second = self._second(X).mean(axis=0) > 0.5
        classes: NDArray[Any] = self.classes_[second.astype(np.intp)]
        return classes

    def predict_proba(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return the networks' mean probabilities in the order of ``classes_``, shape (n_samples, 2)."""
        second = self._second(X).mean(axis=0)
        return np.column_stack([1 - second, second])

    def spread(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return the standard deviation of the networks' probabilities, shape (n_samples,)."""
        deviation: NDArray[np.float64] = self._second(X).std(axis=0)
        return deviation

    def member_scores(self, X: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Return the accuracy of each network (winner takes all), shape (n_networks,)."""
        second = self._second(X) > 0.5
        scores: NDArray[np.float64] = (second == (np.asarray(y) == self.classes_[1])).mean(axis=1)
        return scores

    def _second(self, X: ArrayLike) -> NDArray[np.float64]:
        features = self._features(X)
        return np.stack([network.p_first(features) for network in self.networks_])

    def _check_parameters(self) -> None:
        self._check_training("n_networks", "max_iter", *(() if self.patience is None else ("patience",)))
        if not len(self.hidden) or not all(isinstance(h, Integral) and h >= 1 for h in self.hidden):
            raise ValueError(f"hidden must be integers of at least 1, got {self.hidden!r}")
        check_choice(self, "optimiser", ("lbfgs", "adam"))
        check_choice(self, "precision", ("single", "double"))
