"""Who decides: the physics, a network, or both; said once, and the same in the JSON and in words."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.learn import Network, save_model
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.conditions import Condition
from tests.conftest import Run

DECIDE = ("physics", "network", "both")


@pytest.fixture(scope="module")
def wound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty seconds in which the elevator's winding has three times its resistance, at healthy friction."""
    path = tmp_path_factory.mktemp("wound") / "wound.tlog"
    faults = {"elevator": (Condition("resistance", 2.0, 2.0),)}
    write_tlog(fly(Flight(seed=5, duration_s=40.0, rate_hz=50.0, conditions=faults)), path)
    return path


@pytest.fixture(scope="module")
def by_voltage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that takes a high voltage, whatever raises it, for friction."""
    known = mavhums.load_model("paper-esc")
    steep, volts, half = 80.0, 4.0, 60.0
    high = (half + np.array([volts, -volts])) / (2 * half)  # thresholds on the unit interval
    network = Network(
        keys=("V4",),
        minimum=np.array([-half]),
        maximum=np.array([half]),
        w1=np.array([[steep, -steep]]),
        b1=np.array([-steep * high[0], steep * high[1]]),
        w2=np.array([[1.0, -1.0], [1.0, -1.0]]),
        b2=np.array([1.0, -1.0]),
    )
    changes = {"name": "by-voltage", "features": ("V4",), "calibration": None, "window": None}
    card = known.card.model_copy(update=changes)
    path = tmp_path_factory.mktemp("model") / "by-voltage.safetensors"
    save_model(path, network, card)
    return path


def elevator(text: str) -> dict[str, Any]:
    verdicts = json.loads(text)["verdicts"]
    return next(verdict for verdict in verdicts if verdict["actuator"] == "elevator")


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.slow
@pytest.mark.parametrize("decide", DECIDE)
def test_a_network_that_takes_the_winding_for_friction(
    run: Run, wound: Path, by_voltage: Path, decide: str
) -> None:
    options = ["--model", by_voltage, "--decide", decide]
    outcome = run("analyse", wound, *options, "--json")
    verdict = elevator(outcome.out)
    network, faults = verdict["network"], {suspect["fault"] for suspect in verdict["suspects"]}
    assert network["model"]["name"] == "by-voltage"
    assert network["inputs"] == {"samples": ["V4"], "windows": []}
    assert (network["condition"], network["decides"]) == ("emergency", decide)
    assert network["windows"] > 20
    assert 5.0 <= network["first_emergency_s"] < 15.0
    assert 0.5 < network["share_of_samples"] <= 1.0
    kinds = {item["kind"] for item in verdict["evidence"]}
    text = flat(run("analyse", wound, *options).out)
    if decide == "network":
        assert outcome.code == ExitCode.EMERGENCY
        assert (verdict["condition"], faults) == ("emergency", {"friction", "winding_resistance"})
        assert "network" in kinds
        assert "friction" not in kinds
        assert "elevator: the network by-voltage decides, not the physics: " in text
        assert "windows are friction emergency" in text
    else:
        assert outcome.code == ExitCode.DEGRADED
        assert (verdict["condition"], faults) == ("degraded", {"winding_resistance"})
        assert "network" not in kinds
    disagrees = "; by the physics: winding resistance"
    assert (disagrees in text) == (decide == "both")
    assert ("the network by-voltage" in text) == (decide != "physics")


def test_report_and_markdown_say_it_in_one_sentence(
    run: Run, wound: Path, by_voltage: Path, tmp_path: Path
) -> None:
    from mavhums.show.markdown_report import markdown

    sentence = "the network by-voltage disagrees: "
    page = tmp_path / "r.html"
    assert run("report", wound, "-o", page, "--model", by_voltage, "--decide", "both").code == 10
    assert sentence in page.read_text()
    assert 'class="samples"' in page.read_text()
    for decide, times in (("physics", 0), ("both", 1)):
        options = mavhums.Options(model=by_voltage, decide=decide)  # type: ignore[arg-type]
        assert markdown(mavhums.analyse(wound, options)).count(sentence) == times


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute in which the elevator's friction grows from 0.2 to 1.6 N·m; 0.875 are crossed at 28.9 s."""
    path = tmp_path_factory.mktemp("worn") / "worn.tlog"
    flight = Flight(seed=11, duration_s=60.0, rate_hz=50.0, friction_nm={"elevator": (0.2, 1.6)})
    write_tlog(fly(flight), path)
    return path


@pytest.mark.slow
def test_the_classes_of_the_windows_are_the_conditions(run: Run, tmp_path: Path) -> None:
    """Three frictions between the limits are degraded, whoever decides."""
    friction = {"aileron_left": (0.6, 0.6), "elevator": (0.7, 0.7), "rudder": (0.8, 0.8)}
    flight = Flight(seed=21, friction_nm=friction)
    path = tmp_path / "degraded.tlog"
    write_tlog(fly(replace(flight, parameters=flight.parameters.two_masses())), path)
    for decide in DECIDE:
        outcome = run("analyse", path, "--decide", decide, "--json")
        assert outcome.code == ExitCode.DEGRADED
        verdicts = {each["actuator"]: each for each in json.loads(outcome.out)["verdicts"]}
        assert {name: each["condition"] for name, each in verdicts.items()} == {
            name: "degraded" if name in friction else "normal" for name in verdicts
        }
        for name in friction:
            network = verdicts[name]["network"]
            assert (network["condition"], network["says"]) == ("degraded", "friction_degraded")
            assert next(iter(network["classes"])) == "friction_degraded"
            assert verdicts[name]["suspects"][0]["fault"] == "friction"
    assert "the network paper-instrumented agrees" in flat(run("analyse", path, "--decide", "both").out)


@pytest.mark.parametrize("decide", DECIDE)
def test_where_they_agree_the_verdict_is_the_same(run: Run, worn: Path, decide: str) -> None:
    verdict = elevator(run("analyse", worn, "--decide", decide, "--json").out)
    assert (verdict["condition"], verdict["network"]["condition"]) == ("emergency", "emergency")
    assert verdict["network"]["first_emergency_s"] == pytest.approx(28.9, abs=8.0)
    evidence = [item for item in verdict["evidence"] if item["kind"] == "network"]
    assert bool(evidence) == (decide == "network")
    if evidence:  # from when on the network says so, and not the last window alone
        assert [item["rule"].split(":")[0] for item in evidence] == ["degraded", "emergency"]
        assert evidence[1]["start_s"] == pytest.approx(28.9, abs=8.0)
    sentence = "the network paper-instrumented agrees"
    assert (sentence in flat(run("analyse", worn, "--decide", decide).out)) == (decide == "both")


def test_fewer_windows_than_must_agree_are_undecided_with_the_reason(run: Run, short_log: Path) -> None:
    verdict = elevator(run("analyse", short_log, "--decide", "network", "--json").out)
    assert (verdict["condition"], verdict["network"]["condition"]) == ("undecided", "undecided")
    assert "of no condition in two separate ones" in verdict["reason"]


def test_a_history_keeps_the_networks_decision(run: Run, worn: Path, tmp_path: Path) -> None:
    """Held against earlier flights, the verdict is still the network's."""
    alone = elevator(run("analyse", worn, "--decide", "network", "--json").out)
    store = ("--store", tmp_path / "flights", "--aircraft", "=D-A", "--keep")
    for _ in range(2):
        kept = run("analyse", worn, "--decide", "network", "--json", *store)
        assert elevator(kept.out)["condition"] == alone["condition"]
        assert elevator(kept.out)["evidence"] == alone["evidence"]
