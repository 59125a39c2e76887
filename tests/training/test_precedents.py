"""Flights that supplement the simulation, from the log to the trained model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from mavhums.actuator import load_airframe
from mavhums.cli.main import cli
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS
from mavhums.learn import PrecedentBase, load_model
from mavhums.training.flights import flown_samples
from mavhums_sim import Flight, fly, write_tlog


def mavhums(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def emergency_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flown") / "worn.tlog"
    write_tlog(fly(Flight(seed=41, duration_s=15.0, friction_nm={"elevator": (1.0, 1.0)})), path)
    return path


@pytest.fixture(scope="module")
def folder(short_log: Path, emergency_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("precedents") / "base"
    healthy = mavhums("precedents", "add", short_log, "--label", "normal", "-d", base)
    worn = mavhums(
        "precedents",
        "add",
        emergency_log,
        "--label",
        "emergency",
        "--actuator",
        "elevator",
        "-d",
        base,
    )
    assert (healthy.exit_code, worn.exit_code) == (0, 0), healthy.output + worn.output
    return base


def test_a_log_becomes_precedents_with_its_provenance(folder: Path, short_log: Path) -> None:
    found = list(PrecedentBase(folder))
    assert len(found) == 5
    said = {
        (precedent.provenance.log, precedent.provenance.actuator): precedent.provenance for precedent in found
    }
    assert {actuator for log, actuator in said if log == short_log.name} == {
        "aileron_left", "aileron_right", "elevator", "rudder",
    }  # fmt: skip
    worn = said["worn.tlog", "elevator"]
    assert (worn.label, worn.origin, worn.airframe, worn.tier) == (
        "emergency",
        "simulated",
        "paper",
        "instrumented",
    )
    listed = mavhums("precedents", "list", "-d", folder).output
    assert listed.count("\n") == 5
    assert "emergency  simulated  paper elevator" in listed


@pytest.mark.slow
def test_a_log_of_the_simulator_is_flown_only_if_told_so(short_log: Path, tmp_path: Path) -> None:
    add = ("precedents", "add", short_log, "--label", "normal", "--actuator", "rudder", "-d", tmp_path)
    individual = tmp_path / "individual.tlog"
    write_tlog(fly(Flight(seed=42, duration_s=15.0, individuals=7)), individual)
    for options, origin in (((), "simulated"), (("--flown",), "flown"), (("--simulated",), "simulated")):
        outcome = mavhums(*add, *options)
        assert f"rudder, normal, {origin}, " in outcome.output
        assert [each.provenance.origin for each in PrecedentBase(tmp_path)] == [origin]
    other = mavhums("precedents", "add", individual, *add[3:])
    assert ", simulated, " in other.output


def test_what_is_stored_is_what_was_flown(folder: Path) -> None:
    base = PrecedentBase(folder)
    precedent = next(each for each in base if each.provenance.log == "worn.tlog")
    flown = fly(Flight(seed=41, duration_s=15.0, friction_nm={"elevator": (1.0, 1.0)})).actuators["elevator"]
    np.testing.assert_allclose(base.read(precedent), flown.values, rtol=1e-5, atol=1e-4)


def test_actuators_of_one_log_are_one_flight(folder: Path) -> None:
    values, emergency, flights = flown_samples(PrecedentBase(folder), load_airframe("paper"), every=1)
    assert values.shape == (len(flights), len(KEYS))
    assert len(set(flights)) == 2
    assert set(flights[emergency]).isdisjoint(flights[~emergency])
    assert np.abs(values[:, 9]).min() * 6 > 1.0


@pytest.mark.slow
def test_training_mixes_and_weighs_them(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("flights", "windows"):
        monkeypatch.setattr(
            f"mavhums.training.{module}.fly", lambda flight: fly(replace(flight, duration_s=20.0))
        )

    def train(*options: str) -> np.ndarray:
        model = tmp_path / "model.safetensors"
        outcome = mavhums(
            "train", "--flights", "2", "--networks", "1", "--precedents", folder, *options, "-o", model
        )
        assert outcome.exit_code == 0, outcome.output
        found = load_model(model)
        assert "flown_weight" in found.card.conditions
        assert "--precedents base" in found.card.command
        return found.network.w1

    once = train()
    often = train("--flown-weight", "20")
    assert once.shape != often.shape or not np.array_equal(once, often)


def test_what_cannot_be_added_is_said_with_a_remedy(short_log: Path, folder: Path, tmp_path: Path) -> None:
    whole = mavhums("precedents", "add", short_log, "--label", "emergency", "-d", folder)
    assert "name them with --actuator" in str(whole.exception)
    absent = mavhums("precedents", "add", short_log, "--label", "normal", "--actuator", "flap", "-d", folder)
    assert "does not carry flap" in str(absent.exception)
    assert "it carries: aileron_left" in str(absent.exception)
    assert len(list(PrecedentBase(folder))) == 5
    none = mavhums("train", "--precedents", tmp_path / "nowhere", "-o", tmp_path / "model")
    assert "no precedent base there" in str(none.exception)
    other = load_airframe("paper").model_copy(update={"name": "glider"})
    with pytest.raises(MavhumsError, match="no precedent of the airframe glider"):
        flown_samples(PrecedentBase(folder), other, every=1)
