"""Flights that supplement the simulation, from the log to the trained model."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from mavhums.actuator.profile import load_airframe
from mavhums.cli.main import cli
from mavhums.core.errors import MavhumsError
from mavhums.learn import CommandLeakWarning, PrecedentBase, load_model
from mavhums.learn.precedents import LABELS, Provenance, label_of
from mavhums.paper.flown import CALIBRATES, MEASURES, TRAINS, FlownFlights
from mavhums.paper.samples import of_precedents, training_samples
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.cyclogram import SURFACES


def mavhums(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


WORN = Flight(seed=41, duration_s=15.0, friction_nm={"elevator": (1.0, 1.0)})


@pytest.fixture(scope="module")
def emergency_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flown") / "worn.tlog"
    write_tlog(fly(WORN), path)
    return path


@pytest.fixture
def short_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let training fly 20 s in place of 100."""
    for module in ("flights", "windows"):
        monkeypatch.setattr(
            f"mavhums.paper.{module}.fly", lambda flight: fly(replace(flight, duration_s=20.0))
        )


@pytest.fixture(scope="module")
def folder(short_log: Path, emergency_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.mktemp("precedents") / "base"
    healthy = mavhums("precedents", "add", short_log, "--label", "normal", "-d", base)
    add = ("precedents", "add", emergency_log, "--actuator", "elevator")
    worn = mavhums(*add, "--label", "emergency", "-d", base)
    assert (healthy.exit_code, worn.exit_code) == (0, 0), healthy.output + worn.output
    return base


def test_a_log_becomes_precedents_with_its_provenance(folder: Path, short_log: Path) -> None:
    found = list(PrecedentBase(folder))
    assert len(found) == 5
    said = {(one.provenance.log, one.provenance.actuator): one.provenance for one in found}
    assert {actuator for log, actuator in said if log == short_log.name} == {*SURFACES}
    worn = said["worn.tlog", "elevator"]
    assert (worn.label, worn.origin) == ("friction_emergency", "simulated")
    assert (worn.airframe, worn.tier) == ("paper", "instrumented")
    listed = mavhums("precedents", "list", "-d", folder).output
    assert listed.count("\n") == 5
    assert "friction_emergency  simulated  paper elevator" in listed


@pytest.mark.slow
def test_a_log_of_the_simulator_is_flown_only_if_stated(short_log: Path, tmp_path: Path) -> None:
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
    flown = fly(WORN).actuators["elevator"].values
    np.testing.assert_allclose(base.read(precedent)[1], flown, rtol=1e-5, atol=1e-4)


def test_actuators_of_one_log_are_one_flight(folder: Path) -> None:
    flown = FlownFlights(PrecedentBase(folder), load_airframe("paper"), seed=1)
    assert flown.held_out == ()
    [worn] = flown.read(TRAINS, ["friction_emergency"])
    healthy = {each.flight for each in flown.read(TRAINS, ["normal"])}
    assert (healthy, worn.label) == ({1 - worn.flight}, "friction_emergency")


def provenance(number: int, actuator: str, label: str) -> Provenance:
    name = f"{number:016}"
    return Provenance(name, name + "0" * 48, 1, actuator, "paper", "instrumented", label_of(label), "flown")


def base_of(folder: Path, flights: list[list[str]]) -> PrecedentBase:
    """Write a base of logs that have these labels, one for each of their actuators."""
    base = PrecedentBase(folder)
    for number, labels in enumerate(flights):
        for label, actuator in zip(labels, ("elevator", "rudder", "aileron_left"), strict=False):
            base.add(
                provenance(number, actuator, label),
                np.arange(3) * 10_000,
                np.zeros((3, 12)),
                np.ones((3, 12), bool),
            )
    return base


@pytest.mark.parametrize(
    "flights",
    [
        [["normal"], ["friction_emergency"]] * 3,
        [["normal", "friction_emergency", "normal"]] * 4,  # as an aircraft with one worn actuator
        [[label] for label in LABELS for _ in range(3)],
        [["normal"], ["jam"], ["backlash"]] * 3 + [["supply_sag"]],
    ],
)
def test_whole_flights_train_calibrate_and_measure(flights: list[list[str]], tmp_path: Path) -> None:
    flown = FlownFlights(base_of(tmp_path, flights), load_airframe("paper"), seed=1)
    parts = [
        [(each.flight, each.label) for each in flown.read(part)] for part in (TRAINS, CALIBRATES, MEASURES)
    ]
    numbers = [{flight for flight, _ in part} for part in parts]
    assert sum(map(len, numbers)) == len(set.union(*numbers)) == len(flights)
    given = {label for labels in flights for label in labels}
    assert {label for _, label in parts[TRAINS]} == given
    often = {label for label in given if sum(label in labels for labels in flights) >= 3}
    assert [{label for _, label in part} for part in parts[1:]] == [often, often] == 2 * [{*flown.held_out}]


@pytest.mark.slow
def test_training_mixes_and_weighs_them(folder: Path, tmp_path: Path, short_flights: None) -> None:
    def train(*options: str) -> np.ndarray:
        model = tmp_path / "model.safetensors"
        given = ("train", "--flights", "2", "--networks", "1", *options)
        outcome = mavhums(*given, "--precedents", folder, "-o", model)
        assert outcome.exit_code == 0, outcome.output
        # Two short logs have commands that differ by chance.
        assert re.search(r"warning: the command distinguishes the classes \(Cramér's V 0\.\d", outcome.output)
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
        FlownFlights(PrecedentBase(folder), other, seed=1)
    few = mavhums("train", "--flights", "0", "--precedents", folder, "-o", tmp_path / "model")
    assert "need 4 logs each: 2 logs (1 normal, 1 friction_emergency): 2 train" in str(few.exception)
    neither = mavhums("train", "--flights", "0", "-o", tmp_path / "model")
    assert "need 4 logs each: no precedents" in str(neither.exception)
    (tmp_path / "labels.csv").write_text("log,label\nother.tlog,normal\n")
    missing = mavhums("precedents", "add", short_log, "--labels", tmp_path / "labels.csv", "-d", folder)
    assert f"has no row of {short_log}" in str(missing.exception)
    both = mavhums("precedents", "add", short_log, "-d", folder)
    assert "--labels, or with --label" in both.output


@pytest.fixture(scope="module")
def own_logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight logs, four of healthy actuators and four of worn ones, tables of their labels, and a new log."""
    folder = tmp_path_factory.mktemp("own")
    tables = {"labels": ["log,actuator,label"], "inverted": ["log,actuator,label"]}
    flights: dict[str, tuple[float, ...]] = {f"ok{k}": (0.225 + 0.03 * k,) * 4 for k in range(4)}
    flights |= {f"worn{k}": (0.9 + 0.03 * k,) * 4 for k in range(4)}
    flights["new"] = (0.25, 0.28, 0.96, 0.3)
    for seed, (name, frictions) in enumerate(flights.items(), 60):
        each = {surface: (f, f) for surface, f in zip(SURFACES, frictions, strict=True)}
        write_tlog(fly(Flight(seed=seed, duration_s=60.0, friction_nm=each)), folder / f"{name}.tlog")
        for table, worn in (("labels", name[:4] == "worn"), ("inverted", name[:2] == "ok")):
            label = "emergency" if worn else "normal"
            tables[table] += [f"{name}.tlog,{surface},{label}" for surface in SURFACES if name != "new"]
    # A profile without constants and limits: names and outputs alone.
    sections = resources.files("mavhums.actuator").joinpath("airframes/paper.toml").read_text().split("\n\n")
    kept = [part for part in sections if not part.startswith(("[actuators.ema]", "[actuators.limits]"))]
    own = "\n\n".join(kept).replace('name = "paper"', 'name = "own"')
    (folder / "own.toml").write_text(own)
    for table, rows in tables.items():
        (folder / f"{table}.csv").write_text("\n".join(rows))
    return folder


def labelled(own_logs: Path, table: str, base: Path, *whose: str | Path) -> Path:
    """Make a base of the eight logs by a table of labels."""
    logs = [path for path in sorted(own_logs.glob("*.tlog")) if path.stem != "new"]
    added = mavhums("precedents", "add", *logs, "--labels", own_logs / f"{table}.csv", "-d", base, *whose)
    assert (added.exit_code, added.output.count("\n")) == (0, 32)
    return base


def decided_by(own_logs: Path, model: Path, *whose: str | Path) -> dict[str, str]:
    """What a model decides on the new log, by actuator."""
    decide = ("--model", model, "--decide", "network", "--json")
    judged = mavhums("analyse", own_logs / "new.tlog", *decide, *whose)
    return {each["actuator"]: each["worst"] for each in json.loads(judged.output)["verdicts"]}


@pytest.mark.slow
@pytest.mark.parametrize(("table", "constants"), [("labels", True), ("inverted", True), ("inverted", False)])
def test_labels_alone_decide_the_verdicts(
    table: str, constants: bool, own_logs: Path, tmp_path: Path
) -> None:
    """From eight labelled logs to the verdict, without simulator; inverted labels invert it."""
    whose = () if constants else ("--airframe", own_logs / "own.toml")
    base, model = labelled(own_logs, table, tmp_path / "base", *whose), tmp_path / "own.safetensors"
    options = ("--flights", "0", "--networks", "5", *whose)
    trained = mavhums("train", *options, "--precedents", base, "-o", model)
    assert trained.exit_code == 0, trained.output
    assert "8 logs (4 normal, 4 friction_emergency): 4 train, 2 calibrate, 2 measure" in trained.output
    assert re.search(r"on precedents not trained on \d", trained.output)
    assert ("no network of windows" in trained.output) is not constants
    said = decided_by(own_logs, model, *whose)
    worn, healthy = ("emergency", "normal") if table == "labels" else ("normal", "emergency")
    assert said == dict.fromkeys(SURFACES, healthy) | {"elevator": worn}
    exported = tmp_path / "new.parquet"
    outcome = mavhums("export", own_logs / "new.tlog", "--classify", "--model", model, "-o", exported, *whose)
    assert outcome.exit_code == 0, outcome.output


@pytest.mark.slow
def test_labels_against_the_simulation_are_followed_at_their_weight(
    own_logs: Path, tmp_path: Path, short_flights: None
) -> None:
    """They turn the votes and the windows, and the calibration does not turn them back."""
    base, model = labelled(own_logs, "inverted", tmp_path / "base"), tmp_path / "model"
    options = f"train --flights 2 --networks 10 --flown-weight 1000 --precedents {base} -o {model}".split()
    trained = mavhums(*options)
    assert trained.exit_code == 0, trained.output
    said = decided_by(own_logs, model)
    assert (said["elevator"], said["rudder"]) == ("normal", "emergency")


@pytest.mark.parametrize("fault", ["friction_emergency", "backlash"])
def test_a_command_that_distinguishes_the_classes_is_warned_of(fault: str, tmp_path: Path) -> None:
    base = PrecedentBase(tmp_path)
    time_s = np.arange(1000) / 50
    for number in range(12):
        worn = number % 2 == 1
        command = np.sin(time_s) * (30 if worn else 5)
        values = np.column_stack([command, *[np.gradient(command, time_s) / 6] * 11])
        values[:, 6] *= 300
        measured = np.isin(np.arange(12), [1, 2], invert=True) & np.isfinite(values)
        label = fault if worn else "normal"
        base.add(provenance(number, "elevator", label), (time_s * 1e6).astype(np.int64), values, measured)
    lines: list[str] = []
    flown = of_precedents(FlownFlights(base, load_airframe("paper"), seed=1), TRAINS)
    with pytest.warns(CommandLeakWarning, match=r"Cramér's V 0\.[5-9]"):
        samples, *_ = training_samples(flown, (), "precedents", lines.append)
    assert "Cramér's V" in lines[0]
    # No network is asked with an angle that is not measured.
    assert np.isnan(samples).all(axis=0).tolist() == [k in (1, 2) for k in range(12)]
