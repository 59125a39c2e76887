"""The paper's scheme (its figure 1) in stages: ranking, filter, thinning, and the wrapper around networks.

``mavhums train``, the packaged models and ``mavhums study paper`` all take these stages.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from mavhums.core.arrays import Array
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.learn.card import ExcludedQuantity, Selection, Thinned
from mavhums.learn.ranking import ChiSquareRanking, VectorThinning
from mavhums.learn.redundancy import PairwiseRedundancyFilter, RegressionRedundancyFilter
from mavhums.learn.regression import Elementary, basis_count
from mavhums.learn.trainer import Vectors
from mavhums.learn.wrapper import eliminate, search_subsets

Select = Literal["algorithm-1", "pairwise", "exhaustive", "genetic", "none"]
SELECTIONS: tuple[Select, ...] = get_args(Select)

FUNCTIONS: Elementary = {
    "{}": lambda x: x,
    "|{}|": np.abs,
    "sign({})": np.sign,
    "{}²": np.square,
    "√|{}|": lambda x: np.sqrt(np.abs(x)),
    "sin({}°)": lambda x: np.sin(np.radians(x)),
}
"""Elementary functions of Algorithm 1 by their notation, in the order of :data:`FUNCTION_NAMES`."""

FUNCTION_NAMES = dict(zip(("x", "abs", "sign", "square", "sqrt", "sin"), FUNCTIONS, strict=True))

_LARGEST_BASIS = 2000
"""Basis functions of Algorithm 1: beyond them its regressions take minutes and explain anything."""


@dataclass(frozen=True)
class Scheme:
    """Options of the stages; the defaults are the paper's chain.

    Attributes
    ----------
    select
        ``"algorithm-1"`` or ``"pairwise"``: the filter before the wrapper; ``"exhaustive"`` or
        ``"genetic"``: the wrapper on all quantities, without a filter; ``"none"``: all quantities.
    functions, order
        Elementary functions of Algorithm 1, of :data:`FUNCTION_NAMES`, and how many form a product.
    r2
        R² from which a quantity counts as explained, above 0 and at most 1.
    vectors
        Number of training vectors that thinning keeps; None keeps all.
    networks
        Number of networks to choose from; the paper trains 50.
    hidden
        Numbers of hidden neurons; the networks cycle through them.
    bins
        Bins of chi-square, of equal ``"width"`` or, by ``"quantile"``, of equal counts.
    eliminates
        Whether the wrapper leaves out one feature after the other, or searches the subsets.

    Raises
    ------
    MavhumsError
        If an option is unknown or out of range.
    """

    select: Select = "algorithm-1"
    functions: tuple[str, ...] = ("x",)
    order: int = 2
    r2: float = 0.999
    vectors: int | None = 4000
    networks: int = 50
    hidden: tuple[int, ...] = tuple(range(4, 17))
    bins: Literal["width", "quantile"] = "width"
    eliminates: bool = False

    def __post_init__(self) -> None:
        """Reject options that are out of range."""
        unknown = [name for name in self.functions if name not in FUNCTION_NAMES]
        if unknown or not self.functions:
            raise MavhumsError(
                f"no elementary function {(unknown or [''])[0]!r}",
                f"name some of {', '.join(FUNCTION_NAMES)}",
            )
        if self.select not in SELECTIONS:
            raise MavhumsError(f"no selection {self.select!r}", f"name one of {', '.join(SELECTIONS)}")
        whole = (self.order, self.networks, 1 if self.vectors is None else self.vectors, *self.hidden)
        if min(whole, default=0) < 1 or not self.hidden or not 0 < self.r2 <= 1:
            raise MavhumsError(
                "the scheme has a number out of range",
                "give an order, vectors, networks and neurons of at least 1, and an R² above 0 and up to 1",
            )

    @property
    def command(self) -> str:
        """The options of ``mavhums train`` that give this scheme."""
        vectors = 0 if self.vectors is None else self.vectors
        return (
            f"--select {self.select} --functions {','.join(self.functions)} --order {self.order} "
            f"--r2 {self.r2:g} --vectors {vectors} --networks {self.networks}"
        )


def _silent(_: str) -> None:
    """Print nothing."""


@dataclass(frozen=True)
class TrainingOptions:
    """How the stages run.

    Attributes
    ----------
    seed
        Makes the result repeatable.
    keys
        The quantities, or statistics of windows, to choose from: those that the telemetry tier provides.
    scheme
        Options of the stages.
    report
        Called with a line about each stage when it is done.
    """

    seed: int
    keys: tuple[str, ...] = KEYS
    scheme: Scheme = Scheme()
    report: Callable[[str], None] = _silent


def select_features(
    values: ArrayLike, emergency: ArrayLike, *, keys: Sequence[str] = KEYS, scheme: Scheme = Scheme()
) -> Selection:
    """Rank quantities by chi-square, and exclude those that others explain (paper, section 3).

    Parameters
    ----------
    values
        V1…V12, shape (n, 12), finite in the columns of ``keys``.
    emergency
        Class of each sample, shape (n,).
    keys
        The quantities to choose from, those that the telemetry tier provides.
    scheme
        Options of the filter.

    Raises
    ------
    MavhumsError
        If the scheme has more basis functions than can be regressed on.
    ValueError
        If the data are not as described, or no quantity varies.
    """
    table = np.asarray(values, dtype=np.float64)[:, [column(key) for key in keys]]
    return select_columns(table, emergency, keys, scheme)


def select_columns(table: Array, target: ArrayLike, keys: Sequence[str], scheme: Scheme) -> Selection:
    """Do the same with any features, ``table`` (n, k), and any number of classes, ``target`` (n,)."""
    ranking = ChiSquareRanking(strategy=scheme.bins)
    excluded: tuple[ExcludedQuantity, ...] = ()
    if scheme.select == "algorithm-1":
        multiple = _algorithm_1(scheme, len(keys), ranking).fit(table, target)
        ranking, groups, kept = multiple.ranking_, multiple.groups_, multiple.get_support(indices=True)
        excluded = tuple(
            ExcludedQuantity(
                quantity=keys[each.feature],
                r2=round(each.model.r2_, 6),
                expression=each.model.expression(
                    [keys[place] for place in each.explained_by], target=keys[each.feature]
                ),
            )
            for each in multiple.dependences_
        )
        name = f"Algorithm 1 of {', '.join(scheme.functions)}, m = {scheme.order}, R² ≥ {scheme.r2:g}"
    elif scheme.select == "pairwise":
        pairs = PairwiseRedundancyFilter(threshold=scheme.r2, degree=scheme.order).fit(table, target)
        ranking, groups, kept = pairs.ranking_, pairs.groups_, pairs.get_support(indices=True)
        name = f"pairs, polynomial of degree {scheme.order}, R² ≥ {scheme.r2:g}"
    else:
        ranking.fit(table, target)
        kept = np.flatnonzero(np.ptp(table, axis=0) > 0)
        groups, name = tuple((place,) for place in kept.tolist()), ""
        if not len(kept):
            raise ValueError("every feature is constant, so none distinguishes the classes")
    return Selection(
        chi_square=dict(zip(keys, ranking.scores_.tolist(), strict=True)),
        p_values=dict(zip(keys, ranking.p_values_.tolist(), strict=True)),
        groups=tuple(tuple(keys[place] for place in group) for group in groups),
        selected=tuple(keys[place] for place in kept),
        filter=name,
        excluded=excluded,
    )


def _algorithm_1(scheme: Scheme, quantities: int, ranking: ChiSquareRanking) -> RegressionRedundancyFilter:
    count = basis_count(len(scheme.functions), quantities, scheme.order)
    if count > _LARGEST_BASIS:
        raise MavhumsError(
            f"Algorithm 1 with {len(scheme.functions)} functions of {quantities} quantities in products of "
            f"{scheme.order} has {count} basis functions, more than {_LARGEST_BASIS}",
            "name fewer --functions or a lower --order",
        )
    functions = {FUNCTION_NAMES[name]: FUNCTIONS[FUNCTION_NAMES[name]] for name in scheme.functions}
    return RegressionRedundancyFilter(scheme.r2, functions, scheme.order, ranking=ranking)


class Stages(NamedTuple):
    """What the stages leave to train on.

    Attributes
    ----------
    vectors
        The thinned vectors.
    offered, checked
        All training vectors, and those held out; they, too, have the chosen features alone.
    inputs
        Keys of those features.
    selection
        Results of the stages.
    """

    vectors: Vectors
    offered: Vectors
    checked: Vectors
    inputs: tuple[str, ...]
    selection: Selection


def run_stages(offered: Vectors, checked: Vectors, options: TrainingOptions) -> Stages:
    """Rank and filter the features, thin the training vectors, and let the wrapper choose among the features.

    Parameters
    ----------
    offered, checked
        Training vectors with a feature for each of the keys, and those held out; only the wrapper sees these.
    options
        Keys, scheme, seed of the draws, and what is called with a line about each stage.
    """
    scheme, seed = options.scheme, options.seed
    selection = select_columns(offered.features, offered.classes, options.keys, scheme)
    kept = np.isin(options.keys, selection.selected)
    offered, checked = offered.of_features(kept), checked.of_features(kept)
    chosen = np.ones(len(selection.selected), dtype=bool)
    printed: list[str] = []

    def report() -> None:
        for line in selection.stage_lines(selection.chosen(chosen))[len(printed) :]:
            options.report(line)
            printed.append(line)

    report()
    vectors = _thin(offered, scheme.vectors, seed=seed)
    selection = selection.model_copy(update={"thinned": Thinned(offered=len(offered), kept=len(vectors))})
    report()
    if scheme.select != "none" and len(chosen) > 1:
        if scheme.eliminates:
            chosen, wrapped, rises = eliminate(vectors, checked, seed=seed)
        else:
            chosen, wrapped, rises = search_subsets(vectors, checked, scheme.select, seed=seed)
        costs = dict(zip(selection.chosen(chosen), np.round(rises, 5).tolist(), strict=True))
        selection = selection.model_copy(update={"wrapped": wrapped.model_copy(update={"costs": costs})})
        report()
    vectors, offered, checked = (part.of_features(chosen) for part in (vectors, offered, checked))
    return Stages(vectors, offered, checked, selection.chosen(chosen), selection)


def _thin(vectors: Vectors, count: int | None, *, seed: int) -> Vectors:
    """Keep vectors that represent the similar ones, each with the weight of those (paper, section 2)."""
    if count is None or count >= len(vectors):
        return vectors
    thinning = VectorThinning(count, random_state=seed)
    thinning.fit(vectors.features, vectors.classes, vectors.weights)
    return replace(vectors.part(thinning.indices_), weight=thinning.weights_)
