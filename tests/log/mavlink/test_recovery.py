"""Of a damaged log every undamaged frame is found, and nothing else."""

from __future__ import annotations

import pytest

from tests.log.mavlink.recovery import KINDS, SPACINGS, recover


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("spacing", SPACINGS)
def test_undamaged_frames_are_found_and_nothing_else(kind: str, spacing: int) -> None:
    row = recover(7, 3000, kind, spacing)
    assert row.found == row.undamaged > 0
    assert row.false == 0
    assert row.written_frames_found >= row.by_pymavlink > 0
