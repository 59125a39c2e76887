"""Hostile and damaged input: some of the mutations of ``hostile.py``, and what pyulog gets of damage."""

from __future__ import annotations

import random

import pytest

from tests.log.decode import decode
from tests.log.ulog import writer
from tests.log.ulog.hostile import check
from tests.log.ulog.recovery import COUNTS, damaged, ours, score, theirs


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


LOG = writer.flight(60.0)
SOUND = theirs(LOG)
FALSE = {"flips": 190}
"""Of flips most hit a record's values, which nothing protects; each can make one false record."""


def test_the_sound_log_is_the_same_from_both() -> None:
    assert ours(LOG) == SOUND
    assert SOUND.total() > 4000


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", [*COUNTS, "cut at 60 %"])
def test_damage_costs_no_more_than_it_costs_pyulog(name: str, seed: int) -> None:
    log = damaged(LOG, name, seed)
    good, false = score(ours(log), SOUND)
    assert good >= score(theirs(log), SOUND)[0]
    assert false <= FALSE.get(name, 2)
