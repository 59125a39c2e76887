"""A receiver that drives the servos: the autopilot records its channels and has no output of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest

import mavhums
from mavhums.results.verdict import Verdict
from tests.engine.wired import PLANE, PX4_PLANE, Wired

_MAP = {f"RC_MAP_{axis}": float(n) for axis, n in (("ROLL", 1), ("PITCH", 2), ("YAW", 4))}


def roll(flight: Wired, form: Literal["tlog", "dataflash", "ulog"], block: int = 1 << 16) -> Verdict:
    engine = mavhums.Engine(mavhums.EngineOptions())
    content = getattr(flight, form)()
    for at in range(0, len(content), block):
        engine.feed(content[at : at + block])
    engine.finish()
    return next(v for v in engine.assessment().verdicts if v.actuator == "roll")


@pytest.mark.slow
@pytest.mark.parametrize("form", ["tlog", "dataflash", "ulog"])
@pytest.mark.parametrize("left", [1.0, 0.4])
def test_the_receivers_channels_are_the_command(
    form: Literal["tlog", "dataflash", "ulog"], left: float
) -> None:
    flight = Wired(parameters=PX4_PLANE | _MAP if form == "ulog" else PLANE, left=left)
    by_outputs = roll(flight, form)
    by_receiver = roll(replace(flight, idle_us=0), form)
    assert by_outputs.condition == ("unchanged" if left == 1.0 else "emergency")
    for name in ("condition", "worst", "coverage", "since"):
        assert getattr(by_receiver, name) == getattr(by_outputs, name)
    assert by_receiver.surfaces == ("aileron (channel 1)",)
    assert by_receiver.provenance["V1"].startswith("the receiver's channels")


@pytest.mark.slow
def test_it_does_not_depend_on_the_blocks() -> None:
    flight = Wired(idle_us=0, until_s=95.3, left=0.4)
    assert roll(flight, "tlog") == roll(flight, "tlog", 1_000)


@pytest.mark.slow
def test_outputs_that_come_are_the_command_from_then_on() -> None:
    found = roll(Wired(seconds=300, idle_us=0, until_s=80.0), "tlog")
    assert found.surfaces == ("aileron (servo 1)",)
    assert found.condition == "unchanged"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("idle_us", "parameters", "code"),
    [
        (0, {}, "only_receiver"),
        (1500, PLANE, "by_receiver"),
    ],
)
def test_a_command_that_is_not_known_is_told(idle_us: int, parameters: dict[str, float], code: str) -> None:
    found = roll(Wired(parameters=parameters, idle_us=idle_us), "tlog")
    assert found.condition == "undecided"
    assert found.reason_codes[0] == code
    assert "channels (1, 2)" in (found.reason or "")
