"""Damaged logs of each format through every command that reads one."""

from __future__ import annotations

import pytest

from benchmarks.damaged import default_logs, run


@pytest.mark.slow
def test_no_command_fails_on_a_damaged_log() -> None:
    assert run(default_logs(), count=8, seed=7) == {}
