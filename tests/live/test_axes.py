"""Axes judged while the aircraft flies: one alert an episode, and the recording's verdicts."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mavhums.health.decision.events import ConditionChanged
from mavhums.log.mavlink.stamping import Piece
from mavhums.results.live import ActuatorStatus
from mavhums_sim.multirotor.craft import Event, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates, write_tlog
from tests.engine.test_axes import flown
from tests.links import records
from tests.live.conftest import Rig, of


def datagrams(tlog: bytes) -> list[Piece]:
    return [Piece("vehicle", time_us, frame) for time_us, _, frame in records(tlog)]


def state(rig: Rig, name: str) -> ActuatorStatus:
    return next(status for status in rig.shown.statuses[-1].actuators if status.actuator == name)


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
def test_a_lost_surface_is_reported_once_and_the_recording_says_the_same(flight: str, tmp_path: Path) -> None:
    pieces = datagrams(flown() if flight == "rows" else closed_loop())
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    found = rig.end()
    assert of(found, "roll").worst == "emergency"
    alerts = [alert for alert in rig.shown.alerts if alert.text.lower().startswith("roll")]
    wanted = episodes(rig, "roll")
    assert len(alerts) == len(wanted) == len(set(wanted)), "one for each episode"
    assert all(len(alert.text) <= 50 for alert in alerts)
    assert re.fullmatch("ROLL control .*aileron.*, land now", alerts[-1].text)
    status = state(rig, "roll")
    assert (status.condition, status.stale) == ("emergency", False)


def test_a_healthy_flight_is_quiet_and_a_silent_link_is_stale(tmp_path: Path) -> None:
    pieces = datagrams(flown(100, left=1.0))
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    assert not rig.shown.alerts
    before = state(rig, "roll")
    assert (before.condition, before.stale) == ("unchanged", False)
    rig.wait_until(pieces[-1].time_us + 6_000_000)
    after = state(rig, "roll")
    assert (after.condition, after.held, after.stale) == ("undecided", "unchanged", True)
    rig.end()


@pytest.mark.slow
def test_a_motor_that_stops_is_reported_while_it_flies(tmp_path: Path) -> None:
    rng = np.random.default_rng([3, 1])
    plan = draw_plan(rng, 55.0, event=Event(fault_s=40.0, motor=1, loss=1.0))
    write_tlog(fly(draw_craft(rng, "quad x"), plan, 3), tmp_path / "f.tlog", Rates(25.0, 25.0, 25.0), 3)
    pieces = datagrams((tmp_path / "f.tlog").read_bytes())
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    found = rig.end()
    assert of(found, "motor 2").worst == "emergency"
    texts = [alert.text for alert in rig.shown.alerts]
    # Within a second the loss is first degraded, then an emergency: one alert.
    assert episodes(rig, "motor 2")[-1] == "emergency"
    assert len(texts) == 1
    assert re.fullmatch(r"motor 2 EMERGENCY: lost \d+ % of thrust, land now", texts[0])
