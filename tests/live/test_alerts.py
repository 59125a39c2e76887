"""What is said to the ground station: short, once, never a command."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as v1
from pymavlink.dialects.v20 import common as v2

from mavhums.core.conditions import Condition
from mavhums.health.decision.events import ConditionChanged
from mavhums.live.alerts import Alerts, Signer, health_name, text_of
from mavhums.results.live import ActuatorStatus
from mavhums_sim.link import EPOCH_US

SECOND = 1_000_000


def changed(after: Condition, before: Condition = "normal", fault: str = "friction") -> ConditionChanged:
    return ConditionChanged(3, "elevator", 20.0, 10.0, before, after, "rule", fault)


def status(actuator: str, condition: Condition, vehicle: int = 3) -> ActuatorStatus:
    return ActuatorStatus(
        vehicle=vehicle, actuator=actuator, condition=condition, held=condition, worst=condition,
        stale=False, age_s=0.1, rate_hz=100.0, friction_nm=None, network=None, probability=None, suspects=(),
        tier=None, late=0, reason=None,
    )  # fmt: skip


class Ground:
    """Hears frames as a ground station does."""

    def __init__(self, dialect: Any = v2, key: bytes | None = None) -> None:
        self.frames: list[bytes] = []
        self._mav = dialect.MAVLink(None)
        if key:
            self._mav.signing.secret_key = key
            self._mav.signing.timestamp = 0

    def hear(self, frame: bytes, vehicle: int) -> None:
        self.frames.append(frame)

    def heard(self) -> list[Any]:
        frames, self.frames = self.frames, []
        return [message for frame in frames for message in self._mav.parse_buffer(frame) or []]


@given(
    actuator=st.text(min_size=1, max_size=60),
    condition=st.sampled_from(["degraded", "emergency"]),
    fault=st.text(st.characters(categories=["Ll"]), min_size=1, max_size=40),
)
def test_texts_have_at_most_fifty_characters(actuator: str, condition: Condition, fault: str) -> None:
    text = text_of(actuator, condition, fault)
    assert 0 < len(text.encode("ascii")) <= 50
    assert condition.upper() in text
    assert text.endswith(("land now", "land as soon as possible", "inspect", "inspect after landing"))
    assert text[0] == actuator.encode("ascii", "replace").decode()[0]


def test_the_longest_action_that_fits_is_said() -> None:
    for letters, action in ((1, " after landing"), (10, " after landing"), (11, ""), (24, "")):
        text = text_of("rudder", "degraded", "f" * letters)
        assert text == f"rudder DEGRADED: {'f' * letters}, inspect{action}"
    assert len(text_of("rudder", "degraded", "f" * 10)) == len(text_of("rudder", "degraded", "f" * 99)) == 50


def test_names_of_health_differ() -> None:
    names = ["aileron_left", "aileron_right", "elevator", "rudder", *["flap"] * 8]
    short = [health_name(number, name) for number, name in enumerate(names, start=1)]
    assert len(set(short)) == 12
    assert all(len(name) <= 10 for name in short)


def test_an_episode_is_reported_once() -> None:
    ground = Ground()
    alerts = Alerts(ground.hear)
    sent = alerts.observe([changed("degraded", "undecided", "backlash")], EPOCH_US)
    assert [alert.text for alert in sent] == ["elevator DEGRADED: backlash, inspect after landing"]
    for k in range(100):
        assert alerts.tick([status("elevator", "degraded")], EPOCH_US + k * SECOND) == []
    sent += alerts.observe([changed("emergency", "degraded")], EPOCH_US + 100 * SECOND)
    assert sent[1].text == "elevator EMERGENCY: friction, land now"
    texts = [message for message in ground.heard() if message.get_type() == "STATUSTEXT"]
    assert [message.text for message in texts] == [alert.text for alert in sent]
    assert [message.severity for message in texts] == [v2.MAV_SEVERITY_WARNING, v2.MAV_SEVERITY_CRITICAL]
    assert {message.get_srcSystem() for message in texts} == {3}


def test_flapping_is_reported_every_half_minute_at_most() -> None:
    alerts = Alerts(lambda frame, vehicle: None)
    count = 0
    for k in range(0, 300, 5):
        condition: Condition = "normal" if k % 10 else "degraded"
        count += len(alerts.observe([changed(condition)], EPOCH_US + k * SECOND))
    assert count == 10


def test_what_came_too_soon_is_reported_when_it_lasts() -> None:
    alerts = Alerts(lambda frame, vehicle: None)
    assert not alerts.observe([changed("normal", "undecided"), changed("undecided")], EPOCH_US)
    assert alerts.observe([changed("degraded")], EPOCH_US)
    assert not alerts.observe([changed("normal"), changed("degraded")], EPOCH_US + 5 * SECOND)
    assert not alerts.tick([], EPOCH_US + 20 * SECOND)
    assert len(alerts.tick([], EPOCH_US + 30 * SECOND)) == 1
    assert not alerts.tick([], EPOCH_US + 90 * SECOND)


def test_each_second_there_is_a_heartbeat_and_the_health_of_each() -> None:
    ground = Ground()
    alerts = Alerts(ground.hear, component=77, start_us=EPOCH_US)
    conditions: tuple[Condition, ...] = ("normal", "degraded", "emergency", "undecided")
    actuators = [status(f"servo{k}", condition) for k, condition in enumerate(conditions)]
    alerts.tick([*actuators, status("rudder", "normal", vehicle=4)], EPOCH_US + 5 * SECOND)
    messages = ground.heard()
    assert {message.get_srcComponent() for message in messages} == {77}
    assert {message.get_type() for message in messages} == {"HEARTBEAT", "NAMED_VALUE_FLOAT"}
    beats = [message for message in messages if message.get_type() == "HEARTBEAT"]
    assert [beat.get_srcSystem() for beat in beats] == [3, 4]
    kind = (v2.MAV_TYPE_ONBOARD_CONTROLLER, v2.MAV_AUTOPILOT_INVALID)
    assert {(beat.type, beat.autopilot) for beat in beats} == {kind}
    values = [m for m in messages if m.get_type() == "NAMED_VALUE_FLOAT" and m.get_srcSystem() == 3]
    assert [m.name for m in values] == ["H1servo0", "H2servo1", "H3servo2", "H4servo3"]
    assert [m.value for m in values[:3]] == [1.0, 0.5, 0.0]
    assert math.isnan(values[3].value), "not known is not healthy"
    assert {m.time_boot_ms for m in values} == {5000}
    for boot_ms, shown in ((2**31 + 5, 2**31 + 5), (2**32 + 7, 7)):
        late = Alerts(ground.hear, start_us=EPOCH_US)
        late.tick([status("rudder", "normal")], EPOCH_US + 1000 * boot_ms)
        assert [m.time_boot_ms for m in ground.heard() if m.get_type() != "HEARTBEAT"] == [shown], "32 bits"
    sequence = [message.get_seq() for message in messages if message.get_srcSystem() == 3]
    assert sequence == list(range(len(sequence)))


def test_mavlink_1_is_spoken_where_nobody_speaks_2() -> None:
    ground = Ground(v1)
    alerts = Alerts(ground.hear)
    alerts.mavlink2 = False
    alerts.tick([status("elevator", "normal")], EPOCH_US)
    assert {frame[0] for frame in ground.frames} == {0xFE}
    assert len(ground.heard()) == 2


@pytest.mark.parametrize("newest", [0, 2**46])
def test_what_is_said_is_signed_and_newer_than_all_that_was_heard(newest: int) -> None:
    key = bytes(range(32))
    ground = Ground(key=key)
    alerts = Alerts(ground.hear, signer=Signer(key, lambda: newest))
    alerts.mavlink2 = False
    for k in range(5):
        alerts.tick([status("elevator", "normal")], EPOCH_US + k)
    ticks = [int.from_bytes(frame[-12:-6], "little") for frame in ground.frames]
    assert all(a < b for a, b in itertools.pairwise(ticks))
    assert ticks[0] > newest
    assert len(ground.heard()) == 10
