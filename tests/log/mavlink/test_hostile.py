"""Hostile and damaged input: a small part of ``tests/log/hostile.py``, and each undamaged frame is found."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mavhums.log import Decoder
from tests.log.mavlink.hostile import check
from tests.log.mavlink.recovery import KINDS, SPACINGS, recover


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_mutated_records_are_accounted_for(seed: int) -> None:
    size, frames = check(3000, seed)
    assert size > 100_000
    assert frames > 1000


@pytest.mark.slow
def test_no_access_outside_the_arrays(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "tests.log.hostile", "mavlink", "--mutations", "2000", "--seed", "4"]
    folder = Path(__file__).parents[3]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=True)
    assert "no difference" in done.stdout


@pytest.mark.parametrize("pattern", [b"\xfd", b"\xfe", b"\xfd\x00", b"\x00\xfe\xff", b"\xff"])
def test_the_worst_patterns_take_no_more_than_linear_time(pattern: bytes) -> None:
    data = pattern * (300_000 // len(pattern))
    begin = time.process_time()
    decoder = Decoder()
    decoder.feed(data, final=True)
    assert time.process_time() - begin < 5
    losses = decoder.losses
    assert losses.bytes_skipped + losses.cut_end_bytes + losses.trailing_zeros <= len(data)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("spacing", SPACINGS)
def test_undamaged_frames_are_found_and_nothing_else(kind: str, spacing: int) -> None:
    row = recover(7, 3000, kind, spacing)
    assert row.found == row.undamaged > 0
    assert row.false == 0
    assert row.written_frames_found >= row.by_pymavlink > 0
