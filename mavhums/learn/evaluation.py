"""Honest evaluation: hold-out by flight, the test for leakage by the command, calibration and its scores."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from math import comb
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError
from mavhums.learn.card import Calibration
from mavhums.learn.inference import WindowNetwork

_HELD_OUT = 0.25
_BLOCKS = 12


def hold_out(
    emergency: Flags, flight: Integers, random: np.random.Generator
) -> tuple[Flags, Literal["flights", "blocks"]]:
    """Hold out a quarter of each class's flights, or of its blocks of time if flights are too few.

    If each class has at least two flights, whole flights are held out; a flight belongs to the
    class of most of its samples, or to both classes if they would be too few. With fewer flights, as in
    the paper's split, each flight is divided into twelve equal blocks of time, and whole blocks are held out.

    Parameters
    ----------
    emergency
        Class of each sample, shape (n,).
    flight
        Index of each sample's flight, from 0, shape (n,); the samples of a flight are in time order.
    random
        Generator that draws the flights.

    Returns
    -------
    NDArray, str
        Mask of the held-out samples, shape (n,), and the unit of hold-out, flights or blocks.

    Raises
    ------
    ValueError
        If a class has fewer than two blocks.
    """
    chosen = _choose(emergency, flight, random)
    if chosen is not None:
        return np.isin(flight, chosen), "flights"
    # Where most flights have both classes, as those of an aircraft with one worn actuator.
    divided = split_flights(emergency, flight, seed=0)
    if divided is not None:
        return np.isin(np.arange(len(flight)), divided[1]), "flights"
    blocks = np.empty_like(flight)
    for number in np.unique(flight):
        rows = np.flatnonzero(flight == number)
        blocks[rows] = number * _BLOCKS + np.arange(len(rows)) * _BLOCKS // len(rows)
    chosen = _choose(emergency, blocks, random)
    if chosen is None:
        raise ValueError("each class needs enough samples to hold some out: at least two blocks of time")
    return np.isin(blocks, chosen), "blocks"


def _choose(emergency: Flags, group: Integers, random: np.random.Generator) -> Integers | None:
    """Draw a quarter of each class's groups, at least one; None if a class has fewer than two."""
    numbers, place = np.unique(group, return_inverse=True)
    is_emergency = np.bincount(place, weights=emergency) / np.bincount(place) >= 0.5
    drawn = []
    for label in (False, True):
        members = numbers[is_emergency == label]
        if len(members) < 2:
            return None
        drawn.append(random.permutation(members)[: max(1, round(_HELD_OUT * len(members)))])
    return np.concatenate(drawn)


def split_flights(
    classes: Integers | Flags, flights: Integers, *, seed: int
) -> tuple[Integers, Integers] | None:
    """Divide rows by whole flights, every class in both parts: a quarter is held out, or more of few flights.

    Parameters
    ----------
    classes, flights
        Class and flight of each row, shape (n,).
    seed
        Of the division.

    Returns
    -------
    tuple of NDArray or None
        Indices of the rows that stay, and of those held out; None if no such division is found.
    """
    from sklearn.model_selection import StratifiedGroupKFold

    every = np.unique(classes)
    fewest = min(len(np.unique(flights[classes == one])) for one in every)
    if len(every) < 2 or fewest < 2:
        return None
    folds = StratifiedGroupKFold(min(fewest, round(1 / _HELD_OUT)), shuffle=True, random_state=seed)
    divided = folds.split(classes, classes, flights)
    return next(
        (rows for rows in divided if all(np.array_equal(np.unique(classes[part]), every) for part in rows)),
        None,
    )


_COMMAND_BINS = 12
_STRONG = 0.25
_SIGNIFICANT = 0.01
_PERMUTATIONS = 999


class CommandLeakWarning(UserWarning):
    """The command differs between the classes."""


@dataclass(frozen=True)
class CommandLeak:
    """Association between the command and the class.

    Attributes
    ----------
    cramers_v
        The larger of the values for the command and for its rate: 0 if both classes have the same
        distribution, 1 if their distributions do not overlap.
    p_value
        Permutation p-value over relabelled flights; None with too few flights.
    leaks
        Whether the association is significant.
    """

    cramers_v: float
    p_value: float | None
    leaks: bool


def check_command(
    command: ArrayLike, emergency: ArrayLike, flights: ArrayLike, *, random_state: int = 0
) -> CommandLeak:
    """Measure the association between command and class, and warn if it is significant.

    Cramér's V is computed from the chi-square of the command V1, and of its change from sample to
    sample, in twelve bins. A permutation test relabels whole flights. If there are fewer than five
    hundred permutations, as in the paper's split, the command leaks if Cramér's V exceeds 0.25.
    The paper reports a chi-square of 40,590 for the command; if both classes flew the same
    cyclogram it would be 0.

    Parameters
    ----------
    command
        V1 of each sample, °, shape (n,); the samples of a flight are in time order.
    emergency, flights
        Class and flight of each sample, shape (n,).
    random_state
        Seed of the permutations.

    Warns
    -----
    CommandLeakWarning
        If the command leaks the class.

    Examples
    --------
    >>> import numpy as np
    >>> sweep = np.sin(np.linspace(0, 6, 500))
    >>> flights = np.repeat([0, 1], 500)
    >>> check_command(np.tile(sweep, 2), flights == 1, flights)
    CommandLeak(cramers_v=0.0, p_value=None, leaks=False)
    """
    values, labels = np.asarray(command, dtype=np.float64), np.asarray(emergency, dtype=bool)
    names, place = np.unique(np.asarray(flights), return_inverse=True)
    of_flight = np.bincount(place, weights=labels) / np.bincount(place) >= 0.5
    tables = [_per_flight(feature, place) for feature in (values, _change(values, place))]
    found = float(_cramers_v(tables, of_flight[None])[0])
    p_value = None
    if comb(len(names), int(of_flight.sum())) >= 500:
        random = np.random.default_rng(random_state)
        relabelled = np.stack([random.permutation(of_flight) for _ in range(_PERMUTATIONS)])
        chance = _cramers_v(tables, relabelled)
        p_value = float((1 + np.count_nonzero(chance >= found)) / (1 + _PERMUTATIONS))
    leaks = found > _STRONG if p_value is None else p_value <= _SIGNIFICANT
    if leaks:
        warnings.warn(
            f"the command distinguishes the classes (Cramér's V {found:.2f}): "
            "fly both classes with the same cyclograms, or each flight with its own",
            CommandLeakWarning,
            stacklevel=2,
        )
    return CommandLeak(found, p_value, leaks)


def _change(values: Array, flight: Integers) -> Array:
    change = np.diff(values, prepend=values[:1])
    change[np.diff(flight, prepend=flight[:1]) != 0] = 0
    return change


def _per_flight(feature: Array, flight: Integers) -> Array:
    """Return the number of samples of each flight in each bin, shape (flights, bins)."""
    counts, _, _ = np.histogram2d(flight, feature, bins=[np.arange(flight.max() + 2), _COMMAND_BINS])
    return np.asarray(counts[:, counts.any(axis=0)])


def _cramers_v(tables: list[Array], labels: Flags) -> Array:
    """Return the larger of the tables' Cramér's V for each labelling of the flights, shape (labellings,)."""
    values = []
    for table in tables:
        total, share = table.sum(axis=0), (labels @ table.sum(axis=1) / table.sum())[:, None]
        excess = labels @ table - share * total
        # With two classes, the excess of one in a bin equals the deficit of the other.
        with np.errstate(invalid="ignore"):
            statistic = (np.square(excess) / (total * share * (1 - share))).sum(axis=1)
        values.append(np.sqrt(np.nan_to_num(statistic) / table.sum()))
    return np.asarray(np.max(values, axis=0))


_PROBABILITY_BINS = 10


def calibrate(share: ArrayLike, event: ArrayLike) -> Calibration:
    """Fit the probability of an event as a logistic function of the share of votes for it.

    Parameters
    ----------
    share
        Share of votes for the event in each window, within [0, 1], shape (n,).
    event
        Whether the event occurred in that window, shape (n,).

    Raises
    ------
    ValueError
        If the windows do not contain both outcomes.
    MavhumsError
        If a larger share of votes does not make the event likelier: the votes would be turned round.

    References
    ----------
    J. Platt: Probabilistic Outputs for Support Vector Machines and Comparisons to Regularized
    Likelihood Methods, 1999.

    Examples
    --------
    >>> calibrate([0.1, 0.2, 0.3, 0.7, 0.8, 0.9], [0, 0, 1, 0, 1, 1]).probability(0.9) > 0.8
    True
    """
    from sklearn.linear_model import LogisticRegression

    shares = np.asarray(share, dtype=np.float64)
    model = LogisticRegression(C=100.0).fit(shares[:, np.newaxis], np.asarray(event, dtype=np.bool_))
    # Rounded, so that a solver's last digits do not enter the model's hash.
    slope, intercept = round(float(model.coef_[0, 0]), 6), round(float(model.intercept_[0]), 6)
    if slope <= 0:
        raise MavhumsError(
            f"the network contradicts the flights that calibrate it: the larger its share of votes for an "
            f"emergency, the rarer is one (slope {slope:g}, which must be positive)",
            "check that no labels are exchanged; if they are right, give precedents a larger --flown-weight, "
            "or add flights",
        )
    return Calibration(slope=slope, intercept=intercept)


def brier_score(probability: ArrayLike, event: ArrayLike) -> float:
    """Return the mean squared difference of probability and outcome: 0 is perfect, 0.25 is a coin toss.

    Examples
    --------
    >>> brier_score([0.0, 0.5], [False, True])
    0.125
    """
    from sklearn.metrics import mean_squared_error

    return float(mean_squared_error(np.asarray(event, dtype=np.float64), probability))


def expected_calibration_error(probability: ArrayLike, event: ArrayLike) -> float:
    """Return the mean |probability − observed frequency| over ten bins, weighted by their counts.

    Examples
    --------
    >>> expected_calibration_error([0.75, 0.75, 0.75, 0.75], [1, 1, 1, 0])
    0.0
    """
    said, was = np.asarray(probability, dtype=np.float64), np.asarray(event, dtype=np.float64)
    bins = np.minimum((said * _PROBABILITY_BINS).astype(np.intp), _PROBABILITY_BINS - 1)
    excess = np.bincount(bins, weights=said - was, minlength=_PROBABILITY_BINS)
    return float(np.abs(excess).sum() / len(said))


_LEVELS = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.96, 0.97, 0.98, 0.985, 0.99, 0.995)
_SPARED = 0.7
"""Share of the allowed errors that the level may leave on the flights that it is chosen on: there the best of
several levels looks better than it is."""


def at_temperature(network: WindowNetwork, features: Array, classes: Integers) -> tuple[WindowNetwork, float]:
    """Return the network with its outputs divided by the temperature that fits other flights, and that.

    References
    ----------
    C. Guo, G. Pleiss, Y. Sun, K. Weinberger: On Calibration of Modern Neural Networks, 2017.
    """
    from scipy.optimize import minimize_scalar
    from scipy.special import log_softmax

    rows = network.inside(features)
    outputs, truth = network.outputs(network.inputs(features[rows])), classes[rows]

    def loss(log_temperature: float) -> float:
        found = log_softmax(outputs / np.exp(log_temperature), axis=1)
        return -float(found[np.arange(len(truth)), truth].mean())

    # Rounded, so that a solver's last digits do not enter the model's hash.
    temperature = round(float(np.exp(minimize_scalar(loss, bounds=(-3, 3), method="bounded").x)), 4)
    return replace(network, w2=network.w2 / temperature, b2=network.b2 / temperature), temperature


def decides_at(network: WindowNetwork, features: Array, classes: Integers, goal: float) -> float:
    """Return the least probability from which at least the share ``goal`` of the decided windows is right."""
    found, inside = network.probabilities(features), network.inside(features)
    top, right = found.max(axis=1), found.argmax(axis=1) == classes
    for level in _LEVELS:
        decided = inside & (top >= level)
        if decided.any() and right[decided].mean() >= 1 - _SPARED * (1 - goal):
            return level
    return _LEVELS[-1]
