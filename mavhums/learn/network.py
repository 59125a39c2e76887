"""The paper's neural network as a scikit-learn classifier (paper, sections 2 and 5)."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.model_selection import train_test_split
from sklearn.utils import check_random_state
from sklearn.utils.validation import _check_sample_weight

from mavhums.core.errors import MissingExtraError
from mavhums.learn._classified import TwoClasses
from mavhums.learn.inference import TanhNetwork
from mavhums.learn.scaling import unit_interval

__all__ = ["TanhNetworkClassifier"]


class TanhNetworkClassifier(TwoClasses):
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
    The paper does not name its optimiser. On 20,000 samples with four inputs L-BFGS took 1.3 s for
    200 iterations; Adam (batches of 200) took 4.5 s to reach the same loss and accuracy.

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
        self._check_parameters()
        values, codes = self._coded(X, y)
        try:
            from mavhums.learn.optimisation import train
        except ModuleNotFoundError as error:
            raise MissingExtraError("training", "train") from error
        random = check_random_state(self.random_state)
        weight = np.ones(len(values))
        if sample_weight is not None:
            weight = _check_sample_weight(sample_weight, values, dtype=np.float64, ensure_non_negative=True)
        used = values[weight > 0]
        minimum, maximum = used.min(axis=0), used.max(axis=0)
        kept, held_out = self._split(codes, random)
        scaled, emergency = unit_interval(values, minimum, maximum), codes == 1
        training = train(
            (scaled[kept], emergency[kept]),
            weight=None if sample_weight is None else weight[kept],
            hidden=self.hidden,
            weight_decay=self.weight_decay,
            max_iter=self.max_iter,
            seed=int(random.randint(2**31 - 1)),
            validation=(scaled[held_out], emergency[held_out]) if len(held_out) else None,
            patience=self.patience,
        )
        self.network_ = TanhNetwork(
            minimum=minimum, maximum=maximum, w1=training.w1, b1=training.b1, w2=training.w2, b2=training.b2
        )
        self.loss_, self.n_iter_ = training.loss, training.iterations
        return self

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Return the class with the larger output, shape (n_samples,)."""
        features = self._features(X)
        outputs = self.network_.outputs(features)
        classes: NDArray[Any] = self.classes_[(outputs[:, 0] > outputs[:, 1]).astype(np.intp)]
        return classes

    def predict_proba(self, X: ArrayLike) -> NDArray[np.float64]:
        """Return the softmax of the outputs in the order of ``classes_``, shape (n_samples, 2)."""
        features = self._features(X)
        second = self.network_.p_first(features)
        return np.column_stack([1 - second, second])

    def _check_parameters(self) -> None:
        self._check_training("hidden", "max_iter", "patience")
        if not isinstance(self.validation_fraction, Real) or not 0 <= self.validation_fraction < 1:
            raise ValueError(f"validation_fraction must lie in [0, 1), got {self.validation_fraction!r}")

    def _split(
        self, codes: NDArray[np.intp], random: np.random.RandomState
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        rows = np.arange(len(codes))
        if not self.validation_fraction:
            return rows, rows[:0]
        kept, held_out = train_test_split(
            rows, test_size=self.validation_fraction, stratify=codes, random_state=random
        )
        return kept, held_out
