"""Of a damaged log never fewer good records than pyulog gets, and hardly a false one."""

from __future__ import annotations

import random

import pytest

from tests.log.ulog import writer
from tests.log.ulog.recovery import DAMAGE, ours, score, theirs

LOG = writer.flight(60.0)
SOUND = theirs(LOG)
FALSE = {"200 bit flips": 190}
"""Of flips most hit a record's values, which nothing protects; each can make one false record."""


def test_the_sound_log_is_the_same_from_both() -> None:
    assert ours(LOG) == SOUND
    assert SOUND.total() > 4000


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", DAMAGE)
def test_damage_costs_no_more_than_it_costs_pyulog(name: str, seed: int) -> None:
    damaged = DAMAGE[name](random.Random(seed), LOG)
    good, false = score(ours(damaged), SOUND)
    assert good >= score(theirs(damaged), SOUND)[0]
    assert false <= FALSE.get(name, 2)
