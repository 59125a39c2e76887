"""``mavhums live`` as a user starts and stops it."""

from __future__ import annotations

import errno
import json
import os
import pty
import signal
import socket
import threading
import time
import tty
from importlib.util import find_spec
from pathlib import Path

import pytest

import mavhums
from mavhums.log.mavlink.stamping import Piece
from tests.conftest import Run
from tests.live.conftest import KEY, verdicts
from tests.live.programs import Program, hearing, running
from tests.live.programs import mavhums as command


def frames_heard(live: Program) -> int:
    statuses = live.objects("status")
    return int(statuses[-1]["link"]["frames"]) if statuses else 0


@pytest.mark.slow
def test_kill_9_costs_at_most_a_second(tmp_path: Path, worn_pieces: list[Piece]) -> None:
    recording = tmp_path / "live.tlog"
    with hearing(tmp_path, worn_pieces, "--json", "--record", recording) as live:
        live.wait_for(lambda: frames_heard(live) == len(worn_pieces))
        live.process.kill()
        live.process.wait()
    log = mavhums.read_log(recording)
    assert not log.losses.any
    assert sum(log.counts.values()) == len(worn_pieces)


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_signals_end_it_with_the_verdicts(tmp_path: Path, worn_pieces: list[Piece], number: int) -> None:
    with hearing(tmp_path, worn_pieces, "--record", tmp_path / "flight-%Y.tlog") as live:
        time.sleep(0.5)
        code = live.stop(number)
    assert "Not an airworthiness decision" in " ".join(live.output.split())
    recording = next(tmp_path.glob("flight-20??.tlog"))
    assert f"recorded: {recording}" in live.output.replace("\n", "")
    assert code == mavhums.analyse(recording).exit_code


@pytest.mark.slow
def test_only_signed_frames_are_heard_and_former_ones_never_again(
    tmp_path: Path, worn_pieces: list[Piece]
) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as v2

    key = tmp_path / "key"
    key.write_text(KEY.hex())
    signer = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    signer.signing.secret_key, signer.signing.sign_outgoing = KEY, True
    signer.signing.timestamp = 5_000_000_000
    attitude = v2.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)
    signed = [Piece(None, 0, bytes(attitude.pack(signer))) for _ in range(20)]
    for again, accepted, replayed in ((2, 20, 10), (1, 0, 20)):
        sent = worn_pieces[:40] + signed[:10] + signed[10:] * again
        with hearing(tmp_path, sent, "--json", "--key", key) as live:
            time.sleep(1.0)
            live.stop()
        link = live.objects("end")[0]["link"]
        counts = (link["frames"], link["unsigned_frames"], link["replayed_frames"])
        assert counts == (accepted, 40, replayed)
    assert json.loads((tmp_path / "key.seen").read_text())["0/1/1"] >= 5_000_000_019


class Server(threading.Thread):
    """A TCP server that sends, breaks the connection, and sends on to who comes again."""

    def __init__(self, halves: list[bytes]) -> None:
        super().__init__(daemon=True)
        self._halves = halves
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]

    def run(self) -> None:
        for half in self._halves:
            connection, _ = self._socket.accept()
            with connection:
                connection.sendall(half)
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(4096):  # what lies unread would reset the connection, and lose the rest
                    pass
        self._socket.close()


@pytest.mark.slow
def test_tcp_is_connected_again(tmp_path: Path, worn_pieces: list[Piece]) -> None:
    whole = b"".join(piece.data for piece in worn_pieces)
    middle = len(whole) // 2 + 5
    server = Server([whole[:middle], whole[middle:]])
    server.start()
    recording = tmp_path / "live.tlog"
    url = f"tcp:127.0.0.1:{server.port}"
    with running(
        tmp_path, "live", *command("live", url, "--json", "--log-level", "info", "--record", recording)
    ) as live:
        live.wait_for(lambda: frames_heard(live) > len(worn_pieces) - 3)
        live.stop()
    assert live.output.count(": connected") == 2
    end = live.objects("end")[0]
    assert end["link"]["bytes"] == len(whole)
    assert end["link"]["frames"] >= len(worn_pieces) - 1, "at most the frame that the break cut"
    assert end["assessment"]["verdicts"] == verdicts(mavhums.analyse(recording))


@pytest.mark.slow
@pytest.mark.skipif(find_spec("serial") is None, reason="no serial port package (pip install pyserial)")
def test_a_serial_device(tmp_path: Path, worn_pieces: list[Piece]) -> None:
    master, slave = pty.openpty()
    tty.setraw(master)
    url = f"serial:{os.ttyname(slave)}:115200"
    with running(tmp_path, "live", *command("live", url, "--json")) as live:
        live.wait_for(lambda: live.objects("start"))
        for piece in worn_pieces[:500]:
            os.write(master, piece.data)
            time.sleep(0.0002)
        live.wait_for(lambda: frames_heard(live) == 500)
        live.stop()
    os.close(master)
    os.close(slave)


@pytest.mark.slow
def test_udpout_makes_itself_known(tmp_path: Path, worn_pieces: list[Piece]) -> None:
    """A server sends to who has spoken to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        server.settimeout(30)
        url = f"udpout:127.0.0.1:{server.getsockname()[1]}"
        with running(tmp_path, "live", *command("live", url, "--json")) as live:
            hello, peer = server.recvfrom(300)
            assert hello[7] == 0, "a HEARTBEAT"
            for piece in worn_pieces[:200]:
                server.sendto(piece.data, peer)
            live.wait_for(lambda: frames_heard(live) == 200)
            live.stop()


def test_a_port_that_others_reach_is_warned_of(run: Run, tmp_path: Path) -> None:
    outcome = run("live", "udpin:0.0.0.0:0", "--duration", "0.2")
    assert "other computers can send here, too, without authentication; --key" in outcome.err
    key = tmp_path / "key"
    key.write_bytes(KEY)
    outcome = run("live", "udpin:0.0.0.0:0", "--duration", "0.2", "--key", key)
    assert "other computers can send here, too\n" in outcome.err
    assert "WARNING" not in run("live", "udpin:0", "--duration", "0.2").err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["14550"], "'14550' is not the address of a link"),
        (["udpin:nonesuch.invalid:1"], "no such host"),
        (["serial:/dev/nonesuch"], "/dev/nonesuch"),
        (["udpin:0", "--airframe", "nonesuch"], "nonesuch"),
        (["udpin:0", "--key", "nonesuch"], "nonesuch: No such file"),
        (["udpin:0", "--record", "nonesuch/a.tlog"], "cannot write nonesuch/a.tlog"),
        (["udpin:0", "--alerts-to", "ground"], "'ground' is not the address"),
    ],
)
def test_what_cannot_be_used_is_named(run: Run, arguments: list[str], complaint: str) -> None:
    outcome = run("live", *arguments, "--duration", "0.1")
    assert outcome.code == 1
    assert complaint in outcome.err
    assert "remedy:" in outcome.err


def test_a_taken_port_is_named(run: Run) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        outcome = run("live", "udpin:0", f"udpin:{other.getsockname()[1]}", "--duration", "0.1")
    assert outcome.code == 1  # a first link that stayed open would be a ResourceWarning, an error here
    assert os.strerror(errno.EADDRINUSE) in outcome.err


def test_a_flight_is_not_overwritten(run: Run, tmp_path: Path) -> None:
    flown = tmp_path / "flight.tlog"
    flown.write_bytes(b"a flight")
    outcome = run("live", "udpin:0", "--duration", "0.1", "--record", flown)
    assert outcome.code == 1
    assert "exists already" in outcome.err
    assert flown.read_bytes() == b"a flight"


def test_no_link_is_a_mistake_of_usage(run: Run) -> None:
    assert run("live").code == 2


def test_nothing_heard_is_undecided(run: Run) -> None:
    outcome = run("live", "udpin:0", "--duration", "0.2")
    assert outcome.code == 12
    assert "nothing was received on udpin:127.0.0.1:" in " ".join(outcome.out.split())
    assert "in this log" not in outcome.out


@pytest.mark.slow
def test_a_viewer_follows(tmp_path: Path, worn_pieces: list[Piece]) -> None:
    pytest.importorskip("rerun")
    with hearing(tmp_path, worn_pieces, "--json", "--viewer", "serve") as live:
        assert "viewer: rerun+http://127.0.0.1:" in live.output
        live.wait_for(lambda: frames_heard(live) == len(worn_pieces))
        live.stop()
    assert "its output is dropped" not in live.output


def test_the_word_after_viewer_may_be_the_link(run: Run) -> None:
    outcome = run("live", "--viewer", "nonesuch", "udpin:0", "--duration", "0.1")
    assert outcome.code == 1
    assert "no viewer 'nonesuch'" in outcome.err
    outcome = run("live", "--viewer", "udpin:999999", "--duration", "0.1")
    assert "is not the address of a link" in outcome.err
