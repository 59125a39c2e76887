"""A flight over UDP into the monitor, and its alerts on the screen of a real ground station."""

from __future__ import annotations

import signal
import sys
from importlib.util import find_spec
from pathlib import Path

import jsonschema
import pytest

import mavhums
from mavhums.results.assessment import json_schema
from tests.live.conftest import RIGHT, conditions, verdicts
from tests.live.programs import free_port, running, simulator
from tests.live.programs import mavhums as command


@pytest.mark.slow
@pytest.mark.skipif(
    find_spec("MAVProxy") is None, reason="the ground station is absent (pip install MAVProxy)"
)
def test_growing_friction_reaches_the_ground_station(tmp_path: Path) -> None:
    """The aircraft has a link to each; the monitor speaks to the ground station."""
    ground, monitor = (free_port(), free_port())
    mavproxy = Path(sys.executable).with_name("mavproxy.py")
    station = running(
        tmp_path, "mavproxy", sys.executable, str(mavproxy), f"--master=udpin:127.0.0.1:{ground}",
        "--daemon", "--non-interactive", "--target-system=1", "--target-component=0",
        f"--state-basedir={tmp_path}", f"--logfile={tmp_path / 'station.tlog'}",
    )  # fmt: skip
    recording = tmp_path / "live.tlog"
    with (
        station as screen,
        running(
            tmp_path, "live", *command("live", f"udpin:{monitor}", "--json", "--record", recording),
            "--alerts-to", f"udpout:127.0.0.1:{ground}",
        ) as live,
    ):  # fmt: skip
        screen.wait_for(lambda: "Telemetry log" in screen.output)
        live.wait_for(lambda: live.objects("start"))
        urls = [f"udpout:127.0.0.1:{port}" for port in (ground, monitor)]
        flight = ["--duration", "26", "--friction", "elevator=0.5..1.2", "--seed", "3"]
        with running(tmp_path, "stream", *simulator("stream", *urls, *flight)) as stream:
            stream.process.wait(timeout=60)
        live.wait_for(lambda: len(live.objects("alert")) >= 2)
        screen.wait_for(lambda: "AP: elevator EMERGENCY: friction, land now" in screen.output, 10)
        assert live.stop() == mavhums.core.errors.ExitCode.EMERGENCY
        screen.stop(signal.SIGINT)
    degraded = "elevator DEGRADED: friction, inspect after landing"
    emergency = "elevator EMERGENCY: friction, land now"
    assert [alert["text"] for alert in live.objects("alert")] == [degraded, emergency]
    assert f"AP: {degraded}" in screen.output
    schema = jsonschema.Draft202012Validator(json_schema("live-1"))
    for event in live.objects():
        schema.validate(event)
    changes = [event for event in live.objects("condition") if event["actuator"] == "elevator"]
    assert [(event["after"], event["fault"]) for event in changes] == [
        ("degraded", "friction"),
        ("emergency", "friction"),
    ]
    end = live.objects("end")[0]
    assert end["assessment"]["verdicts"] == verdicts(mavhums.analyse(recording))
    assert end["link"]["missing_frames"] == end["link"]["dropped_datagrams"] == 0

    seen = mavhums.analyse(tmp_path / "station.tlog")
    assert conditions(seen) == RIGHT
    assert conditions(mavhums.analyse(recording)) == RIGHT
    log = mavhums.read_log(tmp_path / "station.tlog")
    ours = {name: count for (system, component, name), count in log.counts.items() if component == 194}
    assert set(ours) == {"HEARTBEAT", "STATUSTEXT", "NAMED_VALUE_FLOAT"}, "nothing that commands"
    assert ours["STATUSTEXT"] == 2
