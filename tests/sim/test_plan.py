"""Campaigns from TOML: every combination once, errors in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums_sim.plan import load_plan

FULL = """
seed = 40
seeds = 2
duration_s = 3
rate_hz = 50
model = "two-mass"
friction_method = "karnopp"
esc_side = "bus"
tiers = ["esc-signed", "pwm"]
individuals = true
cyclograms = ["takeoff", "gusts"]
surfaces = ["elevator", "rudder"]
data_sheet = {nominal_torque_nm = 2.0}
rates = {esc = 4}
link = {loss = 0.1, key = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f"}
conditions = [
    {fault = "none"},
    {fault = "backlash", severity = [0.2, 0.4], onset = "growing", at_s = 1.0},
    {fault = "jam", severity = 10, onset = "step", at_s = 2},
]
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return path


def test_every_combination_is_flown_once_with_a_seed_of_its_own(tmp_path: Path) -> None:
    plan = load_plan(written(tmp_path, FULL))
    flights = dict(plan.flights())
    assert len(flights) == 2 * 4 * 2
    assert sorted(flight.seed for flight in flights.values()) == list(range(40, 56))
    growing = flights["takeoff-backlash-0.4-growing-0044"]
    assert set(growing.conditions) == {"elevator", "rudder"}
    (condition,) = growing.conditions["rudder"]
    assert (condition.start, condition.end, condition.at_s) == (0.0, 0.4, 1.0)
    assert growing.individuals == growing.seed == 44
    assert (growing.rate_hz, growing.esc_side, growing.rates.esc) == (50.0, "bus", 4)
    assert growing.tiers == ("esc-signed", "pwm")
    assert growing.parameters.gearbox
    assert growing.parameters.friction_method == "karnopp"
    assert growing.parameters.torque_per_ampere == pytest.approx((2.0 + 0.225) / 0.85)
    (jam,) = flights["gusts-jam-10-step-0054"].conditions["elevator"]
    assert (jam.start, jam.at_s) == (10.0, 2.0)
    assert flights["gusts-healthy-0048"].conditions == {}
    assert plan.link.loss == 0.1
    assert plan.link.key == bytes(range(32))


def test_paired_conditions_share_pilot_and_gusts(tmp_path: Path) -> None:
    plan = load_plan(written(tmp_path, "paired = true\nseeds = 3\n" + FULL.split("seeds = 2", 1)[1]))
    names = [name for name, _ in plan.flights()]
    assert {flight.seed for _, flight in plan.flights()} == {0, 1, 2}
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("seeds =", "campaign.toml"),
        ("seeds = 1", "conditions: Field required"),
        ("conditions = []\nspeed = 3", "speed: Extra inputs"),
        ("conditions = [{fault = 'rust', severity = 1}]", "no fault 'rust'"),
        ("conditions = [{fault = 'none'}]\ncyclograms = ['loop']", "no cyclogram 'loop'"),
        ("conditions = [{fault = 'none'}]\nlink = {lost = 1}", "link: no such entry: lost"),
        ("conditions = [{fault = 'none'}]\nlink = {loss = 2.0}", "link: loss and late"),
        ("conditions = [{fault = 'backlash', severity = 1}]", "two-mass"),
        ("conditions = [{fault = 'friction'}]", "friction needs a severity"),
        ("conditions = [{fault = 'friction', severity = 1, at_s = 3}]", "at_s needs onset"),
        ("conditions = [{fault = 'none'}, {fault = 'none'}]\npaired = true", "flown 2 times"),
        ("conditions = [{fault = 'none'}]\nlink = 3", "link: Input should be"),
        ("conditions = []", "no flights"),
        ("conditions = [{fault = 'none'}]\ntiers = ['radio']", "tiers.0"),
        ("conditions = [{fault = 'none'}]\nmodel = 'three-mass'", "model"),
    ],
)
def test_wrong_plans_are_explained_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ValueError, match=r"campaign\.toml") as error:
        load_plan(written(tmp_path, text))
    assert says in str(error.value)
    assert "\n" not in str(error.value)
