"""A first call says that it compiles, and warm-up leaves nothing to compile."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mavhums.cli.output import announce_compiling
from mavhums.core import startup
from mavhums_sim import Flight, fly, write_dataflash
from mavhums_sim.closed_loop import ClosedLoop, fly_closed_loop
from mavhums_sim.closed_loop.log import write_loop
from tests.log.ulog.writer import flight as ulog_flight


def test_compiling_is_announced_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(startup, "_listeners", [])
    announce_compiling()
    assert capsys.readouterr().err == ""
    for _ in range(3):
        startup.notify_of_compilation()
    assert capsys.readouterr().err.count("compiling its inner loops for this machine, once") == 1


def test_a_loop_that_is_compiled_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    import numba

    from mavhums.core import kernels

    assert kernels.kernel is not None
    told: list[int] = []
    monkeypatch.setattr(startup, "_listeners", [lambda: told.append(1)])
    assert numba.njit(lambda x: x + 1)(1) == 2
    assert told


@pytest.mark.slow
def test_nothing_is_left_to_compile_after_a_warm_up(tmp_path: Path, growing_log: Path) -> None:
    """A first log of any format, with actuators and with axes, is judged at once."""
    axes, on_board, px4 = tmp_path / "axes.tlog", tmp_path / "on_board.BIN", tmp_path / "px4.ulg"
    write_loop(fly_closed_loop(ClosedLoop(seed=3, duration_s=60.0)), axes)
    write_dataflash(fly(Flight(seed=4, duration_s=20.0, rate_hz=20.0, tiers=("csrv", "pwm"))), on_board)
    px4.write_bytes(ulog_flight(30.0))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "mavhums", *map(str, arguments)]
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=600, check=False
        )

    first = call("warm-up")
    assert first.returncode == 0
    assert "compiling its inner loops" in first.stderr
    assert first.stdout.startswith("ready: ")
    for log in (growing_log, axes, on_board, px4):
        assert "compiling" not in call("analyse", log).stderr, log
    assert "compiling" not in call("inspect", growing_log).stderr
    assert "compiling" not in call("warm-up").stderr
