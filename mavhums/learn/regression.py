"""Nonlinear multiple regression by Algorithm 1 (paper, section 3, stage 2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations_with_replacement
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr, solve_triangular
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from mavhums.core.arrays import Array
from mavhums.learn._estimators import check_positive_integers

Elementary = Mapping[str, Callable[[Array], Array]]
"""Elementary functions b_j by their notation, in which ``{}`` is the feature: ``"sin({})"``."""


def _itself(values: Array) -> Array:
    return values


IDENTITY: Elementary = {"{}": _itself}
"""The one elementary function b(x) = x, whose products are the polynomials."""

Factor = tuple[int, int]
"""One element of the set G: the indices of a feature and of an elementary function."""


def basis_count(functions: int, features: int, order: int) -> int:
    """Return the number of basis functions of Algorithm 1: C(z·(k-1) + m, m).

    Parameters
    ----------
    functions, features, order
        z elementary functions, k-1 explaining features, m elements of G in a product.

    Examples
    --------
    With one elementary function this is the paper's (k + m - 1)! / (m! (k - 1)!):

    >>> from math import factorial
    >>> k, m = 12, 2
    >>> basis_count(1, k - 1, m) == factorial(k + m - 1) // (factorial(m) * factorial(k - 1)) == 78
    True
    """
    return comb(functions * features + order, order)


def basis_products(functions: int, features: Sequence[int], order: int) -> list[tuple[Factor, ...]]:
    """Return the factors of each basis function; the empty product (the constant) comes first.

    The m elements of a product may repeat, and G contains constants, so the basis consists of all
    products of up to m functions of features.

    Examples
    --------
    >>> basis_products(1, [0, 1], 2)
    [(), ((0, 0),), ((1, 0),), ((0, 0), (0, 0)), ((0, 0), (1, 0)), ((1, 0), (1, 0))]
    """
    elements = [(feature, function) for feature in features for function in range(functions)]
    return [product for m in range(order + 1) for product in combinations_with_replacement(elements, m)]


def basis_values(values: Array, functions: Elementary, products: Sequence[tuple[Factor, ...]]) -> Array:
    """Evaluate each basis function on ``values`` of shape (n, k), as shape (n, N).

    Raises
    ------
    ValueError
        If an elementary function does not return one finite number per sample.
    """
    elements: dict[Factor, Array] = {}
    for feature, function in {factor for product in products for factor in product}:
        name, compute = list(functions.items())[function]
        element = np.asarray(compute(values[:, feature]), dtype=np.float64)
        if element.shape != values.shape[:1] or not np.isfinite(element).all():
            raise ValueError(f"{name} of feature {feature} is not one finite number per sample")
        elements[feature, function] = element
    basis = np.ones((len(values), len(products)))
    for column, product in enumerate(products):
        for factor in product:
            basis[:, column] *= elements[factor]
    return basis


class NonlinearRegression(RegressorMixin, BaseEstimator):
    """Least squares on products of elementary functions of the features: Algorithm 1 of the paper.

    Basis functions that depend linearly on others get a zero coefficient (QR with column
    pivoting), so the expression is short and the fit is well posed.

    Parameters
    ----------
    functions
        The elementary functions b_j, by their notation; None means only b(x) = x.
    order
        m, the number of elements of G in one basis function.
    tolerance
        A basis function counts as dependent if its pivot is below this fraction of the largest;
        columns have unit norm.

    Attributes
    ----------
    products_
        Factors (feature, function) of each basis function, length N.
    coef_
        Coefficient a_d of each basis function, shape (N,); zero for dependent ones.
    rank_
        Number of independent basis functions.
    r2_
        Coefficient of determination on the training data; 1 for a constant target.
    n_features_in_
        Number of features seen by :meth:`fit`.

    References
    ----------
    S. Bazhenov, A. Skryabin, G. Veresnikov: The Development of Algorithms for EMA Fault Early
    Detection System, section 3, Algorithm 1.

    Examples
    --------
    >>> import numpy as np
    >>> voltage, current = np.random.default_rng(0).normal(size=(2, 100))
    >>> model = NonlinearRegression().fit(np.column_stack([voltage, current]), voltage * current)
    >>> model.expression(["V4", "V5"], target="V6")
    'V6 = 1·V4·V5'
    >>> model.r2_ > 0.999
    True
    """

    products_: list[tuple[Factor, ...]]
    coef_: Array
    rank_: int
    r2_: float
    _share: Array

    def __init__(self, functions: Elementary | None = None, order: int = 2, tolerance: float = 1e-6) -> None:
        self.functions = functions
        self.order = order
        self.tolerance = tolerance

    def fit(self, X: ArrayLike, y: ArrayLike) -> NonlinearRegression:
        """Estimate the coefficients.

        Parameters
        ----------
        X
            Shape (n_samples, n_features), finite.
        y
            The dependent feature, shape (n_samples,).

        Raises
        ------
        ValueError
            If a parameter or the data are not as described.
        """
        check_positive_integers(self, "order")
        values, target = validate_data(self, X, y, dtype=np.float64, y_numeric=True)
        functions = self._functions()
        self.products_ = basis_products(len(functions), range(values.shape[1]), self.order)
        basis = basis_values(values, functions, self.products_)
        self.coef_, self.rank_ = solve_least_squares(basis, target, self.tolerance)
        total = np.square(target - target.mean()).sum()
        residual = np.square(target - basis @ self.coef_).sum()
        self.r2_ = float(1 - residual / total) if total > 0 else 1.0
        self._share = np.abs(self.coef_) * basis.std(axis=0) / (target.std() or 1.0)
        self._share[0] = np.abs(self.coef_[0]) / (target.std() or 1.0)
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Return the predicted target, shape (n_samples,)."""
        check_is_fitted(self)
        values = validate_data(self, X, dtype=np.float64, reset=False)
        predicted: Array = basis_values(values, self._functions(), self.products_) @ self.coef_
        return predicted

    def expression(
        self,
        names: Sequence[str] | None = None,
        *,
        target: str = "y",
        digits: int = 4,
        negligible: float = 1e-3,
    ) -> str:
        """Return the fitted model as a formula.

        Parameters
        ----------
        names
            Names of the features; the default is x0, x1, …
        target
            Name of the dependent feature.
        digits
            Number of significant digits of the coefficients.
        negligible
            Terms are omitted if their standard deviation, as a fraction of the target's, is smaller.
        """
        check_is_fitted(self)
        names = names or [f"x{i}" for i in range(self.n_features_in_)]
        written = list(self._functions())
        terms = []
        for product, coefficient, share in zip(self.products_, self.coef_, self._share, strict=True):
            if share >= negligible:
                factors = "".join(
                    f"·{written[function].format(names[feature])}" for feature, function in product
                )
                terms.append((coefficient, f"{abs(coefficient):.{digits}g}{factors}"))
        if not terms:
            return f"{target} = 0"
        first, *rest = terms
        signed = [f" {'-' if coefficient < 0 else '+'} {text}" for coefficient, text in rest]
        return f"{target} = {'-' if first[0] < 0 else ''}{first[1]}{''.join(signed)}"

    def _functions(self) -> Elementary:
        functions = IDENTITY if self.functions is None else self.functions
        if not functions:
            raise ValueError("functions must contain at least one elementary function")
        return functions

    def __sklearn_tags__(self) -> Any:
        """Declare a poor score on scikit-learn's linear test data, which a polynomial overfits."""
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True
        return tags


def solve_least_squares(basis: Array, target: Array, tolerance: float) -> tuple[Array, int]:
    """Return the least-squares coefficients (zero for dependent columns) and the rank.

    Parameters
    ----------
    basis, target
        Shapes (n, N) and (n,).
    tolerance
        Smallest diagonal element of R that counts, as a fraction of the largest, for columns of
        unit norm.
    """
    norm = np.linalg.norm(basis, axis=0)
    norm[norm == 0] = 1
    q, r, order = qr(basis / norm, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(r))
    rank = int((diagonal > tolerance * diagonal[0]).sum()) if diagonal.size else 0
    coefficients = np.zeros(basis.shape[1])
    coefficients[order[:rank]] = solve_triangular(r[:rank, :rank], q[:, :rank].T @ target)
    return coefficients / norm, rank
