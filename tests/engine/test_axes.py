"""The axes of real and flown logs, from bytes to verdict."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.health.decision.events import ConditionChanged
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Verdict
from tests import judge
from tests.conftest import REAL_LOGS, needs
from tests.engine.wired import PLANE, START_US, Wired
from tests.fleet_logs import records
from tests.health.axis.flights import excited
from tests.present import present

PROFILE = Path(__file__).parents[2] / "benchmarks" / "alfa.toml"

needs_logs = needs(REAL_LOGS / "alfa")


def of(assessment: Assessment, name: str) -> Verdict:
    return next(v for v in assessment.verdicts if v.actuator == name)


@dataclass(frozen=True)
class Ordinary(Wired):
    """A roll rate that answers to servo 1, less from ``lost_s`` on.

    ``gain`` and ``trim`` are those of the whole flight; each day is another flight. With ``parted_s`` the
    rudder, servo 4, moves half as far as servo 1 until then, and by itself from then on.
    """

    gain: float = 2.2
    trim: float = 0.0
    parted_s: int | None = None

    def rows(self) -> Iterator[tuple[float, list[int], float]]:
        demand = excited(self.seconds, seed=1 + self.day)[::2]
        time_s = np.arange(demand.size) / 10
        lasting = self.gain * np.where(time_s < self.lost_s, 1.0, self.left) * (demand - self.trim)
        rate = np.concatenate([np.zeros(2), lasting[:-2]])
        rate += 0.02 * np.random.default_rng(3 + self.day).normal(size=demand.size)
        rudder = 0.5 * np.where(time_s < (self.parted_s or 0), demand, np.roll(demand, 37))
        rudder *= self.parted_s is not None
        for t, a, r, p in zip(*(column.tolist() for column in (time_s, demand, rudder, rate)), strict=True):
            yield t, [round(1500 + 400 * a), 1500, 1600, round(1500 + 400 * r)], p


def flown(seconds: int = 150, *, parameters: bool = True, **given: Any) -> bytes:
    """A tlog of ordinary messages at 10 Hz."""
    said = {name: value for name, value in PLANE.items() if name != "SERVO3_FUNCTION"} if parameters else {}
    return Ordinary(**{"left": 0.4, "lost_s": 90} | given, seconds=seconds, parameters=said).tlog()


def judged(content: bytes) -> tuple[Assessment, list[ConditionChanged]]:
    assessment, events = judge.judged(content)
    return assessment, [event for event in events if isinstance(event, ConditionChanged)]


def test_a_lost_aileron_is_found_without_any_configuration() -> None:
    assessment, changes = judged(flown())
    roll = of(assessment, "roll")
    assert (roll.subject, roll.condition) == ("axis", "emergency")
    assert roll.surfaces == ("aileron (servo 1)",)
    assert present(roll.since).flight_time_s == pytest.approx(90, abs=10)
    assert roll.effectiveness is not None
    assert assessment.exit_code is ExitCode.EMERGENCY
    assert {v.condition for v in assessment.verdicts if v.subject == "actuator"} == {"unmonitored"}
    alarm = next(change for change in changes if change.after in ("degraded", "emergency"))
    assert 90 < alarm.time_s < 112


def test_outputs_that_nothing_names_are_inferred_from_the_flight() -> None:
    assessment, changes = judged(flown(parameters=False))
    roll = of(assessment, "roll")
    assert roll.surfaces == ("servo 1 (moves with roll)",), "nothing names the surface"
    assert any(change.finding.endswith("servo 1?") for change in changes)
    names = [verdict.actuator for verdict in assessment.verdicts if verdict.subject == "actuator"]
    assert names == ["servo 1 (moves with roll)"]
    [servo] = [one for one in assessment.usage[0].outputs if one.named_by == "inferred"]
    assert servo.name == "moves with roll"
    assert "inference" in roll.provenance["V1"]
    assert roll.worst == "emergency"


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"kind": 2}, "motors_unknown"),
        ({"kind": 10}, "steering_unnamed"),
        ({"kind": 12}, "no_wings"),
        ({"kind": 20}, "stopped"),
        ({"speed": 6.0}, "too_slow"),
        ({"armed": False}, "never_armed"),
    ],
)
def test_what_cannot_be_judged_has_its_reason_in_one_line(options: dict[str, float], code: str) -> None:
    assessment, changes = judged(flown(**options))  # type: ignore[arg-type]
    [axes] = [v for v in assessment.verdicts if v.subject != "actuator"]
    assert (axes.condition, axes.reason_codes) == ("undecided", (code,))
    assert not changes
    assert assessment.exit_code is ExitCode.UNDECIDED


def test_a_frozen_output_is_no_evidence() -> None:
    """Servo 1 is overridden: neither its output nor the aircraft moves."""
    link, frozen = v2.MAVLink(None, srcSystem=1, srcComponent=1), b""
    for time_us, frame in records(flown(left=0.0)):
        if frame[7] == 36 and time_us >= START_US + 90_000_000:
            pulses = (1500, 1500, 1600, 1500, 0, 0, 0, 0)
            frame = bytes(v2.MAVLink_servo_output_raw_message(time_us - START_US, 0, *pulses).pack(link))  # noqa: PLW2901
        frozen += struct.pack(">Q", time_us) + frame
    _, changes = judged(frozen)
    assert not [change for change in changes if change.after != "unchanged"]


@needs_logs
@pytest.mark.parametrize(
    ("name", "axis", "fault"),
    [
        ("2018-09-11-15-06-34_1_rudder_right_failure.tlog", "yaw", "hard_over"),
        ("2018-09-11-14-41-51_elevator_failure.tlog", "pitch", "tracking"),
        ("2018-09-11-17-55-30_1_right_aileron_failure.tlog", "roll", "effectiveness"),
        ("2018-07-18-15-53-31_1_engine_failure.tlog", None, None),
        ("2018-10-05-14-37-22_1_no_failure.tlog", None, None),
    ],
)
def test_real_flights(name: str, axis: str | None, fault: str | None) -> None:
    assessment = mavhums.analyse(REAL_LOGS / "alfa" / name, mavhums.Options(airframe=str(PROFILE)))
    alarmed = {
        v.actuator: v.suspects[0].fault for v in assessment.verdicts if v.worst in ("degraded", "emergency")
    }
    assert alarmed == ({} if axis is None else {axis: fault})
