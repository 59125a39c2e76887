"""No output holds up recording or judging: what nobody takes is dropped, counted and said."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import signal
import sys
import threading
import time
import tty
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import mavhums
from mavhums.actuator.mapping import Samples
from mavhums.cli.live import StopSignal
from mavhums.live.outlet import Outlet, Spool
from mavhums.live.session import LiveSink
from mavhums.live.sinks import DrawingSink
from mavhums.log.mavlink.stamping import Piece
from tests.live.conftest import Rig
from tests.live.programs import Program, free_port, running, send
from tests.live.programs import mavhums as command


class Gate:
    """Takes items only while it is open."""

    def __init__(self) -> None:
        self.open = threading.Event()
        self.taken: list[Any] = []

    def take(self, item: Any) -> None:
        self.open.wait(30)
        self.taken.append(item)


def test_what_fails_is_said_once_and_again_when_it_works() -> None:
    said: list[str] = []
    full = True

    def take(item: int) -> None:
        if full:
            raise OSError(28, "No space left on device")

    outlet = Outlet("disk", take, report=said.append)
    for k in range(5):
        outlet.put(k)
    while outlet.dropped < 5:
        time.sleep(0.001)
    assert outlet.error == "No space left on device"
    full = False
    outlet.put(6)
    assert outlet.close(30)
    assert outlet.error is None
    assert said == [
        "disk: No space left on device; its output is dropped, everything else continues",
        "disk: works again; 5 dropped",
    ]


def test_a_spool_shows_what_the_stream_cannot_encode() -> None:
    raw = io.BytesIO()
    spool = Spool(io.TextIOWrapper(raw, encoding="cp1252", errors="replace"), "old terminal")
    spool.write("undecided → emergency\n")
    assert spool.finish(time.monotonic() + 30)
    assert raw.getvalue().startswith(b"undecided ? emergency")
    assert (spool.encoding, spool.isatty()) == ("cp1252", False)


def test_a_program_without_an_output_runs() -> None:
    spool = Spool(None, "none")
    print("nothing", file=spool, flush=True)
    assert spool.finish(time.monotonic() + 30)
    assert not spool.isatty()
    with pytest.raises(io.UnsupportedOperation):
        spool.fileno()


class Hanging(LiveSink):
    """A viewer that hangs in the first call."""

    trouble = None

    def __init__(self) -> None:
        self.gate = Gate()

    def consume(self, events: object) -> None:
        self.gate.take(events)


@pytest.mark.slow
def test_a_viewer_that_hangs_holds_up_nothing_and_one_that_keeps_up_sees_everything(
    rig: Rig, worn_pieces: list[Piece]
) -> None:
    hangs, follows, released = Hanging(), Hanging(), threading.Event()
    follows.gate.open.set()
    hanging = DrawingSink(hangs, "viewer", list, patience_s=0.01)  # type: ignore[arg-type]
    following = DrawingSink(follows, "other", released.set, patience_s=30)  # type: ignore[arg-type]
    rig.session.sinks += [hanging, following]
    rig.session.status.outlets.append(hanging.outlet)
    rig.hear(worn_pieces)
    rig.end()
    assert not hanging.finish()
    assert hanging.outlet.dropped > 100
    hangs.gate.open.set()
    assert following.finish()
    assert released.is_set()
    seen = [event for events in follows.gate.taken for event in events]
    there, here = ([e for e in events if isinstance(e, Samples)] for events in (seen, rig.shown.events))
    assert sum(e.time_s.size for e in there) == sum(e.time_s.size for e in here)


def test_before_it_has_begun_a_signal_ends_it_at_once() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a command that ran here may have left its own
    try:
        with pytest.raises(KeyboardInterrupt), StopSignal(None):
            signal.raise_signal(signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_second_signal_breaks_off(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # the tests themselves may run under nohup
    try:
        with StopSignal(None) as stop:
            stop.begun = True
            assert not stop()
            signal.raise_signal(number)
            assert stop()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(number)
    finally:
        signal.signal(number, before)


def test_a_hang_up_that_was_to_be_ignored_is() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopSignal(None) as stop:
            stop.begun = True
            signal.raise_signal(signal.SIGHUP)
            assert not stop()
    finally:
        signal.signal(signal.SIGHUP, before)


def fly(live: Program, port: int, pieces: list[Piece], recording: Path) -> None:
    """Send a flight once it listens, wait until it is recorded, and end it."""
    live.wait_for(recording.exists)
    time.sleep(0.5)
    send(port, pieces)
    size = sum(len(piece.data) + 8 for piece in pieces)
    live.wait_for(lambda: recording.stat().st_size >= size)
    assert live.stop() == mavhums.analyse(recording).exit_code


@pytest.mark.slow
@pytest.mark.skipif(find_spec("serial") is None, reason="no serial port package (pip install pyserial)")
def test_nobody_reads_standard_output_nor_alerts(tmp_path: Path, worn_pieces: list[Piece]) -> None:
    """The pipe and the serial port are full before it starts; it records, and ends on demand."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(1 << 12))
    os.set_blocking(writer, True)
    master, slave = pty.openpty()
    tty.setraw(master)
    recording, port = tmp_path / "live.tlog", free_port()
    links = [f"udpin:{port}", f"serial:{os.ttyname(slave)}:115200"]
    arguments = command("live", *links, "--json", "--alerts", "--record", recording)
    with running(tmp_path, "live", *arguments, stdout=writer) as live:
        fly(live, port, worn_pieces, recording)
    for descriptor in (reader, writer, master, slave):
        os.close(descriptor)
    assert "standard output: " in live.output


def closed_pipe() -> int:
    reader, writer = os.pipe()
    os.close(reader)
    return writer


@pytest.mark.slow
@pytest.mark.parametrize("out", ["/dev/full", "closed pipe"])
def test_an_output_that_fails_ends_nothing(tmp_path: Path, worn_pieces: list[Piece], out: str) -> None:
    recording, port = tmp_path / "live.tlog", free_port()
    stdout = closed_pipe() if out == "closed pipe" else os.open(out, os.O_WRONLY)
    arguments = command("live", f"udpin:{port}", "--json", "--record", recording)
    with running(tmp_path, "live", *arguments, stdout=stdout) as live:
        fly(live, port, worn_pieces, recording)
    os.close(stdout)
    assert "its output is dropped, everything else continues" in live.output


@pytest.mark.slow
def test_a_closed_pipe_ends_what_has_no_other_purpose(tmp_path: Path) -> None:
    writer = closed_pipe()
    with running(tmp_path, "live", *command("live", "udpin:0", "--json"), stdout=writer) as live:
        assert live.process.wait(60) == 12
    os.close(writer)


if sys.platform == "win32":
    pytest.skip("pipes and signals of POSIX", allow_module_level=True)
