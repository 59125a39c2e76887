"""What is kept of a flight's rows: whole seconds, runs without a gap, the last twenty minutes."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from mavhums.vehicle.facts import ALL_OUTPUTS
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import PastRows, Rows
from tests.present import present

FLAGS = ("flying", "up", "aloft", "trusted", "settled")


def part(second: int, seconds: int, *, fresh: bool = False) -> tuple[Rows, np.ndarray]:
    """Rows whose every number is the flight time, s, in which it is aloft in odd seconds; output 3 is on."""
    time_s = second + np.arange(seconds * RATE_HZ) / RATE_HZ
    odd = np.floor(time_s) % 2 == 1
    arrays: dict[str, Any] = {one.name: odd if one.name in FLAGS else time_s for one in fields(Rows)[2:]}
    arrays["outputs"] = np.zeros((len(time_s), 3))
    pulses = np.full((len(time_s), ALL_OUTPUTS), np.nan)
    pulses[:, 2] = 1000.0 + time_s
    return Rows(second, fresh, **arrays), pulses


def kept(*parts: tuple[Rows, np.ndarray]) -> PastRows:
    past = PastRows()
    for one in parts:
        past.add(*one)
    return past


def test_runs_are_joined_up_to_a_gap() -> None:
    past = kept(part(5, 2, fresh=True), part(7, 3), part(20, 1, fresh=True))
    runs = [*past]
    assert [(rows.second, rows.fresh, rows.seconds) for rows, _ in runs] == [(5, True, 5), (20, True, 1)]
    rows, pulses = runs[0]
    assert rows.roll.tolist() == (5 + np.arange(100) / RATE_HZ).tolist()
    assert pulses[:, 2].tolist() == (1005 + np.arange(100) / RATE_HZ).tolist()
    assert np.isnan(np.delete(pulses, 2, axis=1)).all()
    assert np.isnan(rows.outputs).all()
    assert rows.flying.tolist() == rows.aloft.tolist() == [k // 20 % 2 == 0 for k in range(100)]
    assert rows.trusted.dtype == bool


@pytest.mark.parametrize(
    ("seconds", "until_s", "first", "count"),
    [
        (3, np.inf, 8, 3),
        (4, np.inf, 7, 4),
        (99, np.inf, 5, 6),
        (2, 8.0, 6, 2),
        (2, 7.9, 5, 2),
        (9, 20.0, 5, 5),
    ],
)  # fmt: skip
def test_the_last_seconds_before_a_time(seconds: int, until_s: float, first: int, count: int) -> None:
    """Seconds 5 to 9 and 20; a second that is not over by then does not count."""
    past = kept(part(5, 2, fresh=True), part(7, 3), part(20, 1, fresh=True))
    found = present(past.last(seconds, until_s))
    rows, pulses = found
    assert (rows.roll[0], rows.seconds, len(pulses)) == (first, count, count * RATE_HZ)
    np.testing.assert_array_equal(pulses[:, 2], 1000.0 + rows.roll)


def test_the_oldest_rows_go_after_twenty_minutes() -> None:
    past = kept(part(0, 700, fresh=True), part(700, 500))
    assert past.is_whole
    past.add(*part(1200, 3))
    assert not past.is_whole
    [(rows, pulses)] = past
    assert (rows.second, rows.fresh, rows.seconds) == (3, True, 1200)
    assert (rows.roll[0], pulses[0, 2]) == (3.0, 1003.0)
    past.add(*part(1203, 697))  # exactly what is left of the first part
    [(rows, _)] = past
    assert (rows.second, rows.seconds) == (700, 1200)
    past.add(*part(1900, 1300))
    assert [(rows.second, rows.seconds) for rows, _ in past] == [(2000, 1200)]
