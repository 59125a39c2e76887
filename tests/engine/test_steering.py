"""The steering of rovers and boats, through the whole program."""

from pathlib import Path

import pytest

import mavhums
from mavhums.results.verdict import Verdict
from mavhums.show.headline import headline
from mavhums_sim.rover import PARAMETERS, Driven, Rover, SteeringFault, drive, encoded, write_tlog

STANDS_S = 15.0


def driven(fault: SteeringFault | None = None, *, boat: bool = False, seconds: float = 300.0) -> Driven:
    return drive(Rover(boat=boat, rough=0.01), seconds, 4, fault)


def steering(path: Path) -> Verdict:
    [verdict] = [verdict for verdict in mavhums.analyse(path).verdicts if verdict.subject == "axis"]
    return verdict


@pytest.mark.parametrize("fault", [SteeringFault(200.0, 0.5), SteeringFault(200.0, 1.0, True)])
def test_a_loss_is_found_and_names_the_servo(tmp_path: Path, fault: SteeringFault) -> None:
    write_tlog(driven(fault), tmp_path / "drive.tlog")
    found = steering(tmp_path / "drive.tlog")
    assert (found.actuator, found.condition) == ("steering", "emergency")
    assert found.surfaces == ("steering (servo 1)",)
    assert found.since
    assert found.since.flight_time_s == pytest.approx(STANDS_S + 200.0, abs=20)
    assert "do not drive" in (found.advice or "")
    if not fault.frozen:
        assert found.effectiveness
        assert found.effectiveness.low < 0.5 < found.effectiveness.high
        assert not [one for one in found.evidence if one.kind == "hard_over"], "a lasting turn is no trim"


@pytest.mark.parametrize("boat", [False, True])
def test_a_healthy_drive_is_normal(tmp_path: Path, boat: bool) -> None:
    path = tmp_path / "drive.tlog"
    write_tlog(driven(boat=boat), path)
    found = steering(path)
    assert (found.actuator, found.condition) == ("steering", "normal")
    assert (
        headline(mavhums.analyse(path)).text
        == "steering control: no loss of 40 % or more; servos unmonitored"
    )
    [used] = [one for one in mavhums.analyse(path).usage[0].outputs if one.name]
    assert (used.name, used.range_us) == ("steering", (1100, 1500, 1900))
    [gain] = [one for one in found.indicators if one.fault == "effectiveness"]
    assert gain.value.estimate == pytest.approx(0.8, rel=0.1), "the curvature by full steering"


def test_what_is_not_judged_says_why(tmp_path: Path) -> None:
    write_tlog(drive(Rover(boat=True, speed_mps=0.0), 60.0, 4), tmp_path / "slow.tlog")
    assert steering(tmp_path / "slow.tlog").reason_codes == ("too_slow",)
    short = tmp_path / "short.tlog"
    write_tlog(driven(seconds=40.0), short)
    assert steering(short).reason_codes[0] == "too_short"
    wheels = {**PARAMETERS, "SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    nothing: dict[str, float] = {}
    for sent, code in ((nothing, "steering_unknown"), (wheels, "skid_steering")):
        (tmp_path / "other.tlog").write_bytes(encoded(driven(seconds=60.0), parameters=sent))
        found = steering(tmp_path / "other.tlog")
        assert (found.actuator, found.reason_codes) == ("steering", (code,))
