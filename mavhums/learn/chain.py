"""The paper's scheme (its figure 1) in stages: ranking, filter, thinning, and the wrapper around networks.

``mavhums train``, the packaged models and ``mavhums study paper`` all take these stages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, column
from mavhums.learn.card import ExcludedQuantity, Selection, Thinned, Wrapped
from mavhums.learn.ranking import ChiSquareRanking, VectorThinning
from mavhums.learn.redundancy import PairwiseRedundancyFilter, RegressionRedundancyFilter
from mavhums.learn.regression import Elementary, basis_count
from mavhums.learn.subsets import (
    SubsetSearch,
    exhaustive_search,
    genetic_search,
    network_objective,
    subset_training,
)

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

_SAMPLES, _ITERATIONS, _HIDDEN = 1000, 60, 8
"""Size of the first round of the wrapper, in which every subset has one small network."""


@dataclass(frozen=True)
class Rounds:
    """Sizes of the wrapper's two rounds; the defaults are those for networks of samples.

    The best subsets of the first round compete again with all vectors: its noise is above their difference.

    Attributes
    ----------
    many
        With more features than this the 2^k - 1 subsets are searched genetically, not all.
    evaluations
        Number of subsets that the genetic search tries.
    shortlist
        Number of subsets in the second round.
    hidden, iterations, seeds, options
        The networks of the second round: neurons, iterations, how many for each subset (a network that
        started badly says nothing about its inputs), and further options of the trainer.
    by_loss
        Whether the smallest loss wins, not the largest accuracy.
    """

    many: int = 10
    evaluations: int = 400
    shortlist: int = 16
    hidden: int = 12
    iterations: int = 150
    seeds: int = 3
    by_loss: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)


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
    hidden: tuple[int, ...] = field(default=tuple(range(4, 17)))

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


def select_features(
    values: ArrayLike, emergency: ArrayLike, *, keys: Sequence[str] = KEYS, scheme: Scheme | None = None
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
        Options; None means the paper's.

    Raises
    ------
    MavhumsError
        If the scheme has more basis functions than can be regressed on.
    ValueError
        If the data are not as described, or no quantity varies.
    """
    scheme = scheme or Scheme()
    table = np.asarray(values, dtype=np.float64)[:, [column(key) for key in keys]]
    return select_columns(table, emergency, keys, scheme)


def select_columns(
    table: Array,
    target: ArrayLike,
    keys: Sequence[str],
    scheme: Scheme,
    ranking: ChiSquareRanking | None = None,
) -> Selection:
    """Do the same with any features, ``table`` (n, k), and any number of classes, ``target`` (n,)."""
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
        ranking = clone(ranking or ChiSquareRanking()).fit(table, target)
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


def _algorithm_1(
    scheme: Scheme, quantities: int, ranking: ChiSquareRanking | None
) -> RegressionRedundancyFilter:
    count = basis_count(len(scheme.functions), quantities, scheme.order)
    if count > _LARGEST_BASIS:
        raise MavhumsError(
            f"Algorithm 1 with {len(scheme.functions)} functions of {quantities} quantities in products of "
            f"{scheme.order} has {count} basis functions, more than {_LARGEST_BASIS}",
            "name fewer --functions or a lower --order",
        )
    functions = {FUNCTION_NAMES[name]: FUNCTIONS[FUNCTION_NAMES[name]] for name in scheme.functions}
    return RegressionRedundancyFilter(scheme.r2, functions, scheme.order, ranking=ranking)


@dataclass(frozen=True, eq=False)
class Vectors:
    """Feature vectors, shape (n, k), and the class and weight of each.

    ``target`` says whether each is an emergency, shape (n,), or of each class, shape (n, classes).
    """

    features: Array
    target: Flags
    weight: Array

    def __len__(self) -> int:
        return len(self.features)

    @property
    def samples(self) -> tuple[Array, Flags]:
        """Features and classes, as the trainer takes them."""
        return self.features, self.target

    def part(self, rows: Integers) -> Vectors:
        """Return some of the vectors."""
        return Vectors(self.features[rows], self.target[rows], self.weight[rows])

    def of_features(self, chosen: Flags) -> Vectors:
        """Return the vectors with some of the features."""
        return replace(self, features=self.features[:, chosen])


def reduce_vectors(
    offered: Vectors,
    checked: Vectors,
    selection: Selection,
    scheme: Scheme,
    *,
    seed: int,
    rounds: Rounds | None = None,
    tell: Callable[[str], None] | None = None,
) -> tuple[Vectors, Flags, Selection]:
    """Thin the training vectors, and let the wrapper choose among the selected features.

    Parameters
    ----------
    offered, checked
        Training vectors of the selected features, and those held out.
    tell
        Called with a line about each stage when it is done, those of ``selection`` first.

    Returns
    -------
    Vectors, Flags, Selection
        The thinned vectors, still with all features; mask of the chosen features, shape (k,);
        ``selection`` with the results of both stages.
    """
    told = 0

    def report() -> None:
        nonlocal told
        lines = selection.stage_lines(selection.chosen(chosen))
        if tell:
            for line in lines[told:]:
                tell(line)
        told = len(lines)

    chosen = np.ones(len(selection.selected), dtype=bool)
    report()
    vectors = _thin(offered, scheme.vectors, seed=seed)
    selection = selection.model_copy(update={"thinned": Thinned(offered=len(offered), kept=len(vectors))})
    report()
    if scheme.select != "none" and len(chosen) > 1:
        chosen, wrapped = search_subsets(
            vectors, checked, scheme.select, seed=seed, rounds=rounds or Rounds()
        )
        selection = selection.model_copy(update={"wrapped": wrapped})
        report()
    return vectors, chosen, selection


def _thin(vectors: Vectors, count: int | None, *, seed: int) -> Vectors:
    """Keep vectors that represent the similar ones, each with the weight of those (paper, section 2)."""
    if count is None or count >= len(vectors):
        return vectors
    classes = vectors.target if vectors.target.ndim == 1 else vectors.target.argmax(axis=1)
    thinning = VectorThinning(count, random_state=seed).fit(vectors.features, classes, vectors.weight)
    return replace(vectors.part(thinning.indices_), weight=thinning.weights_)


def search_subsets(
    vectors: Vectors, validation: Vectors, select: Select, *, seed: int, rounds: Rounds
) -> tuple[Flags, Wrapped]:
    """Search the subset of features whose networks are best on the validation vectors.

    Every subset that is tried has one small network on some vectors. The best of them, and the
    whole set, compete again with larger networks on all vectors.

    Parameters
    ----------
    vectors, validation
        Training vectors, and those of other flights.
    select
        ``"exhaustive"`` or ``"genetic"`` prescribe the search; otherwise the number of features does.
    seed
        Of all draws.
    rounds
        Sizes of the networks and searches.

    Returns
    -------
    Flags, Wrapped
        Mask of the chosen features, shape (k,); what the card tells.

    Raises
    ------
    MissingExtraError
        If torch, or pygad for the genetic search, is not installed.
    """
    random = np.random.default_rng(seed)
    features = vectors.features.shape[1]
    genetic = select == "genetic" or (select != "exhaustive" and features > rounds.many)
    few = [part.part(random.permutation(len(part))[:_SAMPLES]) for part in (vectors, validation)]
    quick = network_objective(
        few[0].samples,
        few[1].samples,
        weight=few[0].weight,
        hidden=_HIDDEN,
        max_iter=_ITERATIONS,
        random_state=seed,
    )
    if genetic:
        search = genetic_search(quick, features, evaluations=rounds.evaluations, random_state=seed)
    else:
        search = exhaustive_search(quick, features)
    whole = np.ones((1, features), dtype=bool)
    best = search.subsets[np.argsort(-search.scores, kind="stable")[: rounds.shortlist]]
    shortlist = np.unique(np.concatenate([whole, best]), axis=0)
    found = [
        subset_training(
            vectors.samples,
            validation.samples,
            weight=vectors.weight,
            hidden=rounds.hidden,
            max_iter=rounds.iterations,
            random_state=seed + k,
            **rounds.options,
        )(shortlist)
        for k in range(rounds.seeds)
    ]
    accuracies = np.max([each.validation_accuracy for each in found], axis=0)
    losses = np.min([each.validation_loss for each in found], axis=0)
    chosen = SubsetSearch(shortlist, -losses if rounds.by_loss else accuracies).best
    wrapped = Wrapped(
        search="genetic" if genetic else "exhaustive",
        tried=len(search.scores),
        possible=2**features - 1,
        accuracy=round(float(accuracies[(shortlist == chosen).all(axis=1)][0]), 6),
        accuracy_of_all=round(float(accuracies[shortlist.all(axis=1)][0]), 6),
    )
    return chosen, wrapped
