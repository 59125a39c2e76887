"""Live ≡ replay on every real log, sent over UDP on the loopback."""

from __future__ import annotations

import json
import socket
import threading
import time
from pathlib import Path

import pytest

import mavhums
from mavhums.live import Options, prepare
from tests.conftest import real_logs
from tests.live.conftest import verdicts

REAL = [path for path in real_logs() if ".tlog" in path.name]
PROFILES = {"plane_lua_csrv.link1.tlog": Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"}


def datagrams(log: Path) -> list[bytes]:
    """The log's frames, one to a datagram; what is damaged goes along as it is."""
    data, position, out = log.read_bytes(), 0, []
    stamp = 0 if log.suffix == ".raw" else 8
    while position + stamp + 3 <= len(data):
        start = position + stamp
        size = {
            0xFE: 8 + data[start + 1],
            0xFD: 12 + data[start + 1] + 13 * (data[start + 2] & 1),
        }.get(data[start])
        if size is None:
            out.append(data[position : position + 1])
            position += 1
        else:
            out.append(data[start : start + size])
            position = start + size
    return out


@pytest.mark.skipif(not REAL, reason="the folder of real logs is absent (MAVHUMS_REAL_LOGS)")
@pytest.mark.parametrize("log", REAL, ids=lambda path: path.name)
def test_a_session_gives_what_its_recording_gives(log: Path, tmp_path: Path) -> None:
    profile = str(PROFILES.get(log.name, "paper"))
    recording = tmp_path / "live.tlog"
    session = prepare(Options(["udpin:0"], airframe=profile, record=recording))
    port = session.links[0].address.port
    sent = datagrams(log)

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for k, datagram in enumerate(sent):
                out.sendto(datagram, ("127.0.0.1", port))
                if k % 200 == 199:
                    time.sleep(0.004)

    sender = threading.Thread(target=send)
    sender.start()
    quiet: list[float] = []

    def stop() -> bool:
        """Once everything was sent, and a little later."""
        if not sender.is_alive():
            quiet.append(time.monotonic())
        return bool(quiet) and time.monotonic() - quiet[0] > 0.15

    live = session.run(stop)
    sender.join()
    assert recording.stat().st_size > 0 or not live.log.vehicles
    replayed = (
        mavhums.analyse(recording, mavhums.Options(airframe=profile)) if recording.stat().st_size else live
    )
    assert json.dumps(verdicts(live)) == json.dumps(verdicts(replayed))
    assert session.links[0].dropped == 0
    counts = session.watch.link(live, session.clock.now_us())
    assert counts.datagrams == len(sent)
    heard = mavhums.read_log(log)
    if not heard.losses.line_ends_restored:
        intact = sum(heard.counts.values()) - heard.losses.padded_frames
        assert counts.frames - counts.unknown_frames >= 0.99 * intact
