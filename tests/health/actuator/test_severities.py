"""A worse fault is never a milder verdict; ``benchmarks/severities.py`` sweeps it on larger grids."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.quantities import column
from mavhums.learn import packaged_models
from mavhums_sim.conditions import FAULTS
from mavhums_sim.conditions import Condition as Fault
from mavhums_sim.manoeuvres import CYCLOGRAMS
from tests.health.flown import TIERS, actuator_of, flown, reported, telemetry, watch


def verdicts(fault: str, severity: float, seed: int, cyclogram: str) -> dict[str, Condition]:
    worn = Fault.constant(fault, severity)
    flight = flown(worn, rate_hz=25.0, cyclogram=cyclogram, seed=seed, individuals=seed)
    found: dict[str, Condition] = {}
    for tier in TIERS:
        seen, measured = reported(telemetry(flight), tier)
        _, findings = watch(seen, measured=measured)
        found[tier] = max(findings.condition, findings.worst, key=URGENCY.__getitem__)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("cyclogram", CYCLOGRAMS)
def test_a_worse_friction_is_never_milder_whoever_decides(cyclogram: str) -> None:
    """In every tier and mode; by a network a verdict may be undecided below the first fault."""
    seed = 941 + [*CYCLOGRAMS].index(cyclogram)
    said: dict[tuple[str, bool], list[int]] = {}
    for friction in (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.75, 0.95):
        worn = Fault.constant("friction", friction)
        flight = flown(worn, rate_hz=25.0, seconds=60.0, cyclogram=cyclogram, seed=seed, individuals=seed)
        for tier, by_network in itertools.product(TIERS, (False, True)):
            seen, measured = reported(telemetry(flight), tier)
            _, found = watch(
                seen,
                measured=measured,
                networks=packaged_models(),
                decide="network" if by_network else "physics",
            )
            gravest = max(found.condition, found.worst, key=URGENCY.__getitem__)
            said.setdefault((tier, by_network), []).append(max(SEVERITY[gravest], 0))
    assert all(conditions == sorted(conditions) for conditions in said.values()), said
    assert {conditions[0] for conditions in said.values()} == {0}
    for (tier, by_network), conditions in said.items():
        # Of a cruise that hardly moves, magnitudes leave too few windows.
        assert conditions[-1] == 2 or (cyclogram, tier, by_network) == ("cruise", "esc-unsigned", True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "cyclogram"), [(941, "gusts"), (942, "takeoff"), (943, "turns"), (944, "gusts")]
)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_worse_fault_is_never_a_milder_verdict(fault: str, seed: int, cyclogram: str) -> None:
    """Ten steps; at the last ones an estimate was once refused for being too far off."""
    severities = np.linspace(0.0, FAULTS[fault].gravest, 11).tolist()
    found = [verdicts(fault, severity, seed, cyclogram) for severity in severities]
    for (less, before), (more, after) in itertools.pairwise(zip(severities, found, strict=True)):
        for tier in TIERS:
            milder = f"{fault} of {more:g} is {after[tier]} and of {less:g} {before[tier]} ({tier})"
            assert URGENCY[after[tier]] >= URGENCY[before[tier]], milder


@pytest.mark.parametrize("fault", ["friction", "resistance", "torque_constant", "supply_sag", "jam"])
def test_an_actuator_that_cannot_move_its_surface_is_an_emergency(fault: str) -> None:
    """Nine times the winding's resistance leaves a ninth of the torque; a sensor at the shaft shows it."""
    found = verdicts(fault, FAULTS[fault].gravest, 941, "gusts")
    assert {found[tier] for tier in ("instrumented", "csrv")} == {"emergency"}
    assert found["esc-signed"] in ("degraded", "emergency")


@pytest.mark.parametrize("fault", ["friction", "torque_constant", "jam"])
def test_magnitudes_show_a_shaft_that_does_not_move(fault: str) -> None:
    assert verdicts(fault, FAULTS[fault].gravest, 941, "gusts")["esc-unsigned"] == "emergency"


def test_a_load_that_is_measured_does_not_excuse_a_jam() -> None:
    """A gear that locks slowly, at about the motor's torque at stall, looks as if a load held the shaft."""
    flight = flown(Fault.constant("jam", 5.0), rate_hz=25.0, cyclogram="turns", seed=941, individuals=941)
    seen, measured = reported(telemetry(flight), "csrv")
    unloaded = seen.values.copy()
    unloaded[:, column("V11")] = np.nan
    found = [watch(replace(seen, values=values), measured=measured)[1] for values in (seen.values, unloaded)]
    assert [findings.condition for findings in found] == ["emergency", "undecided"]


def test_magnitudes_show_the_winding_where_the_shaft_rests() -> None:
    flight = flown(Fault.constant("resistance", 8.0), rate_hz=25.0, cyclogram="turns", seed=943)
    seen, measured = reported(telemetry(flight), "esc-unsigned")
    _, findings = watch(seen, measured=measured)
    (shown,) = [one for one in findings.indicators if one.fault == "winding_resistance"]
    assert shown.value.estimate == pytest.approx(9.0 * 22.6457, rel=0.05)
    assert findings.condition != "normal"


def test_the_noise_of_the_shafts_speed_is_no_lost_torque_constant() -> None:
    """In calm cruise play and torsion let the shaft move by itself, as fast as the rotor moves it."""
    seen = telemetry(flown(cyclogram="cruise", seconds=100.0, seed=945))
    rotor, shaft = column("V7"), column("V10")
    noise = np.random.default_rng(3).normal(0.0, 0.2, seen.time_s.size)
    seen.values[:, shaft] = seen.values[:, rotor] / actuator_of().known_ema().gear_ratio + noise
    seen.values[:, rotor] = np.nan
    seen, measured = reported(seen, "csrv")
    _, findings = watch(seen, measured=measured)
    assert "torque_constant" not in [suspect.fault for suspect in findings.suspects]
    assert findings.worst in ("normal", "undecided")
