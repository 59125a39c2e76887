"""Servo types: the packaged ones against physics, and how a profile takes what they say."""

from __future__ import annotations

from math import pi
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.actuator.profile import (
    Actuator,
    Airframe,
    Ema,
    ProfileError,
    load_airframe,
)
from mavhums.actuator.servo_types import packaged_servo_types

TYPES = packaged_servo_types()
PULSES = [1000, 1500, 2000]


def typed(name: str, **own: object) -> Actuator:
    actuator = {"name": "rudder", "servo": 4, "servo_type": name, **own}
    return Airframe.model_validate({"name": "mine", "actuators": [actuator]}).actuators[0]


@pytest.mark.parametrize("name", TYPES)
def test_the_constants_agree_with_the_torque_and_speed_of_the_sheet(name: str) -> None:
    """Two figures of a sheet, or a bench and a sheet: a slip of a digit would part them."""
    kind, actuator = TYPES[name], typed(name, pwm_us=PULSES)
    assert all("://" in source for source in kind["source"])
    assert (actuator.ema is not None) == ("inertia" in kind.get("ema", {}))
    assert actuator.slew_deg_s == (kind["no_load_deg_s"] / 2 if "no_load_deg_s" in kind else None)
    ema = kind.get("ema")
    if ema is None or "stall_torque" not in kind:
        return
    constant = ema["torque_constant"] * ema["gear_ratio"]
    lost = kind["stall_torque"] / (constant * kind["voltage"] / ema["resistance"])
    # Friction of the gear, which grows with the load, is off the torque at the shaft.
    assert 0.4 < lost < 1.2
    assert kind["no_load_deg_s"] * pi / 180 == pytest.approx(kind["voltage"] / constant, rel=0.2)


@given(st.dictionaries(st.sampled_from(sorted(Ema.model_fields)), st.floats(0.1, 0.9)), st.floats(1.0, 900.0))
def test_what_the_profile_says_itself_comes_first(ema: dict[str, float], slew: float) -> None:
    name = "feetech-sts3215-12v"
    actuator = typed(name, pwm_us=PULSES, ema=ema, slew_deg_s=slew)
    assert actuator.slew_deg_s == slew
    assert actuator.known_ema() == Ema.model_validate({**TYPES[name]["ema"], **ema})
    # What was merged once is merged again without effect.
    assert Airframe(name="mine", actuators=(actuator,)).actuators == (actuator,)


def test_a_sheet_without_inertia_completes_the_profiles_own() -> None:
    assert typed("dynamixel-mx28", pwm_us=PULSES).ema is None
    assert typed("dynamixel-mx28", pwm_us=PULSES, ema={"inertia": 1e-7}).known_ema().gear_ratio == 193.0


def test_an_angle_belongs_to_its_pulse() -> None:
    assert typed("futaba-s3003").travel_deg == (-45.0, 45.0)
    assert typed("futaba-s3003").pwm_us == (1120, 1520, 1920)
    assert typed("futaba-s3003", pwm_us=PULSES).travel_deg is None


def test_an_unknown_type_names_its_line_and_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    head = 'name = "mine"\n[[actuators]]\nname = "rudder"\nservo = 4\npwm_us = [1000, 1500, 2000]\n'
    path.write_text(f'{head}servo_type = "dynamixel-mx6"\n')
    with pytest.raises(ProfileError) as caught:
        load_airframe(path)
    assert caught.value.problem == f"{path}:6: actuators[1].servo_type: no servo type 'dynamixel-mx6'"
    assert "dynamixel-mx64" in caught.value.remedy
    path.write_text(f'{head}servo_type = "my"\n[servo_types.my]\nno_load_deg_s = 300.0\n')
    assert load_airframe(path).actuators[0].slew_deg_s == 150.0
