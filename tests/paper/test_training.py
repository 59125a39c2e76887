"""The flights that models learn from, and the models that come of them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mavhums
from mavhums.actuator.profile import load_airframe
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS, WINDOW_KEYS, column
from mavhums.learn import Scheme, load_model, packaged_models, save_model
from mavhums.learn.evaluation import CommandLeak
from mavhums.paper.flights import (
    TELEMETRY,
    Fleet,
    ModelOptions,
    fly_fleet,
    friction_range,
    moving_samples,
    windows,
)
from mavhums.paper.train import train_model
from mavhums.paper.windows import classes_of, fly_windows, keys_of
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.conditions import Condition
from mavhums_sim.individuals import Individual
from tests.conftest import Run

AIRFRAME = load_airframe("paper")
ACTUATOR = AIRFRAME.actuators[2]


def shorter(flight: Flight) -> object:
    return fly(replace(flight, duration_s=20.0))


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["esc-signed", "esc-unsigned"])
def test_esc_telemetry_is_what_mapping_a_log_makes_of_it(tier: str, tmp_path: Path) -> None:
    """The same flight through messages and through memory; the samples' times differ by milliseconds."""
    frictions = np.full((1, 4), 0.3)
    found = [*fly_fleet(Fleet(ACTUATOR, TELEMETRY["esc"], 5, ["takeoff"]), frictions)]
    k = 0 if tier == "esc-signed" else 1
    flight = Flight(
        seed=5,
        friction_nm=dict.fromkeys(("aileron_left", "aileron_right", "elevator", "rudder"), (0.3, 0.3)),
        individuals=5,
        tiers=(tier, "pwm"),
    )
    flight = replace(
        flight, parameters=flight.parameters.two_masses(), rates=replace(flight.rates, esc=100.0)
    )
    write_tlog(fly(flight), tmp_path / "esc.tlog")
    history = mavhums.actuators(mavhums.read_log(tmp_path / "esc.tlog"), "paper")[AIRFRAME.actuators[k].name]
    mapped = history.frame.to_numpy()
    columns = [column(key) for key in TELEMETRY["esc"].keys]
    for column_ in columns:
        ours, theirs = found[k].values[:, column_], mapped[:, column_]
        assert np.isfinite(ours).mean() == pytest.approx(np.isfinite(theirs).mean(), abs=0.02)
        for quantile in (0.05, 0.25, 0.75, 0.95):
            scale = np.nanstd(theirs)
            assert np.nanquantile(ours, quantile) == pytest.approx(
                np.nanquantile(theirs, quantile),
                abs=max(0.05 * scale, 0.0101),  # no less than a quantum
            )
    assert np.isnan(found[k].values[:, [column("V11"), column("V12")]]).all()


def test_the_fleet_is_of_individuals_with_the_frictions_asked_for() -> None:
    frictions = np.array([[0.2, 0.3, 0.4, 0.5], [1.0, 1.1, 0.9, 0.8]])
    fleet = Fleet(ACTUATOR, TELEMETRY["without-load"], 3, ["takeoff", "preflight"], [25.0])
    flown = [*fly_fleet(fleet, frictions)]
    assert [each.friction_nm for each in flown] == frictions.ravel().tolist()
    assert [each.flight for each in flown] == [0] * 4 + [1] * 4
    assert {each.cyclogram for each in flown[4:]} == {"preflight"}
    assert all(len(each.time_s) == 2500 for each in flown)
    first = flown[0].values
    assert np.isnan(first[:, 10:]).all()
    assert np.isfinite(first[:, :10]).all()
    assert Individual.draw(3, 0) != Individual()
    # A gear that gives way: the output's speed is not the rotor's over N.
    assert not np.allclose(first[:, 9], first[:, 6] / 300, atol=1e-3)


def test_windows_are_the_monitors() -> None:
    """The same votes as those that the engine counts slot by slot."""
    from mavhums.health.actuator.monitor import Monitor
    from mavhums.health.decision.events import Window

    models = [
        replace(model, window=None, card=model.card.model_copy(update={"window": None}))
        for model in packaged_models()
    ]
    frictions = np.array([[0.3, 0.95, 0.3, 0.95]])
    for flown in fly_fleet(Fleet(ACTUATOR, TELEMETRY["instrumented"], 9, ["turns"]), frictions):
        monitor = Monitor(1, ACTUATOR, models)
        events = [*monitor.feed(flown.time_s, flown.values, flown.measured), *monitor.finish()]
        seen = {e.start_s: e.p_fault for e in events if isinstance(e, Window)}
        ours = [vote.p_fault if vote else None for vote, _ in windows(ACTUATOR, models, flown)]
        assert ours == [seen[10.0 * k] for k in range(10)]
        assert all((p is not None) and (p > 0.5) == (flown.friction_nm > 0.6) for p in ours)
        moving, seconds = moving_samples(ACTUATOR, flown)
        assert len(moving) == len(seconds)
        assert (np.diff(seconds) >= 0).all()


@pytest.mark.slow
def test_a_model_for_less_is_trained_calibrated_and_repeatable(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tier = "esc"
    monkeypatch.setattr("mavhums.paper.flights.fly", shorter)
    monkeypatch.setattr("mavhums.paper.windows.fly", shorter)
    seen: list[tuple[int, int]] = []
    said: list[str] = []
    network, card, window = train_model(
        AIRFRAME,
        ModelOptions(tier, flights=2, scheme=Scheme(networks=2, vectors=300)),
        report=said.append,
        progress=lambda *step: seen.append(step),
    )
    assert seen == [(k, 36) for k in range(1, 37)]
    assert card.window is not None
    assert window is not None
    assert card.window.classes == classes_of(TELEMETRY[tier])
    assert card.window.features == window.keys
    assert set(window.keys) <= set(keys_of(TELEMETRY[tier]))
    assert sum(sum(row.values()) for row in card.window.confusion.values()) == card.window.metrics["windows"]
    assert card.features == network.keys
    assert set(card.features) <= set(card.selection.selected) < set(TELEMETRY[tier].keys)
    assert card.name == f"paper-{tier}"
    assert card.conditions["not_offered"] == TELEMETRY[tier].withheld
    assert card.selection.wrapped is not None
    assert card.selection.wrapped.costs.keys() == {*card.features}
    assert card.calibration is not None
    assert card.calibration.slope > 0
    assert card.calibration.metrics["windows_measured"] > 5
    assert {"samples_in_motion_right", "windows_right"} < card.metrics.keys()
    assert any(re.match("network of samples: .* on simulated flights not trained on", line) for line in said)
    assert said[-1].startswith("network of windows, on simulated flights not trained on: ")
    again = run(*card.command.replace("MODEL", str(tmp_path / "again")).split()[1:])
    assert again.code == 0
    printed = again.out.splitlines()[: len(said)]
    assert [line.partition("  [")[0] for line in printed] == [line.partition("  [")[0] for line in said]
    assert all(re.search(r"  \[\d+\.\d s, \d+ MiB\]$", line) for line in printed if line[0] != " ")
    save_model(tmp_path / "first", network, card, window)
    assert (tmp_path / "again").read_bytes() == (tmp_path / "first").read_bytes()
    shown = " ".join(run("model", "show", tmp_path / "again").out.split())
    for each in card.selection.excluded:
        assert f"drops {each.expression}" in shown


@pytest.mark.slow
def test_a_model_that_never_votes_is_not_calibrated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavhums.paper.flights.fly", shorter)
    monkeypatch.setattr("mavhums.paper.windows.fly", shorter)
    monkeypatch.setattr("mavhums.paper.train.windows", lambda *_: iter([(None, 0)]))
    # A command that differs between the classes is not offered.
    monkeypatch.setattr("mavhums.paper.samples.check_command", lambda *_: CommandLeak(1.0, 0.001, True))
    said: list[str] = []
    options = ModelOptions(flights=1, scheme=Scheme(networks=1, vectors=100))
    _, card, _ = train_model(AIRFRAME, options, report=said.append)
    assert not {"V1", "V2"} & card.selection.chi_square.keys()
    assert card.conditions["not_offered"] == dict.fromkeys(
        ("V1", "V2"), "its distribution differs between the classes"
    )
    assert card.calibration is None
    assert any("too rarely" in line for line in said)


def test_the_frictions_flown_are_the_papers_and_scale_with_the_limits() -> None:
    assert friction_range(ACTUATOR.known_limits()) == pytest.approx((0.225, 1.025))


def test_a_telemetry_that_is_none_is_refused() -> None:
    with pytest.raises(MavhumsError, match="no model is for telemetry 'pwm'"):
        train_model(AIRFRAME, ModelOptions("pwm"))


def test_packaged_models_say_how_they_were_made() -> None:
    for model, telemetry in zip(packaged_models(), TELEMETRY.values(), strict=True):
        command = f"mavhums train --airframe paper --tier {telemetry.name} --flights 24 --seed 1"
        assert model.card.command == f"{command} {Scheme().command} -o MODEL"
        assert model.card.selection.wrapped is not None
        assert model.card.selection.thinned is not None
        assert model.card.window is not None
        assert model.card.window.selection.wrapped is not None
        assert model.card.window.selection.wrapped.search == "elimination"
        assert set(model.keys) <= set(telemetry.keys) <= set(KEYS)
    assert load_model(Path(mavhums.__file__).parent / "learn/models/paper-esc.safetensors").keys


@pytest.mark.slow
def test_every_condition_flies_the_same_command_and_shows_what_it_is() -> None:
    """Twelve actuators a cyclogram: one statistic shows those that the simulator makes of a fault."""
    telemetry = TELEMETRY["instrumented"]
    flown = fly_windows(ACTUATOR, telemetry, 2, seed=11)
    classes = np.array(classes_of(telemetry))[flown.classes]
    assert set(classes) >= {"normal", "friction_emergency", "winding_resistance", "jam", "sensor_bias"}
    seen = {key: flown.features[:, WINDOW_KEYS.index(key)] for key in keys_of(telemetry)}
    normal = classes == "normal"
    for fault, key, sign in (
        ("friction_emergency", "V5 way", 1),
        ("winding_resistance", "V4|V5", 1),
        ("torque_constant", "V4|V7", -1),
        ("jam", "flown", -1),
    ):
        assert sign * np.median(seen[key][classes == fault]) > sign * np.median(seen[key][normal])
    assert np.abs(seen["gap mean"][classes == "sensor_bias"]).min() > np.abs(seen["gap mean"][normal]).max()
    # Rigid gears are flown beside elastic ones.
    assert seen["gap std"][normal].min() < 0.025 < seen["gap std"][normal].max()


def test_telemetry_without_two_angles_asks_for_no_play_and_no_bias() -> None:
    assert {*classes_of(TELEMETRY["without-load"])} - {*classes_of(TELEMETRY["esc"])} == {
        "backlash",
        "sensor_bias",
    }
    assert not {"gap mean", "V5|V11 way", "missed mean"} & {*keys_of(TELEMETRY["esc"])}
    assert "gap mean" in keys_of(TELEMETRY["without-load"])
    assert "V11 rms" not in keys_of(TELEMETRY["without-load"])


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["instrumented", "esc"])
def test_a_winding_of_twice_its_resistance_is_no_emergency_by_friction(tier: str) -> None:
    """The votes of an ESC's samples took some of these windows for one."""
    from mavhums.health.actuator.monitor import Monitor
    from mavhums.health.decision.events import Window

    doubled, models = Condition.constant("resistance", 1.0), packaged_models()
    for friction, conditions in ((0.3, (doubled,)), (1.2, ())):
        fleet = Fleet(ACTUATOR, TELEMETRY[tier], 4242, ["gusts"], [50.0], conditions)
        for flown in fly_fleet(fleet, np.full((1, 4), friction)):
            monitor = Monitor(1, ACTUATOR, models)
            events = [*monitor.feed(flown.time_s, flown.values, flown.measured), *monitor.finish()]
            said = [
                e.network for e in events if isinstance(e, Window) and e.network not in (None, "abstained")
            ]
            assert len(said) > 50
            assert {each == "friction_emergency" for each in said} == {friction > 1}
            answered = monitor.findings().network
            assert answered is not None
            assert answered.model.hash == models[[*TELEMETRY].index(tier)].hash
