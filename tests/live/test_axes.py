"""Axes judged while the aircraft flies: one alert an episode, and the recording's verdicts."""

from __future__ import annotations

import itertools
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.health.decision.events import ConditionChanged
from mavhums.log.mavlink.stamping import Piece
from mavhums.results.verdict import Verdict
from mavhums_sim.multirotor.craft import Event, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates, write_tlog
from tests.engine.test_axes import START_US, flown
from tests.live.conftest import Rig, verdicts
from tests.live.programs import free_port, running
from tests.live.programs import mavhums as command


def records(tlog: bytes) -> Iterator[Piece]:
    """The frames of a tlog as datagrams."""
    at = 0
    while at < len(tlog):
        (time_us,) = struct.unpack(">Q", tlog[at : at + 8])
        size = tlog[at + 9] + 12
        yield Piece("vehicle", time_us, tlog[at + 8 : at + 8 + size])
        at += 8 + size


def axis(found: tuple[Verdict, ...], name: str) -> Verdict:
    return next(verdict for verdict in found if verdict.actuator == name)


def episodes(rig: Rig, name: str) -> list[str]:
    """The conditions that ask for an alert, in their order."""
    changes = [e for e in rig.shown.events if isinstance(e, ConditionChanged) and e.actuator == name]
    return [change.after for change in changes if change.after in ("degraded", "emergency")]


def closed_loop() -> bytes:
    pytest.importorskip("jsbsim", reason="the closed loop needs the extra 'sim'")
    from mavhums_sim.closed_loop import Air, ClosedLoop, SurfaceFault, fly_closed_loop
    from mavhums_sim.closed_loop.encode import encode
    from mavhums_sim.closed_loop.reports import Streams, report
    from mavhums_sim.link import Link

    lost = tuple(SurfaceFault(f"aileron_{side}", "gain", 0.3, 130.0) for side in ("left", "right"))
    flight = ClosedLoop(seed=3, duration_s=200.0, faults=lost, air=Air(turbulence=4.0))
    tables = report(fly_closed_loop(flight), Streams(rate=10.0, status=2.0))
    return encode(tables, 3, Link())


@pytest.mark.slow
@pytest.mark.parametrize("flight", ["rows", "closed loop"])
def test_a_lost_surface_is_told_once_and_the_recording_says_the_same(flight: str, tmp_path: Path) -> None:
    pieces = list(records(flown() if flight == "rows" else closed_loop()))
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    found = rig.end()
    assert axis(found.verdicts, "roll").worst == "emergency"
    told = [alert for alert in rig.shown.alerts if alert.text.lower().startswith("roll")]
    wanted = episodes(rig, "roll")
    assert len(told) == len(wanted) == len(set(wanted)), "one for each episode"
    assert all(len(alert.text) <= 50 for alert in told)
    assert told[-1].text.startswith("ROLL control ")
    assert told[-1].text.endswith(", land now")
    assert "aileron" in told[-1].text
    status = next(s for s in rig.shown.statuses[-1].actuators if s.actuator == "roll")
    assert (status.condition, status.stale) == ("emergency", False)


def test_a_healthy_flight_is_quiet_and_a_silent_link_is_stale(tmp_path: Path) -> None:
    pieces = list(records(flown(100, left=1.0)))
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    assert not rig.shown.alerts
    before = next(s for s in rig.shown.statuses[-1].actuators if s.actuator == "roll")
    assert (before.condition, before.stale) == ("unchanged", False)
    rig.wait_until(pieces[-1].time_us + 6_000_000)
    after = next(s for s in rig.shown.statuses[-1].actuators if s.actuator == "roll")
    assert (after.condition, after.held, after.stale) == ("undecided", "unchanged", True)
    rig.end()


@pytest.mark.slow
def test_a_motor_that_stops_is_told_while_it_flies(tmp_path: Path) -> None:
    rng = np.random.default_rng([3, 1])
    plan = draw_plan(rng, 55.0, event=Event(fault_s=40.0, motor=1, loss=1.0))
    write_tlog(fly(draw_craft(rng, "quad x"), plan, 3), tmp_path / "f.tlog", Rates(25.0, 25.0, 25.0), 3)
    pieces = list(records((tmp_path / "f.tlog").read_bytes()))
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    found = rig.end()
    assert axis(found.verdicts, "motor 2").worst == "emergency"
    told = [alert.text for alert in rig.shown.alerts]
    # Within a second the loss is first degraded, then an emergency: one alert.
    assert episodes(rig, "motor 2")[-1] == "emergency"
    assert len(told) == 1
    assert told[0].startswith("motor 2 EMERGENCY: lost ")
    assert told[0].endswith(" % of thrust, land now")
    assert len(told[0]) <= 50


@pytest.mark.slow
def test_over_a_real_link(tmp_path: Path) -> None:
    """In real time: a reference needs 45 seconds of flight, and the loss comes after 50."""
    port, recording = free_port(), tmp_path / "live.tlog"
    pieces = list(records(flown(70, lost_s=50, left=0.3)))
    arguments = command("live", f"udpin:{port}", "--json", "--alerts", "--record", recording)
    heard = b""
    with (
        running(tmp_path, "live", *arguments) as live,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link,
    ):
        live.wait_for(lambda: live.objects("start"))
        link.bind(("127.0.0.1", 0))
        link.setblocking(False)
        begun_s = time.monotonic()
        for time_us, several in itertools.groupby(pieces, key=lambda piece: piece.time_us):
            time.sleep(max((time_us - START_US) / 1e6 - (time.monotonic() - begun_s), 0.0))
            for piece in several:
                link.sendto(piece.data, ("127.0.0.1", port))
            while True:
                try:
                    heard += link.recv(2048)
                except BlockingIOError:
                    break
        assert live.stop() == ExitCode.EMERGENCY
    alerts = [one["text"] for one in live.objects("alert") if one["text"].lower().startswith("roll")]
    changes = [one for one in live.objects("condition") if one["actuator"] == "roll"]
    wanted = [one["after"] for one in changes if one["after"] in ("degraded", "emergency")]
    assert len(alerts) == len(wanted) == len(set(wanted))
    assert "emergency" in wanted
    for text in alerts:
        assert len(text) <= 50
        assert heard.count(text.encode()) == 1, "one STATUSTEXT each, to the vehicle's ground side"
    end = live.objects("end")[0]
    assert end["assessment"]["verdicts"] == verdicts(mavhums.analyse(recording))
