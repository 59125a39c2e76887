"""Control effectiveness against flights whose gain is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.axis.reference import Loss, Second
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from tests.health.axis.flights import (
    SPEED,
    Array,
    changes_of,
    excited,
    lagged,
    late,
    rolling,
    rows,
    steady,
    turning,
)
from tests.present import present


def lost(at_s: float, left: float, back_s: float = np.inf) -> Callable[[Array], Array]:
    return lambda t: 2.2 * np.where((t >= at_s) & (t < back_s), left, 1.0)


@pytest.mark.parametrize(
    ("size", "noise", "alone", "known"),
    [
        (0.15, 0.95, 1.0, True),
        (0.15, 1.1, 1.0, False),
        (0.15, 0.1, 0.1, True),
        (0.15, 0.1, 0.01, False),
        (0.022, 0.003, 1.0, True),
        (0.019, 0.003, 1.0, False),
    ],
)
def test_what_a_reference_must_show(size: float, noise: float, alone: float, known: bool) -> None:
    """Noise makes its gain uncertain, and a yaw rate that follows the drive; a drive may be weak."""
    flight = rolling(60, lost(99, 1.0), noise=noise, size=size)
    demand, other = flight.outputs[:, 0], excited(60, seed=5, size=size)
    flight.yaw_rate[:] = late((1 - alone) * demand + alone * other)
    gain = EffectivenessTracker("roll")
    gain.feed(flight)
    assert (gain.reference is not None) is known


def test_the_error_of_the_gain_is_no_shift_of_the_trim() -> None:
    """A strong manoeuvre that is answered by a tenth less than before is no deflected surface."""
    flight = rolling(200, lost(100, 0.9), size=0.03, noise=0.003)
    flight.outputs[2000:, 0] = np.where(np.arange(2000) // 100 % 2, -2.0, 2.0)
    flight.roll_rate[2000:] = 2.2 * 0.9 * flight.outputs[1996:-4, 0]
    assert not [c for c in changes_of(AxisMonitor(1), flight) if c.fault == "hard_over"]


def test_turns_after_a_straight_reference_are_no_shift_of_the_trim() -> None:
    """What a turn adds to the roll rate is not known from a beginning without turns."""
    for seed in range(5):
        flight = rolling(200, lost(999, 1.0), seed=seed)
        flight.yaw_rate[:] = 0.0005 * np.random.default_rng(seed).normal(size=len(flight))
        flight.yaw_rate[2000:] = 0.35
        assert not [c for c in changes_of(AxisMonitor(1), flight) if c.fault == "hard_over"]


def sampled(flight: Rows, every: int) -> Rows:
    """A flight whose rates and outputs are known every so many rows, and drawn straight in between."""
    at = np.arange(len(flight))
    rate = np.interp(at, at[::every], flight.roll_rate[::every])
    outputs = np.stack([np.interp(at, at[::every], row[::every]) for row in flight.outputs.T], axis=1)
    return replace(flight, roll_rate=rate, outputs=outputs, spacing=np.full(len(flight), every / RATE_HZ))


@settings(max_examples=10)
@given(size=st.floats(5.0, 8.0), rows_long=st.integers(1, 5), seed=st.integers(0, 99))
def test_what_happens_between_samples_is_no_shift_of_the_trim(size: float, rows_long: int, seed: int) -> None:
    """At 4 Hz a quick reversal shows in the outputs or in the rates, or in neither."""
    flight = rolling(120, lost(999, 1.0), noise=0.003, seed=seed)
    flight.outputs[1600 + seed % 5 :, 0] = 0.0
    flight.outputs[1800 + seed % 5 : 1800 + seed % 5 + rows_long, 0] = size
    flight.roll_rate[1600:] = 2.2 * flight.outputs[1596:-4, 0]
    coarse = sampled(flight, 5)
    changes = [c for c in changes_of(AxisMonitor(1), coarse) if c.fault == "hard_over"]
    assert not changes


def certain(seconds: Sequence[Second]) -> list[Loss]:
    """Return the certain losses among the results of seconds."""
    return [second.loss for second in seconds if second.loss and second.loss.certain]


def slowed(flight: Rows, tau_s: float, from_s: int) -> Rows:
    """The same flight with a servo that follows its demand through a lag from then on."""
    slow = late(lagged(flight.outputs[:, 0], tau_s))
    flight.roll_rate[from_s * 20 :] = 2.2 * slow[from_s * 20 :]
    return flight


@pytest.mark.parametrize(
    ("axis", "spacing", "judged"),
    [
        ("roll", 0.1, True),
        ("roll", 0.35, True),
        ("roll", 0.5, False),
        ("pitch", 0.35, None),
        ("pitch", 0.5, False),
    ],
)
def test_streams_below_three_hertz_give_no_reference(axis: str, spacing: float, judged: bool | None) -> None:
    """In pitch this flight explains nothing, whatever its rate."""
    gain = EffectivenessTracker(axis)
    gain.feed(replace(rolling(80, lost(99, 1.0)), spacing=np.full(80 * 20, spacing)))
    assert (gain.reference is not None) is bool(judged)
    assert gain.too_slow is (judged is False)


@pytest.mark.parametrize(("damping", "judged"), [(-2.0, True), (2.0, False)])
def test_a_pitch_reference_without_damping_is_refused(damping: float, judged: bool) -> None:
    """An undamped aircraft flies under an autopilot that damps it, and q̇ answers to its demand as well."""
    flight, demand = steady(60), excited(60)
    rate = np.zeros(demand.size)
    for k in range(1, rate.size):
        trim = -8.0 * rate[k - 1] if damping > 0 else 0.0
        flight["outputs"][k, 1] = demand[k] + trim / 6.0
        rate[k] = rate[k - 1] + (6.0 * flight["outputs"][k, 1] + damping * rate[k - 1]) / 20
    flight["pitch_rate"] = rate
    gain = EffectivenessTracker("pitch")
    gain.feed(rows(flight))
    assert (gain.reference is not None) is judged


def test_a_doubted_airspeed_gives_no_effectiveness() -> None:
    flight = rolling(200, lost(100, 0.4))
    flight.trusted[95 * 20 :] = False
    assert not [c for c in changes_of(AxisMonitor(1), flight) if c.after in ("degraded", "emergency")]


def test_the_tail_of_one_manoeuvre_is_no_evidence() -> None:
    """One strong manoeuvre whose answer is cut short, as by slow samples, in an otherwise quiet flight."""
    flight = rolling(150, lost(999, 1.0), noise=0.005, size=0.04)
    spike = slice(100 * 20, 101 * 20)
    flight.outputs[spike, 0] += 0.6
    flight.roll_rate[100 * 20 + 4 : 101 * 20 + 4] += 0.6 * 2.2 * 0.6
    assert not certain(EffectivenessTracker("roll").feed(flight))


def test_a_slow_servo_stays_slow_through_the_flight() -> None:
    flight = slowed(rolling(300, lost(999, 1.0), noise=0.01), 0.5, 100)
    monitor = AxisMonitor(1)
    list(monitor.feed(flight))
    found = monitor.findings("roll")
    assert (found.condition, found.worst) == ("degraded", "degraded")
    assert {suspect.fault for suspect in found.suspects} == {"slow"}
    assert found.evidence[-1].end_s > 280
    assert found.evidence[-1].value == pytest.approx(0.5, abs=0.16)


def test_gusts_that_the_autopilot_fights_are_no_loss() -> None:
    flight = rolling(300, lost(999, 1.0))
    gusts = excited(300, seed=7, size=0.6)
    at = slice(2400, None)
    flight.roll_rate[at] += gusts[at]
    flight.outputs[at, 0] -= 0.12 * np.append(gusts[4:], np.zeros(4))[at]
    assert not certain(EffectivenessTracker("roll").feed(flight))


def test_a_loss_counts_only_while_gusts_leave_the_gain_certain() -> None:
    def found(gusts: float) -> bool:
        flight = rolling(200, lost(100, 0.5), noise=0.005)
        flight.roll_rate[2000:] += excited(100, seed=7, size=gusts)
        return bool(certain(EffectivenessTracker("roll").feed(flight)))

    assert found(0.02)
    assert not found(0.6)


def test_the_trim_of_a_turn_is_no_loss_of_gain() -> None:
    """Twelve seconds of a turn after each reversal need the same aileron: no independent evidence."""
    flight = turning(60, spiral=0.3)
    later = turning(400, spiral=0.3, every_s=25)
    gain = EffectivenessTracker("roll")
    gain.feed(flight)
    assert present(gain.reference).gain == pytest.approx(2.2, rel=0.03)
    assert present(gain.reference).others[1] == pytest.approx(0.3, abs=0.05)
    assert not certain(gain.feed(replace(later, second=60, fresh=False)))


def test_a_change_of_trim_is_no_loss_of_gain() -> None:
    flight = rolling(200, lost(999, 1.0), noise=0.02, delay=0)
    flight.roll_rate[2400:] += 0.15
    assert {change.after for change in changes_of(AxisMonitor(1), flight)} == {"unchanged"}


def test_a_weak_drive_in_quiet_air_makes_no_reference() -> None:
    """A log begins in a calm straight leg, where the answer to gusts looks like twice the gain."""
    flight, time_s = steady(240), np.arange(240 * 20) / 20
    calm = time_s < 100
    demand = excited(240) * np.where(calm, 0.05, 1.0)
    noise = 0.002 * np.random.default_rng(2).normal(size=demand.size)
    flight["outputs"][:, 0] = demand
    flight["roll_rate"] = np.where(calm, 4.4, 2.2) * late(demand) + noise
    monitor = AxisMonitor(1)
    assert {change.after for change in changes_of(monitor, rows(flight))} == {"unchanged"}
    reference = present(monitor.findings("roll").reference)
    assert reference.gain == pytest.approx(2.2, rel=0.1)


def test_the_power_curve_of_a_loss_rises_with_what_is_lost_and_each_share_is_measured() -> None:
    """A worse loss is never a milder verdict, found no later, and one of a tenth is none."""
    found = []
    for left in (1.0, 0.9, 0.7, 0.5, 0.0):
        monitor = AxisMonitor(1)
        changes = changes_of(monitor, rolling(180, lost(100, left)))
        shown = monitor.findings("roll")
        assert next(c.after for c in changes if c.actuator == "roll") == "unchanged"
        assert shown.condition == shown.worst
        assert present(shown.effectiveness).low < left + 0.1
        assert present(shown.effectiveness).estimate == pytest.approx(left, abs=0.12)
        found.append(shown.condition)
        if shown.suspects:
            assert shown.suspects[0].fault in ("effectiveness", "hard_over")
            assert 95 <= (shown.since_s or 0.0) <= 115
    assert found == ["unchanged", "unchanged", "degraded", "emergency", "emergency"]


def test_of_a_circle_at_full_lock_the_error_of_the_speed_is_no_loss() -> None:
    """The deflection does not change: the drive varies with the measured speed alone, which turns nothing."""
    flight, seconds = steady(360), 360
    demand = excited(seconds)
    demand[60 * 20 :] = 1.0
    flight["outputs"][:, 2] = demand
    noise = np.random.default_rng(5).normal(size=demand.size)
    flight["yaw_rate"] = 0.3 * demand + 0.01 * noise
    flight["speed"] = SPEED * (1.0 + excited(seconds, seed=3, size=0.1))
    tracker = EffectivenessTracker("steering")
    tracker.feed(rows(flight))
    assert tracker.reference is not None
    assert present(tracker.highest_evidence) < 5.0


@pytest.mark.parametrize(
    ("speed", "through_water", "found"), [(1.0, False, True), (1.0, True, False), (4.0, True, True)]
)
def test_what_the_error_of_a_boats_speed_explains_is_no_loss(
    speed: float, through_water: bool, found: bool
) -> None:
    flight, demand = steady(360), excited(360)
    flight["outputs"][:, 2] = demand
    flight["speed"] = np.full(demand.size, speed)
    flight["sources"] += 3.0 if through_water else 2.0
    noise = 0.01 * np.random.default_rng(5).normal(size=demand.size)
    flight["yaw_rate"] = 0.8 * np.where(np.arange(demand.size) < 120 * 20, 1.0, 0.76) * demand + noise
    assert bool(certain(EffectivenessTracker("steering").feed(rows(flight)))) is found


@pytest.mark.parametrize(
    ("speed", "source", "found"), [(18.0, 0.0, True), (18.0, 1.0, False), (60.0, 1.0, True)]
)
def test_in_pitch_the_error_of_the_wind_triangle_is_no_loss(speed: float, source: float, found: bool) -> None:
    """The gain grows with the square of the speed, which the triangle knows to 2 m/s."""
    flight, demand = steady(360), excited(360)
    flight["outputs"][:, 1] = demand
    flight["speed"] = np.full(demand.size, speed)
    flight["sources"] += source
    left = np.where(np.arange(demand.size) < 120 * 20, 1.0, 0.75)
    rate = lfilter([0.05 * 8.0], [1.0, 0.05 * 4.0 - 1.0], left * demand)  # q̇ = 8 δ − 4 q
    flight["pitch_rate"] = rate + 0.002 * np.random.default_rng(5).normal(size=demand.size)
    tracker = EffectivenessTracker("pitch")
    assert bool(certain(tracker.feed(rows(flight)))) is found
    assert tracker.reference is not None


@pytest.mark.parametrize(
    ("left", "turns_s", "found"), [(0.74, 0, True), (0.74, 90, False), (0.74, 360, True), (0.4, 90, True)]
)
def test_the_wind_that_turns_show_after_the_reference_is_no_loss(
    left: float, turns_s: int, found: bool
) -> None:
    """Before the first turns the wind is in the speed; what it explains of a change then is no loss."""
    flight = rolling(360, lost(90, left))
    flight.settled[: turns_s * RATE_HZ] = False
    tracker = EffectivenessTracker("roll")
    assert bool(certain(tracker.feed(flight))) is found
    assert tracker.reference is not None
