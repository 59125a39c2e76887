"""A program that is told to end leaves no half-written file, hidden or not."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)])
@pytest.mark.parametrize("command", [pytest.param("export", marks=pytest.mark.slow), "analyse"])
def test_a_signal_leaves_no_part_file(
    tmp_path: Path, short_log: Path, command: str, number: signal.Signals
) -> None:
    """The log comes through a pipe that never ends, so that the signal always comes amid the work."""
    if command == "analyse":
        pytest.importorskip("rerun")
        log = tmp_path / "in" / "long.tlog"
        log.parent.mkdir()
        log.write_bytes(short_log.read_bytes() * 300)
    else:
        log = Path("-")
    out = tmp_path / "out"
    out.mkdir()
    arguments = {"export": ["-o", out / "v.csv"], "analyse": ["--rrd", out / "f.rrd"]}[command]
    program = subprocess.Popen(
        [sys.executable, "-m", "mavhums", command, str(log), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    assert program.stdin is not None
    if command == "export":
        program.stdin.write(short_log.read_bytes() * 60)  # no pipe holds as much: it is being read
        program.stdin.flush()
    deadline = time.monotonic() + 60
    while command == "analyse" and not list(out.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)
    program.send_signal(number)
    _, complaint = program.communicate(timeout=60)
    assert program.returncode in (128 + number, 0, 12), complaint
    assert [path for path in out.iterdir() if path.name.startswith(".")] == []
    if program.returncode == 128 + number:
        assert list(out.iterdir()) == []
    assert b"Traceback" not in complaint
