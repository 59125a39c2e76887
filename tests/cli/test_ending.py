"""A program that is asked to end leaves no half-written file, hidden or not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
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


@pytest.mark.parametrize(
    ("done", "code"),
    [
        ("signal.raise_signal(signal.SIGINT)", -signal.SIGINT),
        ("sys.argv[1:] = ['check']; main()", 128 + signal.SIGINT),
    ],
)
def test_a_signal_amid_an_import_gives_no_traceback(done: str, code: int) -> None:
    """Before the commands are loaded, and where a library turns the interruption into its own error."""
    program = f"""
import signal, sys
from mavhums.__main__ import main
import click
import mavhums.cli.tools
@click.command()
def loads():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt as error:
        raise ImportError("core failed to import") from error
mavhums.cli.tools.check = loads
{done}
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stderr) == (code, "")


BLOCKED = {
    "model show": "stdout",
    "analyse {missing}": "stderr",
    "analyse {log} --json": "stdout",
    "report {log} -o {pipe}": "",
    "export - -o {folder}/v.csv": "stdin",
    "inspect {log} --json": "stdout",
    "fleet scan {folder}/logs --store {folder}/store --airframe {pipe}": "",
    "fleet watch {folder}/logs --store {folder}/store --settle 0 --workers 0": "stdout",
    "live udpin:14996 --key {pipe}": "",
    "live udpin:14996 --log-level info": "stderr",
    "serve --port 0": "stdout",
}


@pytest.mark.parametrize(
    ("commands", "number"),
    [
        (["model show"], signal.SIGTERM),
        pytest.param([*BLOCKED], signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param([*BLOCKED], signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_a_signal_ends_programs_that_wait_for_others(
    commands: list[str], number: signal.Signals, short_log: Path, tmp_path: Path
) -> None:
    """A pipe without another end, a reader that has stopped; all end some seconds after the signal."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.tlog").write_bytes(short_log.read_bytes())
    os.mkfifo(tmp_path / "pipe")
    missing = " ".join(f"/missing{k}" for k in range(300))
    names = {"log": short_log, "folder": tmp_path, "pipe": tmp_path / "pipe", "missing": missing}
    reading, full = os.pipe()
    os.set_blocking(full, False)
    for size in (4096, 1):
        with suppress(BlockingIOError):
            while True:
                os.write(full, bytes(size))
    os.set_blocking(full, True)
    programs = {}
    try:
        for command in commands:
            streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
            if BLOCKED[command]:
                streams[BLOCKED[command]] = reading if BLOCKED[command] == "stdin" else full
            programs[command] = subprocess.Popen(
                [sys.executable, "-m", "mavhums", *command.format(**names).split()],
                env=os.environ | {"PYTHONUNBUFFERED": ""},
                **streams,  # type: ignore[call-overload]
            )
        time.sleep(2 * len(commands))
        for program in programs.values():
            program.send_signal(number)
        for command, program in programs.items():
            try:
                program.wait(timeout=60)
            except subprocess.TimeoutExpired:
                pytest.fail(f"{command} goes on")
    finally:
        for program in programs.values():
            program.kill()
            program.wait()
        os.close(reading)
        os.close(full)
