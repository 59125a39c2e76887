"""One fault, one finding: which axis explains the others, and which of two mixed surfaces failed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from mavhums.health.axis.findings import origins
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.results.verdict import Evidence
from mavhums.vehicle.rows import Rows
from tests.health.axis.flights import changes_of, excited, late, rolling, rows, steady
from tests.health.axis.test_detectors import controlled

LEAST_ROWS_PER_S = 14
MASKED_S = 20
ELEVONS = {"roll": "pitch", "pitch": "roll"}


def mixed(side: str, left: float) -> Rows:
    """Elevons of which one keeps a share of its effect from 100 s on; only the roll has a reference."""
    flight = steady(160)
    roll, pitch = excited(160), excited(160, seed=9, size=0.1)
    flight["outputs"][:, 0], flight["outputs"][:, 1] = roll, pitch
    lost = (1 - left) * (np.arange(roll.size) >= 2000)
    taken = {"left": (roll + pitch) / 2, "right": (roll - pitch) / 2, "both": roll}[side]
    rate = 2.2 * (roll - lost * taken)
    noise = 0.03 * np.random.default_rng(3).normal(size=roll.size)
    flight["roll_rate"] = late(rate) + noise
    return rows(flight)


@pytest.mark.parametrize(("side", "left"), [("right", 0.0), ("left", 0.2), ("both", 0.5)])
def test_the_coupling_separates_mixed_surfaces(side: str, left: float) -> None:
    monitor, flight = AxisMonitor(1, mixed=ELEVONS), mixed(side, left)
    assert [c.after for c in changes_of(monitor, flight)][-1] in ("degraded", "emergency")
    shares = monitor.findings("roll").shares
    assert shares[side] > 0.95
    assert sum(shares.values()) == pytest.approx(1.0)
    pieces = AxisMonitor(1, mixed=ELEVONS)
    for second in range(flight.seconds):
        changes_of(pieces, flight.cut(second, second + 1))
    assert pieces.findings("roll").shares == pytest.approx(shares)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_coupling_shows_a_small_loss_of_one_of_two_mixed_surfaces(side: str) -> None:
    """Half of one is a quarter of the gain, which the axis alone does not show here."""
    flight = mixed(side, 0.5)
    assert {change.after for change in changes_of(AxisMonitor(1), flight)} <= {"unchanged", "undecided"}
    alarms = [c for c in changes_of(AxisMonitor(1, mixed=ELEVONS), flight) if c.after == "degraded"]
    assert 100.0 < alarms[0].time_s <= 120.0


def test_without_mixed_surfaces_or_without_a_fault_nothing_separates_them() -> None:
    monitor = AxisMonitor(1)
    changes_of(monitor, mixed("left", 0.0))
    assert monitor.findings("roll").shares == {}
    healthy = AxisMonitor(1, mixed=ELEVONS)
    changes_of(healthy, rolling(160, lambda t: 2.2 + 0 * t))
    assert healthy.findings("roll").shares == {}


def skidding(shift: float, skid: Mapping[int, float]) -> AxisMonitor:
    """A roll that goes astray at 100 s, with a side force, m/s², from some seconds on."""
    flight = controlled(160)
    flight["roll_rate"][100 * 20 :] += shift
    for second, force in skid.items():
        flight["side_force"][second * 20 :] = force
    monitor = AxisMonitor(1)
    changes_of(monitor, rows(flight))
    return monitor


def test_a_rudder_rolls_the_aircraft_before_it_skids() -> None:
    monitor = skidding(0.6, {102: 1.6})
    yaw = monitor.findings("yaw")
    assert yaw.worst == "emergency"
    assert "1.6 m/s² to the right" in yaw.evidence[0].rule
    assert monitor.origins() == {"roll": "yaw"}


@pytest.mark.parametrize(
    ("shift", "skid"), [(0.6, {102: 1.0, 104: 0.0}), (0.6, {102: 0.4}), (0.0, {102: 1.6})]
)
def test_a_short_a_small_or_a_lone_skid_is_no_rudders(shift: float, skid: Mapping[int, float]) -> None:
    monitor = skidding(shift, skid)
    assert monitor.findings("yaw").worst == "undecided"
    assert monitor.origins() == {}


def test_a_deflected_aileron_explains_the_pitch_but_losses_do_not_explain_each_other() -> None:
    flight = controlled(160)
    flight["roll_rate"][100 * 20 :] += 0.6
    flight["pitch"][110 * 20 :] -= 0.6
    monitor = AxisMonitor(1)
    changes_of(monitor, rows(flight))
    assert monitor.origins() == {"pitch": "roll"}


def evidence(kind: str, start_s: float, end_s: float) -> Evidence:
    return Evidence(kind=kind, start_s=start_s, end_s=end_s, value=0.0, limit=0.0, rule="")


ROLL, PITCH = {"roll": ("effectiveness", 10)}, {"pitch": ("effectiveness", 11)}
DEFLECTED = {"roll": ("hard_over", 10)}


@pytest.mark.parametrize(
    ("shown", "mixed", "explained"),
    [
        (DEFLECTED, (), {}),
        (DEFLECTED | PITCH, (), {"pitch": "roll"}),
        ({"roll": ("tracking", 12)} | PITCH, (), {"roll": "pitch"}),
        (ROLL | PITCH, (), {}),
        (ROLL | PITCH, ("roll", "pitch"), {"pitch": "roll"}),
        (ROLL | PITCH, ("pitch", "yaw"), {}),
        (ROLL | {"yaw": ("effectiveness", 11)}, (), {"yaw": "roll"}),
        # Onsets are known to within a manoeuvre, and the rudder is measured beside the ailerons.
        ({"roll": ("effectiveness", 10 + MASKED_S), "yaw": ("effectiveness", 10)}, (), {"yaw": "roll"}),
        ({"roll": ("effectiveness", 11 + MASKED_S), "yaw": ("effectiveness", 10)}, (), {}),
        ({"roll": ("tracking", 11), "yaw": ("effectiveness", 10)}, (), {"roll": "yaw"}),
        ({"pitch": ("effectiveness", 10), "yaw": ("effectiveness", 11)}, (), {}),
        # A rudder that stays deflected is the origin up to so long after the others, no longer.
        (DEFLECTED | {"yaw": ("hard_over", 10 + MASKED_S)}, (), {"roll": "yaw"}),
        (DEFLECTED | {"yaw": ("hard_over", 11 + MASKED_S)}, (), {"yaw": "roll"}),
        (DEFLECTED | {"yaw": ("tracking", 10 + MASKED_S)}, (), {"yaw": "roll"}),
        # What begins long after the origin ended (20 s after it began) is another fault.
        (DEFLECTED | {"pitch": ("tracking", 30 + 2 * MASKED_S)}, (), {"pitch": "roll"}),
        (DEFLECTED | {"pitch": ("tracking", 31 + 2 * MASKED_S)}, (), {}),
    ],
)
def test_the_earliest_axis_explains_what_its_surfaces_can_cause(
    shown: dict[str, tuple[str, float]], mixed: tuple[str, ...], explained: Mapping[str, str]
) -> None:
    faulty = {
        axis: [evidence(kind, at_s + 5, at_s + 20), evidence(kind, at_s, at_s + 9)]
        for axis, (kind, at_s) in shown.items()
    }
    assert origins(faulty, mixed) == explained
