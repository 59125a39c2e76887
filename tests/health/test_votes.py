"""The network's votes: whose count, and when it abstains."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.health.motion import Motion
from mavhums.health.slots import Slots
from mavhums.health.votes import count_votes, vote_share


class Threshold:
    """Calls an emergency where V5 exceeds one ampere; knows only positive currents."""

    def p_emergency(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return (values[:, 4] > 1.0).astype(float)

    def inside(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.array(values[:, 4] > 0)


def test_only_moving_samples_inside_the_envelope_vote() -> None:
    values = np.zeros((8, 14))
    values[:, 4] = [2.0, 2.0, 0.5, -1.0, 2.0, 2.0, 2.0, 9.0]
    moving = np.array([True, True, True, True, False, False, True])
    slots = Slots(np.array([3, 5]), np.array([0, 5]), slice(0, 7), np.arange(8.0), values)
    seen = Motion(moving, np.ones(7), np.zeros(7), values[:7, :12], values[:7, 12])
    assert count_votes(Threshold(), slots, seen).tolist() == [[4, 3, 2], [1, 1, 1]]
    nobody = seen._replace(moving=np.zeros(7, dtype=bool))
    assert count_votes(Threshold(), slots, nobody).tolist() == [[0, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize(
    ("slots", "share"),
    [
        ([[0, 0, 0]], np.nan),
        ([[19, 19, 19]], np.nan),
        ([[100, 49, 49]], np.nan),
        ([[100, 50, 10], [20, 20, 20]], 30 / 70),
    ],
)
def test_the_network_abstains_on_few_or_foreign_samples(slots: list[list[float]], share: float) -> None:
    assert vote_share(np.array([slots], dtype=float)).tolist() == pytest.approx([share], nan_ok=True)
