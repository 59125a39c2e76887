import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.learn import CommandLeakWarning, check_command

Rows = tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]
TIME = np.linspace(0, 100, 2000)


def command(seed: int, low: float = 0.05, high: float = 0.5) -> NDArray[np.float64]:
    random = np.random.default_rng(seed)
    frequency, shift = random.uniform(low, high, 12), random.uniform(0, 6, 12)
    waves: NDArray[np.float64] = np.sin(2 * np.pi * frequency * TIME[:, None] + shift).sum(axis=1)
    return waves


def flown(normal: list[int], emergency: list[int], **emergency_options: float) -> Rows:
    parts = [command(seed) for seed in normal] + [command(seed, **emergency_options) for seed in emergency]
    flights = np.repeat(np.arange(len(parts)), len(TIME))
    return np.concatenate(parts), flights >= len(normal), flights


def test_one_cyclogram_for_both_classes_does_not_leak() -> None:
    leak = check_command(*flown([1], [1]))
    assert (leak.cramers_v, leak.p_value, leak.leaks) == (0, None, False)


def test_classes_flown_differently_leak_in_the_paper_s_split() -> None:
    values, emergency, flights = flown([1], [1])
    with pytest.warns(CommandLeakWarning, match="command distinguishes the classes"):
        leak = check_command(np.where(emergency, values + 3, values), emergency, flights)
    assert leak.leaks


def test_cyclograms_of_their_own_do_not_leak_but_a_pilot_who_knows_does() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        honest = check_command(*flown([1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12]))
    assert honest.p_value is not None
    assert honest.p_value > 0.01
    with pytest.warns(CommandLeakWarning):
        faster = check_command(*flown([1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12], low=1.0, high=1.5))
    assert faster.p_value is not None
    assert faster.p_value <= 0.01
