"""Sweeps on the ground, as they come from a log to the command line."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from pymavlink.dialects.v20 import ardupilotmega as v2

from examples import surface_sweep
from mavhums.app.check import check_log
from mavhums.cli.main import cli
from mavhums.core.arrays import Array
from mavhums.core.errors import MavhumsError

START_US = 1_700_000_000_000_000
PROFILE = """name = "one"
[[actuators]]
name = "rudder"
servo = 1
pwm_us = [1000, 1500, 2000]
travel_deg = [-30.0, 30.0]
"""
TRAVEL_DEG, FRICTION_A, REST_A, BEHIND_DEG = 25.0, 0.2, 0.1, 1.0


def swept(
    folder: Path,
    *,
    reach: float = 1.0,
    armed: bool = False,
    rate_hz: float = 25.0,
    speed_m_s: float | None = None,
    landed: int = v2.MAV_LANDED_STATE_ON_GROUND,
) -> Path:
    """Write the log of a sweep by the example's positions, and of a flight after it."""
    command = TRAVEL_DEG * np.array(list(surface_sweep.positions(4, 5.0, rate_hz)))
    way = np.sign(np.round(np.gradient(command), 9))
    rng: np.random.Generator = np.random.default_rng(1)
    angle = np.clip(command, -reach * TRAVEL_DEG, reach * TRAVEL_DEG) - BEHIND_DEG * way
    values: Array = np.full((command.size, 12), np.nan)
    values[:, 0], values[:, 2] = command, angle + 0.05 * rng.standard_normal(command.size)
    values[:, 4] = REST_A + FRICTION_A * np.abs(way)
    link, path = v2.MAVLink(None, srcSystem=1, srcComponent=1), folder / "sweep.tlog"
    flight = values.copy()
    flight[:, 0] *= 4.0  # not on the ground: it must not count
    with path.open("wb") as log:
        for k, row in enumerate(np.concatenate([values, flight]).tolist()):
            us = START_US + round(k / rate_hz * 1e6)
            mode = v2.MAV_MODE_FLAG_SAFETY_ARMED if armed or k >= len(values) else 0
            sent = [v2.MAVLink_debug_float_array_message(us - START_US, b"EMA", 1, row + [0.0] * 46)]
            beat = v2.MAVLink_heartbeat_message(v2.MAV_TYPE_FIXED_WING, 3, mode, 0, 4, 3)
            on_ground = k < len(values)
            if speed_m_s is not None:
                speed = speed_m_s if on_ground else 20.0
                state = landed if on_ground else v2.MAV_LANDED_STATE_IN_AIR
                sent.append(v2.MAVLink_vfr_hud_message(speed, speed, 0, 0, 0.0, 0.0))
                sent.append(v2.MAVLink_extended_sys_state_message(0, state))
            for message in [beat, *sent] if k % 25 == 0 else sent:
                log.write(struct.pack(">Q", us) + message.pack(link))
    (folder / "one.toml").write_text(PROFILE, encoding="utf-8")
    return path


def test_a_sweep_shows_travel_speed_hysteresis_and_friction(tmp_path: Path) -> None:
    (found,) = check_log(swept(tmp_path), airframe=tmp_path / "one.toml")
    # Half strokes, from and to the middle, count too.
    assert (found.actuator, found.strokes, found.armed_known, found.faults) == ("rudder", 5, True, ())
    assert found.commanded_deg == pytest.approx((-TRAVEL_DEG, TRAVEL_DEG), abs=0.2)
    assert found.commanded_deg_s == pytest.approx(2 * TRAVEL_DEG / 5.0, rel=0.02)
    assert found.reached_deg_s == pytest.approx(2 * TRAVEL_DEG / 5.0, rel=0.02)
    assert found.hysteresis_deg == pytest.approx(BEHIND_DEG, abs=0.05)
    assert found.roughness_deg == pytest.approx(0.05, rel=0.3)
    assert found.friction_a == pytest.approx(FRICTION_A, abs=0.01)


def test_what_it_does_not_reach_is_a_fault(tmp_path: Path) -> None:
    log = swept(tmp_path, reach=0.7)
    outcome = CliRunner().invoke(cli, ["check", str(log), "--airframe", str(tmp_path / "one.toml")])
    assert outcome.exit_code == 10, outcome.output
    assert "rudder: reaches 3" in outcome.output
    assert "of the 50° commanded" in outcome.output
    printed = CliRunner().invoke(cli, ["check", str(log), "--airframe", str(tmp_path / "one.toml"), "--json"])
    assert json.loads(printed.stdout)[0]["faults"]


def test_a_sweep_in_flight_is_none(tmp_path: Path) -> None:
    with pytest.raises(MavhumsError, match="no surface is swept on the ground"):
        check_log(swept(tmp_path, armed=True), airframe=tmp_path / "one.toml")


@pytest.mark.parametrize(
    ("speed_m_s", "landed", "counts"),
    [
        (0.3, v2.MAV_LANDED_STATE_ON_GROUND, True),
        (6.0, v2.MAV_LANDED_STATE_ON_GROUND, False),  # a take-off run: the air loads the surfaces
        (0.3, v2.MAV_LANDED_STATE_IN_AIR, False),  # against the wind
    ],
)
def test_an_armed_aircraft_that_is_still_is_on_the_ground(
    tmp_path: Path, speed_m_s: float, landed: int, counts: bool
) -> None:
    log = swept(tmp_path, armed=True, speed_m_s=speed_m_s, landed=landed)
    if not counts:
        with pytest.raises(MavhumsError, match="while the vehicle rests"):
            check_log(log, airframe=tmp_path / "one.toml")
        return
    (found,) = check_log(log, airframe=tmp_path / "one.toml")
    assert found.strokes == 5
    assert found.commanded_deg[1] == pytest.approx(TRAVEL_DEG, abs=0.2)


class Link:
    """A vehicle that notes what it is sent, and is armed after so many commands."""

    target_system = target_component = 1

    def __init__(self, armed_after: int) -> None:
        self.mav, self.sent, self._armed_after = self, list[tuple[int, ...]](), armed_after

    def motors_armed(self) -> bool:
        return len(self.sent) >= self._armed_after

    def rc_channels_override_send(self, _: int, __: int, *pulses: int) -> None:
        self.sent.append(pulses)

    def recv_match(self, **_: object) -> None:
        """Receive nothing."""


@pytest.mark.parametrize(("armed_after", "whole"), [(10**6, True), (40, False)])
def test_the_example_sweeps_the_disarmed_and_gives_the_sticks_back(armed_after: int, whole: bool) -> None:
    link = Link(armed_after)
    assert surface_sweep.sweep(link, px4=False, strokes=2, seconds=1.0, sleep=lambda _: None) == whole
    assert link.sent[-1] == (surface_sweep.RELEASED,) * 8
    rolls = [pulses[0] for pulses in link.sent[:-1]]
    assert (min(rolls), max(rolls)) == ((1000, 2000) if whole else (1500, 1500))
    assert {pulses[2] for pulses in link.sent[:-1]} == {surface_sweep.UNCHANGED}
