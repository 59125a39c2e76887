"""Hold-out of validation samples: whole flights where there are enough, otherwise blocks of time."""

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
    """Hold out a quarter of each class's flights, or of its blocks of time if flights are too few.

    If each class has at least two flights, whole flights are held out; a flight belongs to the
    class of most of its samples. With fewer flights, as in the paper's split, each flight is
    divided into twelve equal blocks of time, and whole blocks are held out.

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
    blocks = np.empty_like(flight)
    for number in np.unique(flight):
        rows = np.flatnonzero(flight == number)
        blocks[rows] = number * _BLOCKS + np.arange(len(rows)) * _BLOCKS // len(rows)
    chosen = _choose(emergency, blocks, random)
    if chosen is None:
        raise ValueError("each class needs enough samples to hold some out: at least two blocks of time")
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
