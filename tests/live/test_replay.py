"""Live ≡ replay: every tier, with and without a key, the second session; every real log over UDP."""

from __future__ import annotations

import json
import socket
import threading
import time
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from mavhums.live.setup import LiveOptions, prepare
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim import Flight, fly
from mavhums_sim.link import Link
from mavhums_sim.tiers import TIERS
from tests.conftest import carried_logs, real_logs
from tests.live.conftest import KEY, Rig, pieces, verdicts

QUICK = ("elevator_frozen.tlog", "px4_aileron_frozen.tlog")
LOGS = [path for path in (*carried_logs(), *real_logs()) if ".tlog" in path.name]
PROFILES = {"plane_lua_csrv.link1.tlog": Path(__file__).parents[2] / "examples" / "profiles" / "csrv.toml"}
AHEAD = 4000  # datagrams that a receive buffer surely holds


def datagrams(log: Path) -> list[bytes]:
    """The log's frames, one to a datagram; what is damaged goes along as it is."""
    data, position, out = log.read_bytes(), 0, []
    stamp = 0 if log.suffix == ".raw" else 8
    while position + stamp + 3 <= len(data):
        start = position + stamp
        size = {0xFE: 8 + data[start + 1], 0xFD: 12 + data[start + 1] + 13 * (data[start + 2] & 1)}.get(
            data[start]
        )
        if size is None:
            out.append(data[position : position + 1])
            position += 1
        else:
            out.append(data[start : start + size])
            position = start + size
    return out


@pytest.mark.parametrize(
    "log",
    [pytest.param(log, id=log.name, marks=[pytest.mark.slow] * (log.name not in QUICK)) for log in LOGS],
)
def test_a_session_gives_what_its_recording_gives(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    profile = str(PROFILES.get(log.name, "paper"))
    recording = tmp_path / "live.tlog"
    session = prepare(
        LiveOptions(urls=["udpin:0"], judging=mavhums.Options(airframe=profile), record=recording)
    )
    port = session.links[0].address.port
    sent = datagrams(log)
    quiet: list[float] = []
    taken: list[int] = []
    take = session.take

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for k, datagram in enumerate(sent):
                out.sendto(datagram, ("127.0.0.1", port))
                if k % 200 == 199:
                    time.sleep(0.004)
                    # A log is sent a thousand times as fast as it was flown: no more than a buffer ahead.
                    waiting = time.monotonic()
                    while k - sum(taken) > AHEAD and time.monotonic() - waiting < 10.0:
                        time.sleep(0.004)

    sender = threading.Thread(target=send)

    def counted(pieces: list[Piece]) -> None:
        taken.append(len(pieces))
        take(pieces)

    monkeypatch.setattr(session, "take", counted)
    sender.start()

    def stop() -> bool:
        """Once everything was sent and taken, however busy the machine is, and a little later."""
        if not sender.is_alive():
            quiet.append(time.monotonic())
        waited_s = time.monotonic() - quiet[0] if quiet else 0.0
        return waited_s > 0.15 and (sum(taken) >= len(sent) or waited_s > 10.0)

    live = session.run(stop)
    sender.join()
    assert recording.stat().st_size > 0 or not live.log.vehicles
    replayed = (
        mavhums.analyse(recording, mavhums.Options(airframe=profile)) if recording.stat().st_size else live
    )
    assert json.dumps(verdicts(live)) == json.dumps(verdicts(replayed))
    assert session.links[0].dropped == 0
    counts = session.status.link(live, session.clock.now_us())
    assert counts.datagrams == len(sent)
    heard = mavhums.read_log(log)
    if not heard.losses.line_ends_restored:
        intact = sum(heard.counts.values()) - heard.losses.padded_frames
        assert counts.frames - counts.unknown_frames >= 0.99 * intact


@cache
def short_flight(tiers: tuple[str, ...], day: int, *, signed: bool) -> list[Piece]:
    """A short flight of these tiers, as datagrams."""
    record = fly(Flight(7, 16.0, {"elevator": (1.0, 1.0)}, rate_hz=25.0, tiers=tiers))
    return pieces(record, Link(key=KEY if signed else None, day=day, loss=0.02, late=0.02))


@pytest.mark.slow
@pytest.mark.parametrize("tiers", [*((tier,) for tier in TIERS), tuple(TIERS)], ids="+".join)
@pytest.mark.parametrize("signed", [False, True], ids=["unsigned", "signed"])
def test_each_session_is_its_recording(tiers: tuple[str, ...], signed: bool, tmp_path: Path) -> None:
    """The second session knows of the first, its recording does not, and both judge alike."""
    latest: dict[tuple[int, int, int], int] = {}
    for session, day in enumerate((0, 1)):
        folder = tmp_path / str(session)
        folder.mkdir()
        flown = short_flight(tiers, day, signed=signed)
        rig = Rig(folder, key=KEY if signed else None, latest=latest, start_us=flown[0].time_us)
        rig.hear(flown)
        assert rig.end().log.vehicles == (1,)
        latest = rig.guard.latest if rig.guard else {}


@pytest.mark.slow
@given(
    day=st.sampled_from([0, 1]), older_s=st.integers(0, 300), strangers=st.integers(0, 3), swap=st.booleans()
)
@settings(max_examples=6, deadline=None)
def test_a_second_session_admits_what_its_recording_admits(
    tmp_path_factory: pytest.TempPathFactory, day: int, older_s: int, strangers: int, swap: bool
) -> None:
    """Streams whose clocks differ by minutes, known and unknown from before, in any order."""
    flown = short_flight(("instrumented",), 1, signed=True)
    newest = int.from_bytes(flown[0].data[-12:-6], "little")
    signer = v2.MAVLink(None, srcSystem=1, srcComponent=7)
    signer.signing.secret_key, signer.signing.sign_outgoing, signer.signing.link_id = KEY, True, 5
    others = []
    for k in range(40):
        signer.signing.timestamp = newest - older_s * 100_000 + k
        text = v2.MAVLink_servo_output_raw_message(1000 * k, 0, *[1500 + k] * 8)
        others.append(Piece("stranger", flown[50 * k].time_us + 1, bytes(text.pack(signer))))
    known = {(5, 1, 7): newest - 400 * 100_000, (0, 1, 1): newest - (2 - day) * 86_400 * 100_000}
    rig = Rig(
        tmp_path_factory.mktemp("second"),
        key=KEY,
        latest=dict(list(known.items())[strangers % 2 :]),
        start_us=flown[0].time_us,
    )
    rig.hear(others[:3] + flown if swap else flown + others)
    rig.end()
