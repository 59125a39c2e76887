"""Values that no actuator can have count as not measured, are counted, and never make a verdict good."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from io import StringIO

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2
from rich.console import Console

from mavhums.actuator.plausibility import Gate
from mavhums.actuator.profile import load_airframe
from mavhums.core.quantities import KEYS, column
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Verdict
from mavhums.show.markdown_report import markdown
from mavhums.show.terminal import render
from mavhums_sim import Flight, FlightRecord, fly
from mavhums_sim.telemetry import messages
from tests.judge import judged
from tests.strategies import START_US

TRUE_NM = 1.0


@pytest.fixture(scope="module")
def record() -> FlightRecord:
    return fly(Flight(seed=11, duration_s=25.0, rate_hz=50.0, friction_nm={"elevator": (TRUE_NM, TRUE_NM)}))


@pytest.fixture(scope="module")
def judged_with(record: FlightRecord) -> Callable[..., Assessment]:
    def judge(
        value: float, keys: Sequence[str] = KEYS, share: float = 0.05, frozen: bool = False
    ) -> Assessment:
        """Judge the flight with a share of the values replaced."""
        rng, link = np.random.default_rng(3), v2.MAVLink(None, srcSystem=1, srcComponent=1)
        data = bytearray()
        for time_s, message in messages(record):
            if message.get_type() == "DEBUG_FLOAT_ARRAY" and (frozen or rng.random() < share):
                for key in keys:
                    message.data[column(key)] = value
            data += struct.pack(">Q", START_US + round(time_s * 1e6)) + bytes(message.pack(link))
        return judged(bytes(data))[0]

    return judge


def elevator(assessment: Assessment) -> Verdict:
    return next(verdict for verdict in assessment.verdicts if verdict.actuator == "elevator")


@pytest.mark.slow
@pytest.mark.parametrize("value", [3e38, -np.inf, 1e8, 1e5])
def test_an_emergency_stays_one_among_absurd_values(
    judged_with: Callable[..., Assessment], value: float
) -> None:
    verdict = elevator(judged_with(value))
    assert (verdict.condition, verdict.worst) == ("emergency", "emergency")
    assert verdict.friction_nm is not None
    assert verdict.friction_nm.low <= TRUE_NM + 0.005
    assert verdict.friction_nm.estimate == pytest.approx(TRUE_NM, abs=0.02)
    assert [suspect.fault for suspect in verdict.suspects] == ["friction"]
    counts = verdict.coverage.implausible
    assert {"V4", "V5", "V7", "V11"} <= counts.keys()
    assert all(30 < count < 100 for count in counts.values())


def test_what_was_taken_out_is_shown(judged_with: Callable[..., Assessment]) -> None:
    assessment = judged_with(3e38, ["V7"])
    count = elevator(assessment).coverage.implausible["V7"]
    console = Console(width=120, file=StringIO())
    render(assessment, console)
    text = f"{count} of V7"
    assert isinstance(console.file, StringIO)
    assert text in console.file.getvalue()
    assert text in markdown(assessment)


def test_values_of_another_unit_are_named(judged_with: Callable[..., Assessment]) -> None:
    verdict = elevator(judged_with(90_000.0, ["V7"], share=1.0))
    assert verdict.condition == "undecided"
    assert verdict.reason_codes == ("implausible",)
    assert "of V7 are" in (verdict.reason or "")


@pytest.mark.slow
@pytest.mark.parametrize("current", [0.0, 0.5])
def test_a_current_that_does_not_change_shows_no_friction(
    judged_with: Callable[..., Assessment], current: float
) -> None:
    """The torque of a frozen sensor balances with a friction of nothing, and no residual at all."""
    verdict = elevator(judged_with(current, ["V4", "V5", "V8", "V11"], frozen=True))
    assert verdict.friction_nm is None
    assert verdict.condition == "undecided"
    by_voltage = elevator(judged_with(current, ["V5", "V8", "V11"], frozen=True))
    assert by_voltage.condition == "undecided"
    assert by_voltage.friction_nm is not None
    assert by_voltage.friction_nm.low < TRUE_NM < by_voltage.friction_nm.high


def test_nan_is_not_measured_and_infinity_is_not_possible() -> None:
    gate = Gate(load_airframe("paper").actuators[0])
    values = np.full((3, len(KEYS)), np.nan)
    values[:, column("V5")] = [0.1, np.inf, -np.inf]
    admitted = gate.admit(values)
    assert gate.given[column("V5")] == 3
    assert gate.refused[column("V5")] == 2
    assert gate.given.sum() == 3
    assert np.isfinite(admitted).sum() == 1
