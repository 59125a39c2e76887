"""Motors identified from logs, and written into the profile as it stands."""

from __future__ import annotations

import json
import re
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

TRUE_SHARE = 0.225 / 5.225
"""Of Table 1's actuator: friction by the torque of its motor at stall."""

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
    told = run("profile", "identify", str(log), "--airframe", str(profile), "-o", str(filled))
    assert told.code == 0, told.err
    text = filled.read_text(encoding="utf-8")
    assert all(line in text for line in BLANK.splitlines())
    for actuator in load_airframe(filled).actuators:
        motor = actuator.identified
        assert motor is not None
        assert motor.resistance[0] == pytest.approx(22.6457, rel=0.01)
        assert motor.back_emf[1] <= 0.014608 <= motor.back_emf[2]
        assert motor.flights == ("flight.tlog",)
        assert motor.convention == "unknown"
        assert motor.friction_of_stall is motor.torque_of_stall is None
    assert text.count("# no share of stall: the supply's voltage is not known; set supply_voltage") == 2
    again = run("profile", "identify", str(log), "--airframe", str(filled))
    assert again.out == text


def test_the_motors_become_a_servo_type_of_the_profile(run: Run, log: Path, tmp_path: Path) -> None:
    profile = tmp_path / "blank.toml"
    profile.write_text(BLANK, encoding="utf-8")
    told = run("profile", "identify", str(log), "--airframe", str(profile), "--servo-type", "ours")
    assert told.code == 0, told.err
    section = told.out.replace("# gear_ratio =", "gear_ratio = 300.0").replace(
        "# inertia =", "inertia = 2.4e-7"
    )
    profile.write_text(BLANK.replace("esc =", 'servo_type = "ours"\nesc =') + section, encoding="utf-8")
    for actuator in load_airframe(profile).actuators:
        ema = actuator.known_ema()
        assert ema.resistance == pytest.approx(22.6457, rel=0.01)
        assert ema.torque_constant == pytest.approx(0.014608, rel=ema.torque_uncertainty)
        assert ema.torque_uncertainty < 0.05
    assert run("profile", "identify", str(log), "--airframe", str(profile), "--servo-type", "a b").code == 2


def test_the_supplys_voltage_gives_the_shares_of_stall(run: Run, log: Path, tmp_path: Path) -> None:
    profile, filled = tmp_path / "blank.toml", tmp_path / "filled.toml"
    profile.write_text(BLANK.replace("esc =", "supply_voltage = 27\nesc ="), encoding="utf-8")
    assert run("profile", "identify", str(log), "--airframe", str(profile), "-o", str(filled)).code == 0
    text = filled.read_text(encoding="utf-8")
    assert run("profile", "identify", str(log), "--airframe", str(filled)).out == text
    told = json.loads(run("analyse", str(log), "--airframe", str(filled), "--json").out)
    for actuator in load_airframe(filled).actuators:
        motor = actuator.identified
        assert motor is not None
        assert motor.friction_of_stall is not None
        assert motor.torque_of_stall is not None
        assert motor.friction_of_stall[1] <= TRUE_SHARE <= motor.friction_of_stall[2]
        assert motor.friction_of_stall[2] < motor.torque_of_stall[0] < 1.0
        [verdict] = [one for one in told["verdicts"] if one["actuator"] == actuator.name]
        shown = {one["fault"]: one for one in verdict["indicators"]}
        assert shown["torque_of_stall"]["value"]["estimate"] == pytest.approx(motor.torque_of_stall[0])
        assert shown["friction_of_stall"]["unit"] == "1"
        assert verdict["condition"] == "learning"


def test_the_reserve_is_told_only_where_it_is_known(run: Run, log: Path, tmp_path: Path) -> None:
    profile = tmp_path / "blank.toml"
    profile.write_text(BLANK.replace("esc = 2", "esc = 2\nsupply_voltage = 27"), encoding="utf-8")
    told = run("analyse", str(log), "--airframe", str(profile), "--verbose").out
    [line] = re.findall(r"(elevator) +(\d+)\s% +(\d+)\s% +[\d.]+\s%", told)
    assert int(line[1]) + int(line[2]) == pytest.approx(100, abs=1)
    page = tmp_path / "report.html"
    assert run("report", str(log), "--airframe", str(profile), "-o", str(page)).code == 12
    text = page.read_text(encoding="utf-8")
    assert re.search(rf">{line[2]}\s%</td>", text)
    assert text.count("Torque, by that at stall</h2>") == 1
    profile.write_text(BLANK, encoding="utf-8")
    assert "at stall" not in run("analyse", str(log), "--airframe", str(profile), "--verbose").out


def test_a_log_that_shows_no_motor_says_what_would(log: Path) -> None:
    with pytest.raises(MavhumsError, match="no log shows an actuator's motor"):
        identify([log], mavhums.Options(airframe="paper"))


def test_other_actuators_stay_as_they_are() -> None:
    one = Interval(estimate=1.0, low=0.9, high=1.1)
    filled = with_motors(
        BLANK, {"rudder": MotorIdentification(Identified(one, one, one, 2), ("a.tlog", "b.tlog"))}
    )
    head, rudder = filled.split('[[actuators]]\nname = "rudder"')
    assert head == BLANK.split('[[actuators]]\nname = "rudder"', maxsplit=1)[0]
    assert 'flights = ["a.tlog", "b.tlog"]' in rudder
