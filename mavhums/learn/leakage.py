"""Does the command carry the class? Then a classifier reads the pilot, not the actuator."""

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
    """How far the command tells the classes apart.

    Attributes
    ----------
    cramers_v
        Of the command or of its rate, the larger: 0 if the classes flew alike, 1 if they share nothing.
    p_value
        Part of the ways to label the flights that give so large a value; None with too few flights.
    leaks
        Whether that is more than chance.
    """

    cramers_v: float
    p_value: float | None
    leaks: bool


def check_command(
    command: ArrayLike, emergency: ArrayLike, flights: ArrayLike, *, random_state: int = 0
) -> CommandLeak:
    """Measure the association of command and class, and warn if it is more than chance.

    Cramér's V comes from the chi-square of the command V1, and of its change from sample to
    sample, in twelve bins. Chance is what relabelling whole flights gives; where there are fewer
    than five hundred ways to relabel them, as in the paper's split, the command leaks if Cramér's V
    exceeds 0.25. The paper gives the command a chi-square of 40,590, which classes that fly one
    cyclogram cannot have: theirs is 0.

    Parameters
    ----------
    command
        V1 of each sample, °, shape (n,), each flight in the order of time.
    emergency, flights
        Class and flight of each sample, shape (n,).
    random_state
        Of the relabelling.

    Warns
    -----
    CommandLeakWarning
        If the command carries the class.

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
            f"the command tells the classes apart (Cramér's V {found:.2f}): "
            "fly both classes through the same cyclograms, or each flight through one of its own",
            CommandLeakWarning,
            stacklevel=2,
        )
    return CommandLeak(found, p_value, leaks)


def _change(values: NDArray[np.float64], flight: NDArray[np.intp]) -> NDArray[np.float64]:
    change = np.diff(values, prepend=values[:1])
    change[np.diff(flight, prepend=flight[:1]) != 0] = 0
    return change


def _per_flight(feature: NDArray[np.float64], flight: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return how many samples of each flight lie in each of the bins, shape (flights, bins)."""
    counts, _, _ = np.histogram2d(flight, feature, bins=[np.arange(flight.max() + 2), _BINS])
    return np.asarray(counts[:, counts.any(axis=0)])


def _cramers_v(tables: list[NDArray[np.float64]], labels: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the larger of the tables' values for each way to label the flights, shape (ways,)."""
    values = []
    for table in tables:
        total, share = table.sum(axis=0), (labels @ table.sum(axis=1) / table.sum())[:, None]
        excess = labels @ table - share * total
        # Of two classes the one's excess in a bin is what the other lacks there.
        with np.errstate(invalid="ignore"):
            statistic = (np.square(excess) / (total * share * (1 - share))).sum(axis=1)
        values.append(np.sqrt(np.nan_to_num(statistic) / table.sum()))
    return np.asarray(np.max(values, axis=0))
