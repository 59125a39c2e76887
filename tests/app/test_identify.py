"""Motors identified from logs, and written into the profile as it is."""

from __future__ import annotations

from pathlib import Path

import pytest

import mavhums
from mavhums.actuator.profile import load_airframe
from mavhums.app.identify import MotorIdentification, identify, with_motors
from mavhums.core.errors import MavhumsError
from mavhums.health.estimation.motor_identification import Identified
from mavhums.results.verdict import Interval
from mavhums_sim import Flight, fly
from mavhums_sim.telemetry import write_tlog
from tests.conftest import Run
from tests.present import present

BLANK = """\
name = "blank"  # my own

[[actuators]]
name = "elevator"
servo = 3
esc = 2
pwm_us = [1000, 1500, 2000]  # SERVO3_MIN

[[actuators]]
name = "rudder"  # the rear one
servo = 4
esc = 3
pwm_us = [1000, 1500, 2000]
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("identify") / "flight.tlog"
    flight = Flight(seed=31, duration_s=50.0, rate_hz=50.0, cyclogram="gusts", tiers=("esc-signed", "pwm"))
    write_tlog(fly(flight), path)
    return path


def test_the_profile_gets_what_the_motors_are(run: Run, log: Path, tmp_path: Path) -> None:
    profile, filled = tmp_path / "blank.toml", tmp_path / "filled.toml"
    profile.write_text(BLANK, encoding="utf-8")
    printed = run("profile", "identify", str(log), "--airframe", str(profile), "-o", str(filled))
    assert printed.code == 0, printed.err
    text = filled.read_text(encoding="utf-8")
    assert all(line in text for line in BLANK.splitlines())
    for actuator in load_airframe(filled).actuators:
        motor = present(actuator.identified)
        assert motor.resistance[0] == pytest.approx(22.6457, rel=0.01)
        assert motor.back_emf[1] <= 0.014608 <= motor.back_emf[2]
        assert motor.flights == ("flight.tlog",)
        assert motor.convention == "unknown"
    again = run("profile", "identify", str(log), "--airframe", str(filled))
    assert again.out == text


def test_the_motors_become_a_servo_type_of_the_profile(run: Run, log: Path, tmp_path: Path) -> None:
    profile = tmp_path / "blank.toml"
    profile.write_text(BLANK, encoding="utf-8")
    printed = run("profile", "identify", str(log), "--airframe", str(profile), "--servo-type", "ours")
    assert printed.code == 0, printed.err
    section = printed.out.replace("# gear_ratio =", "gear_ratio = 300.0").replace(
        "# inertia =", "inertia = 2.4e-7"
    )
    profile.write_text(BLANK.replace("esc =", 'servo_type = "ours"\nesc =') + section, encoding="utf-8")
    for actuator in load_airframe(profile).actuators:
        ema = actuator.known_ema()
        assert ema.resistance == pytest.approx(22.6457, rel=0.01)
        assert ema.torque_constant == pytest.approx(0.014608, rel=ema.torque_uncertainty)
        assert ema.torque_uncertainty < 0.05
    assert run("profile", "identify", str(log), "--airframe", str(profile), "--servo-type", "a b").code == 2


def test_a_log_that_shows_no_motor_says_what_would(log: Path) -> None:
    with pytest.raises(MavhumsError, match="no log shows an actuator's motor"):
        identify([log], mavhums.Options(airframe="paper"))


def test_other_actuators_stay_as_they_are() -> None:
    one = Interval(estimate=1.0, low=0.9, high=1.1)
    rudder = MotorIdentification(Identified(one, one, one, 2), ("a.tlog", "b.tlog"))
    filled = with_motors(BLANK, {"rudder": rudder})
    head, section = filled.split('[[actuators]]\nname = "rudder"')
    assert head == BLANK.split('[[actuators]]\nname = "rudder"', maxsplit=1)[0]
    assert 'flights = ["a.tlog", "b.tlog"]' in section
