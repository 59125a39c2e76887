"""The search of the alignment finds the row that a bisection finds, whatever it guesses."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mavhums.actuator._align import _near

ROWS = st.lists(st.integers(0, 20), min_size=1, max_size=12).map(sorted)


@given(rows=ROWS, least=st.integers(-1, 21), guess=st.integers(0, 12), data=st.data())
def test_any_guess_gives_the_first_row(rows: list[int], least: int, guess: int, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(rows)))
    end = data.draw(st.integers(start, len(rows)))
    first = start + int(np.searchsorted(rows[start:end], least))
    assert _near(np.array(rows), start, end, least, guess) == first
