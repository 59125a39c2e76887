"""Samples held out for validation, whole flights where there are enough of them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["hold_out"]

_HELD_OUT = 0.25
_BLOCKS = 12


def hold_out(
    emergency: NDArray[np.bool_], flight: NDArray[np.intp], random: np.random.Generator
) -> tuple[NDArray[np.bool_], Literal["flights", "blocks"]]:
    """Choose a quarter of each class's flights, or of blocks of time where flights are too few.

    Where each class has at least two flights, whole flights are held out; a flight belongs to the
    class of most of its samples. With fewer, as in the paper's split, each flight is cut into
    twelve equal blocks of time, and whole blocks are held out.

    Parameters
    ----------
    emergency
        Class of each sample, shape (n,).
    flight
        Number of each sample's flight, from 0, shape (n,), each flight in the order of time.
    random
        Draws the flights.

    Returns
    -------
    NDArray, str
        Which samples are held out, shape (n,), and what was held out.

    Raises
    ------
    ValueError
        If a class has not even two blocks.
    """
    chosen = _choose(emergency, flight, random)
    if chosen is not None:
        return np.isin(flight, chosen), "flights"
    blocks = np.empty_like(flight)
    for number in np.unique(flight):
        rows = np.flatnonzero(flight == number)
        blocks[rows] = number * _BLOCKS + np.arange(len(rows)) * _BLOCKS // len(rows)
    chosen = _choose(emergency, blocks, random)
    if chosen is None:
        raise ValueError("each class needs samples enough to hold some out, in two blocks of time at least")
    return np.isin(blocks, chosen), "blocks"


def _choose(
    emergency: NDArray[np.bool_], group: NDArray[np.intp], random: np.random.Generator
) -> NDArray[np.intp] | None:
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
