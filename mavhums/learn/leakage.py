"""Test for leakage: a command that differs between the classes reveals the class to a classifier."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CommandLeak", "CommandLeakWarning", "check_command"]

_BINS = 12
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


def _change(values: NDArray[np.float64], flight: NDArray[np.intp]) -> NDArray[np.float64]:
    change = np.diff(values, prepend=values[:1])
    change[np.diff(flight, prepend=flight[:1]) != 0] = 0
    return change


def _per_flight(feature: NDArray[np.float64], flight: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the number of samples of each flight in each bin, shape (flights, bins)."""
    counts, _, _ = np.histogram2d(flight, feature, bins=[np.arange(flight.max() + 2), _BINS])
    return np.asarray(counts[:, counts.any(axis=0)])


def _cramers_v(tables: list[NDArray[np.float64]], labels: NDArray[np.bool_]) -> NDArray[np.float64]:
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
