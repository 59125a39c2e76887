"""Every requirement that an axis does not meet is told, with figure and limit, the binding one first."""

from __future__ import annotations

import re
import struct
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from tests.engine.test_axes import flown, judged, of
from tests.engine.wired import PX4_PLANE, START_US, Wired

SLOW = "come 2.0 times a second, 10 are needed to judge pitch"


def thinned(content: bytes, *, keep: int, numbers: frozenset[int] = frozenset({36, 30, 27})) -> bytes:
    """Keep each n-th of outputs, attitude and gyro."""
    link, out, seen = v2.MAVLink(None), bytearray(), dict[int, int]()
    at = 0
    while at < len(content):
        size = 8 + content[at + 9] + 12
        number = content[at + 8 + 7]
        seen[number] = seen.get(number, 0) + 1
        if number not in numbers or seen[number] % keep == 0:
            out += content[at : at + size]
        at += size
    assert struct.unpack(">Q", out[:8])[0] == START_US
    assert link
    return bytes(out)


def test_a_rate_that_nothing_mends_stands_before_outputs_that_a_profile_would_name() -> None:
    log = thinned(flown(parameters=False, seconds=40), keep=5)
    pitch = of(judged(log)[0], "pitch")
    reasons = str(pitch.reason).split("; ")
    assert SLOW in reasons[0]
    assert "the servo outputs" in reasons[0]
    assert "the rates" in reasons[0]
    assert re.search(r"3\d s of forward flight are too short to learn it", reasons[1])
    remedies = str(pitch.remedy).split("; ")
    assert "SRx_RC_CHAN" in remedies[0]
    assert 'name = "elevator"' in remedies[1]
    assert "choose a log" not in str(pitch.remedy), "more of it would not help"


def test_with_names_the_same_rate_is_what_remains() -> None:
    with_names = of(judged(thinned(flown(), keep=5))[0], "pitch")
    assert str(with_names.reason).split("; ")[0].endswith(SLOW)
    assert "aileron" not in str(with_names.remedy)


@pytest.mark.parametrize(
    ("axis", "name"), [("roll", "aileron_left"), ("pitch", "elevator"), ("yaw", "rudder")]
)
def test_the_remedy_names_the_surfaces_of_the_axis(axis: str, name: str) -> None:
    verdict = of(judged(flown(parameters=False, seconds=40))[0], axis)
    assert f'name = "{name}"' in str(verdict.remedy)


@pytest.mark.parametrize(
    ("kind", "parameter"),
    [("tlog", "SRx_RC_CHAN"), ("dataflash", "LOG_BITMASK"), ("ulog", "SDLOG_PROFILE")],
)
def test_the_remedy_names_the_parameter_of_the_log_s_own_autopilot(kind: str, parameter: str) -> None:
    flight = Wired(seconds=60)
    flight = replace(flight, parameters=PX4_PLANE) if kind == "ulog" else flight
    content = getattr(Slow(**flight.__dict__), kind)()
    pitch = of(judged(content)[0], "pitch")
    assert "are needed to judge pitch" in str(pitch.reason)
    assert parameter in str(pitch.remedy)


class Slow(Wired):
    """The same flight at 5 Hz."""

    def rows(self):  # type: ignore[no-untyped-def]
        for k, row in enumerate(super().rows()):
            if k % 2 == 0:
                yield row


def test_no_share_is_quoted_where_no_fit_was_made() -> None:
    """A surface that never moves: nothing was fitted, so that nothing is explained "to 0 %"."""
    yaw = of(judged(flown(left=1.0))[0], "yaw")
    assert "explains 0 %" not in str(yaw.reason)
    assert "surfaces of yaw in motion" in str(yaw.reason)
