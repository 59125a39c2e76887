"""A few thousand mutations at every run; ``hostile.py`` does a million, with checked array bounds."""

from __future__ import annotations

import random

from tests.log.ulog import writer
from tests.log.ulog.hostile import check
from tests.log.ulog.peer import decode


def test_mutated_logs_are_the_same_log_however_they_are_cut() -> None:
    size, found = check(4000, seed=5)
    assert size > 500_000
    assert found > 1000


def test_noise_behind_a_header_yields_nothing() -> None:
    rng = random.Random(6)
    log = writer.header() + rng.randbytes(1 << 20)
    tables, decoder = decode(log)
    assert sum(map(len, tables.values())) == 0
    assert decoder.losses.bytes_skipped + decoder.losses.cut_end_bytes == 1 << 20
    assert decoder.losses.damaged_regions <= 2
