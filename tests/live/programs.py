"""The programs that a user starts, as processes."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mavhums.log.mavlink.stamping import Piece

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "sim")])}


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


class Program:
    """A running program and what it printed."""

    def __init__(self, process: subprocess.Popen[str], out: Path) -> None:
        self.process = process
        self._out = out

    @property
    def output(self) -> str:
        return self._out.read_text(encoding="utf-8", errors="replace")

    def objects(self, event: str | None = None) -> list[dict[str, Any]]:
        """The JSON objects printed so far; the last line may be unfinished."""
        lines = self.output.split("\n")[:-1]
        objects = [json.loads(line) for line in lines if line.startswith("{")]
        return [one for one in objects if event in (None, one["event"])]

    def wait_for(self, found: Callable[[], object], timeout_s: float = 60.0) -> None:
        until = time.monotonic() + timeout_s
        while not found():
            assert self.process.poll() is None, self.output
            assert time.monotonic() < until, self.output
            time.sleep(0.05)

    def stop(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(timeout=60)


@contextmanager
def running(folder: Path, name: str, *command: str, stdout: Any = None) -> Iterator[Program]:
    """A program in a folder, its output in a file, its standard output also elsewhere; killed at the end."""
    out = folder / f"{name}.out"
    with out.open("w") as file:
        more: Any = {"stdout": stdout or file, "stderr": file, "text": True}
        process = subprocess.Popen(command, cwd=folder, env=ENVIRONMENT, **more)
    try:
        yield Program(process, out)
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def mavhums(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "mavhums", *map(str, arguments)]


def send(port: int, pieces: Sequence[Piece]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for k, piece in enumerate(pieces):
            out.sendto(piece.data, ("127.0.0.1", port))
            if k % 50 == 0:
                time.sleep(0.002)


@contextmanager
def hearing(folder: Path, pieces: Sequence[Piece], *arguments: str | Path) -> Iterator[Program]:
    """``mavhums live`` with a link of UDP, to which pieces were sent."""
    port = free_port()
    with running(folder, "live", *mavhums("live", f"udpin:{port}", *arguments)) as live:
        begin = '"event":"start"' if "--json" in arguments else "listening: udpin:127.0.0.1:"
        live.wait_for(lambda: begin in live.output)
        send(port, pieces)
        yield live


def simulator(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "mavhums_sim", *arguments]
