"""A receiver that drives the servos: the autopilot records its channels and has no output of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import pytest

from mavhums.results.verdict import Verdict
from tests.engine.test_axes import of
from tests.engine.wired import PLANE, PX4_PLANE, Wired
from tests.judge import judged

pytestmark = pytest.mark.slow
Form = Literal["tlog", "dataflash", "ulog"]
_MAP = {f"RC_MAP_{axis}": float(n) for axis, n in (("ROLL", 1), ("PITCH", 2), ("YAW", 4))}


def roll(flight: Wired, form: Form) -> Verdict:
    return of(judged(getattr(flight, form)())[0], "roll")


@pytest.mark.parametrize("form", ["tlog", "dataflash", "ulog"])
@pytest.mark.parametrize("left", [1.0, 0.4])
def test_the_receivers_channels_are_the_command(form: Form, left: float) -> None:
    flight = Wired(parameters=PX4_PLANE | _MAP if form == "ulog" else PLANE, left=left)
    by_outputs = roll(flight, form)
    by_receiver = roll(replace(flight, idle_us=0), form)
    assert by_outputs.condition == ("unchanged" if left == 1.0 else "emergency")
    for name in ("condition", "worst", "coverage", "since"):
        assert getattr(by_receiver, name) == getattr(by_outputs, name)
    assert by_receiver.surfaces == ("aileron (channel 1)",)
    assert by_receiver.provenance["V1"].startswith("the receiver's channels")


def test_outputs_that_come_are_the_command_from_then_on() -> None:
    found = roll(Wired(seconds=300, idle_us=0, until_s=80.0), "tlog")
    assert found.surfaces == ("aileron (servo 1)",)
    assert found.condition == "unchanged"


@pytest.mark.parametrize(("every", "code"), [(0, "lacks"), (13, "too_rare")], ids=["none", "0.8 Hz"])
def test_of_a_log_without_outputs_nobody_knows_who_drives_the_servos(every: int, code: str) -> None:
    """An autopilot that turns the pilot's channels into its own demand looks as if it lost its effect."""
    content, at, left, number = Wired(idle_us=0).tlog(), 0, bytearray(), 0
    while at < len(content):
        record = content[at : at + 8 + 12 + content[at + 9]]
        at += len(record)
        if record[15:18] == b"\x24\0\0":  # SERVO_OUTPUT_RAW
            number += 1
            if not every or number % every:
                continue
        left += record
    [found] = [one for one in judged(bytes(left))[0].verdicts if one.subject == "axis"]
    assert (found.condition, found.reason_codes) == ("undecided", (code,))
    assert "the servo outputs" in (found.reason or "")


@pytest.mark.parametrize(
    ("idle_us", "parameters", "code"), [(0, {}, "only_receiver"), (1500, PLANE, "by_receiver")]
)
def test_a_command_that_is_not_known_is_told(idle_us: int, parameters: dict[str, float], code: str) -> None:
    found = roll(Wired(parameters=parameters, idle_us=idle_us), "tlog")
    assert found.condition == "undecided"
    assert found.reason_codes[0] == code
    assert "channels (1, 2)" in (found.reason or "")
