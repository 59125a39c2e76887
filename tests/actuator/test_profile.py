"""Airframe profiles: the packaged one, and what is refused."""

from __future__ import annotations

import re
from math import pi
from pathlib import Path

import pytest

import mavhums.actuator
from mavhums.actuator.profile import ProfileError, load_airframe
from mavhums_sim.ema import EmaParameters
from tests.present import present


def packaged_text() -> str:
    return (Path(mavhums.actuator.__file__).parent / "airframes" / "paper.toml").read_text()


def refused(tmp_path: Path, old: str, new: str, count: int = 1) -> ProfileError:
    """Return why the paper's profile is refused with another text in it."""
    path = tmp_path / "mine.toml"
    path.write_text(packaged_text().replace(old, new, count), encoding="utf-8")
    with pytest.raises(ProfileError) as caught:
        load_airframe(path)
    return caught.value


def test_the_paper_profile_is_the_papers_actuator() -> None:
    airframe = load_airframe("paper")
    assert [one.name for one in airframe.actuators] == ["aileron_left", "aileron_right", "elevator", "rudder"]
    assert [(one.servo, one.esc) for one in airframe.actuators] == [(1, 0), (2, 1), (3, 2), (4, 3)]
    for actuator in airframe.actuators:
        assert (actuator.known_limits().normal, actuator.known_limits().emergency) == (0.375, 0.875)
        assert actuator.travel_deg == (-60.0, 60.0)
        assert actuator.pwm_us == (1000, 1500, 2000)
        ema = actuator.known_ema()
        assert ema.gear_ratio * ema.torque_constant == pytest.approx((3.5 + 0.225) / 0.85, rel=1e-4)
        assert 27 / ema.resistance * ema.gear_ratio * ema.torque_constant == pytest.approx(5.225, rel=1e-4)


def test_profile_and_simulator_mean_the_same_actuator() -> None:
    actuator, simulated = load_airframe("paper").actuators[0], EmaParameters.from_data_sheet()
    ema = actuator.known_ema()
    found = ema.gear_ratio * ema.torque_constant, actuator.inertia_output, ema.resistance
    expected = simulated.torque_per_ampere, simulated.inertia, simulated.resistance
    assert found == pytest.approx(expected, rel=1e-4)


def test_speeds_are_converted_by_the_gear() -> None:
    actuator = load_airframe("paper").actuators[0]
    assert actuator.rad_s(300 * 60) == pytest.approx(2 * pi)
    assert actuator.moving_speed_rev_min == pytest.approx(50.0)


@pytest.mark.parametrize("name", ["nonesuch", "/nowhere/profile.toml"])
def test_a_missing_profile_names_those_there_are(name: str) -> None:
    with pytest.raises(ProfileError, match="one of: paper"):
        load_airframe(name)


def test_a_binary_profile_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProfileError):
        load_airframe(path)


@pytest.mark.parametrize(
    ("old", "new", "line", "remedy"),
    [
        ("normal = 0.375", "normal = 0.9", 36, "paper.toml"),
        ("servo = 2", "servo = 1", 46, "give each actuator a servo of its own"),
        ('name = "rudder"', 'name = "elevator"', 102, "give each actuator a name of its own"),
        ("inertia = 2.4e-7", "inertia = nan", 28, "mend the value nan"),
        ("gear_ratio = 300.0", "gear_ratio = -1", 25, "mend the value -1"),
        ("resistance = 22.6457", "resistnce = 22.6457", 27, "did you mean resistance?"),
        ("torque_constant = 0", "colour = 0", 26, "known here: gear_ratio, torque_constant"),
        ("servo = 3", "servo =", 75, "paper.toml"),
        ("[actuators.limits]", "[actuators.limit]", 36, "did you mean limits?"),
        ("servo = 4\n", "", 101, "add servo to actuators[4]"),
        ("[1000, 1500, 2000]", "[1000,\n 1500]", 21, "paper.toml"),
        ("[1000, 1500, 2000]", "[1000, 1500, 1200]", 14, "paper.toml"),
        ('esc_side = "motor"', 'esc_side = "moter"', 19, "mend the value 'moter'"),
        (
            "[actuators.limits]",
            "[actuators.fields.V3]\nmessage = 'HEARTBEAT'\nfeld = 'f'",
            38,
            "did you mean field?",
        ),
        ("[actuators.limits]", "[actuators.fields.V13]\n[actuators.limits]", 36, "V13"),
        ('description = "Fixed', 'description = """Fixed', 128, "paper.toml"),
    ],
)
def test_the_line_and_the_remedy_are_named(
    tmp_path: Path, old: str, new: str, line: int, remedy: str
) -> None:
    found = refused(tmp_path, old, new)
    assert found.problem.startswith(f"{tmp_path / 'mine.toml'}:{line}: ")
    assert remedy in found.remedy
    assert "\n" not in str(found)


def test_a_name_that_is_missing_has_no_line(tmp_path: Path) -> None:
    assert "no such key" in refused(tmp_path, 'name = "paper"', 'colour = "red"').problem
    found = refused(tmp_path, 'name = "paper"', "")
    assert (found.problem, found.remedy) == (f"{tmp_path / 'mine.toml'}: name: missing", "add name")


def test_several_mistakes_are_counted(tmp_path: Path) -> None:
    assert "then look at 3 more" in str(refused(tmp_path, "gear_ratio = 300.0", "gear_ratio = -1", count=-1))


def test_constants_and_limits_may_be_left_open() -> None:
    whole = load_airframe("paper").actuators[0]
    assert whole.blanks == ()
    draft = whole.model_copy(update={"ema": None, "limits": None})
    assert draft.blanks == ("[actuators.ema]", "[actuators.limits]")
    with pytest.raises(ProfileError, match=r"aileron_left: the profile has no \[actuators.ema\] and no"):
        draft.known_ema()
    with pytest.raises(ProfileError, match=r"no \[actuators.limits\]: fill in"):
        whole.model_copy(update={"limits": None}).known_limits()


@pytest.mark.parametrize(
    ("message", "field", "where", "line", "problem", "remedy"),
    [
        ("NAMED_VALUE_FLAOT", "value", "name = 'x'", 37, "no message", "did you mean NAMED_VALUE_FLOAT"),
        ("Esc", "value", "name = 'x'", 37, "no message", "there are"),
        ("NAMED_VALUE_FLOAT", "vaule", "name = 'x'", 38, "has no field vaule", "did you mean value?"),
        ("NAMED_VALUE_FLOAT", "value", "nmae = 'x'", 39, "has no field nmae", "did you mean name?"),
        ("NAMED_VALUE_FLOAT", "value", "name = 1", 39, "name of NAMED_VALUE_FLOAT is text", "with text"),
        ("NAMED_VALUE_FLOAT", "value[1]", "name = 'x'", 38, "is no array", "write value"),
        ("NAMED_VALUE_FLOAT", "name", "name = 'x'", 38, "is text", "map a number"),
        ("ACTUATOR_OUTPUT_STATUS", "actuator", "active = 1", 38, "is an array", "actuator[0]"),
        ("ACTUATOR_OUTPUT_STATUS", "actuator[32]", "active = 1", 38, "has 32 elements", "actuator[31]"),
        ("ACTUATOR_OUTPUT_STATUS", "actuator[0]", "active = 'x'", 39, "is a number", "with a number"),
        ("ACTUATOR_OUTPUT_STATUS", "actuator[0]", "actuator = 1", 39, "is an array", "single value"),
        ("HEARTBEAT", "zzz", "type = 1", 38, "has no field zzz", "there are: autopilot, base_mode"),
    ],
)
def test_a_mapping_of_what_does_not_exist_is_refused(
    tmp_path: Path, message: str, field: str, where: str, line: int, problem: str, remedy: str
) -> None:
    mapping = f"[actuators.fields.V3]\nmessage = '{message}'\nfield = '{field}'\nwhere.{where}\n"
    found = refused(tmp_path, "[actuators.limits]", f"{mapping}[actuators.limits]")
    assert found.problem.startswith(f"{tmp_path / 'mine.toml'}:{line}: actuators[1].fields.V3.")
    assert problem in found.problem
    assert remedy in found.remedy


@pytest.mark.parametrize("value", ["1e300", "1e30", "-1e300", "1e-300"])
@pytest.mark.parametrize(
    "key",
    ["gear_ratio", "torque_constant", "resistance", "inertia", "viscous", "normal", "pwm_us", "travel_deg"],
)
def test_huge_but_finite_values_are_an_error_with_a_place(tmp_path: Path, key: str, value: str) -> None:
    text = packaged_text()
    old = present(re.search(rf"^{key} = (.*)$", text, re.MULTILINE))
    new = f"[{value}, 0, 1]" if key == "pwm_us" else f"[{value}, 60.0]" if key == "travel_deg" else value
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old[0], f"{key} = {new}", 1), encoding="utf-8")
    if value == "1e-300" and key in ("viscous", "travel_deg"):
        assert load_airframe(path).name == "paper"
        return
    with pytest.raises(ProfileError, match=rf"mine\.toml:\d+: actuators\[1\].*{key}"):
        load_airframe(path)
