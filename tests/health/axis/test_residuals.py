"""What the residuals of an attitude rest on."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from mavhums.core.arrays import Array, Flags
from mavhums.health.axis.residuals import PitchTracking, Residual, RollTracking, SideForce
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from tests.health.axis.flights import rows, steady

REFERENCE_S = 45
SHIFT_S = 3


class Offset:
    """The roll angle beside an offset; rows in flight are good."""

    def __init__(self, kind: Literal["mean", "rms"] = "mean") -> None:
        self.kind: Literal["mean", "rms"] = kind
        self.floor = 0.01
        self.spreads: tuple[float, ...] = (1e6,)

    def feed(self, rows: Rows) -> tuple[Array, Array, Flags]:
        return np.ones((len(rows), 1)), rows.roll, rows.flying


AFTER = 10


def rolled(after: float, sway: float = 0.0) -> Rows:
    """Return a flight with an offset of 0.2 rad, swaying, and another roll angle for its last seconds."""
    flight = steady(REFERENCE_S + AFTER)
    flight["roll"][:] = 0.2 + sway * np.where(np.arange(len(flight["roll"])) % 2, 1.0, -1.0)
    flight["roll"][REFERENCE_S * RATE_HZ :] = 0.2 + after
    return rows(flight)


@pytest.mark.parametrize(("kind", "sign"), [("mean", -1.0), ("rms", 1.0)])
@pytest.mark.parametrize(("sway", "deviation"), [(0.05, 0.05), (0.001, 0.01)])
def test_a_residual_is_the_mean_of_three_seconds_in_deviations_of_the_reference(
    kind: Literal["mean", "rms"], sign: float, sway: float, deviation: float
) -> None:
    residual = Residual(Offset(kind))
    found = residual.feed(rolled(-0.3, sway))
    assert residual.since_s == REFERENCE_S
    assert residual.deviation == pytest.approx(deviation)
    assert [one.end_s for one in found] == [REFERENCE_S + k for k in range(1, AFTER + 1)]
    assert np.isnan([one.value for one in found[: SHIFT_S - 1]]).all()
    assert [one.value for one in found[SHIFT_S - 1 :]] == pytest.approx([sign * 0.3] * (AFTER - SHIFT_S + 1))
    assert found[-1].deviations == pytest.approx(0.3 / deviation)


@pytest.mark.parametrize(("known", "shown"), [(14, True), (13, False)])
def test_three_seconds_need_enough_rows(known: int, shown: bool) -> None:
    flight = rolled(0.3)
    flying = np.arange(len(flight)) % RATE_HZ < known
    flying[: REFERENCE_S * RATE_HZ] = True
    found = Residual(Offset()).feed(replace(flight, flying=flying))
    assert np.isfinite(found[-1].value) == shown
    if shown:
        assert found[-1].value == pytest.approx(0.3)


def test_after_a_gap_three_seconds_must_pass() -> None:
    residual, flight = Residual(Offset()), rolled(0.3)
    gap = REFERENCE_S + 6
    residual.feed(replace(flight.cut(0, gap), fresh=True))
    found = residual.feed(replace(flight.cut(gap, gap + 4), fresh=True))
    assert np.isfinite([one.value for one in found]).tolist() == [False, False, True, True]


@pytest.mark.parametrize("block", [1, 7])
def test_the_reference_ends_with_a_whole_second_whatever_the_blocks(block: int) -> None:
    flight = rolled(0.3, 0.05)
    flying = np.arange(len(flight)) != 5
    flight = replace(flight, flying=flying)
    whole, cut = Residual(Offset()), Residual(Offset())
    expected = whole.feed(flight)
    found = [
        one
        for begin in range(0, flight.seconds, block)
        for one in cut.feed(replace(flight.cut(begin, min(begin + block, flight.seconds)), fresh=begin == 0))
    ]
    assert whole.since_s == cut.since_s == REFERENCE_S + 1
    np.testing.assert_array_equal(np.array(found), np.array(expected))


def test_what_a_level_flight_says_of_turns_is_hardly_believed() -> None:
    """Gusts pitch the aircraft by three degrees where its wings are hardly low: no turn would do so."""
    seconds = REFERENCE_S + 30
    flight = steady(seconds)
    time_s = np.arange(seconds * RATE_HZ) / RATE_HZ
    flight["roll"] = np.where(time_s < REFERENCE_S + 10, 0.1 * np.sin(time_s), 1.0)
    flight["pitch"] = np.where(time_s < REFERENCE_S + 10, 5.0 * np.sin(flight["roll"]) ** 2, 0.0)
    found = Residual(PitchTracking()).feed(rows(flight))
    assert found[-1].deviations < AxisLimits().pitch_tracking_deviations


def test_a_trim_in_roll_is_believed() -> None:
    flight = steady(REFERENCE_S + AFTER)
    flight["roll"][:] = 0.3
    found = Residual(RollTracking()).feed(rows(flight))
    assert found[-1].deviations < 0.1


@pytest.mark.parametrize("model", [RollTracking, PitchTracking])
def test_tracking_goes_on_from_block_to_block_and_begins_anew_after_a_gap(
    model: type[RollTracking | PitchTracking],
) -> None:
    flight, at = steady(12), np.arange(12 * RATE_HZ) / RATE_HZ
    flight["roll_demand"], flight["roll"] = 0.8 * np.sin(1.3 * at + 1.0), 0.5 * np.sin(at)
    flight["pitch_demand"], flight["pitch"] = 0.2 * np.sin(1.1 * at + 1.0), 0.1 * np.sin(at)
    whole, pieces, begun = rows(flight), model(), model()
    _, expected, good = model().feed(whole)
    found = [pieces.feed(whole.cut(k, k + 1)) for k in range(12)]
    np.testing.assert_array_equal(np.concatenate([answer for _, answer, _ in found]), expected)
    np.testing.assert_array_equal(np.concatenate([mask for _, _, mask in found]), good)
    later = replace(whole.cut(6, 12), fresh=True)
    begun.feed(whole.cut(0, 6))
    _, anew, _ = begun.feed(later)
    np.testing.assert_array_equal(anew, model().feed(later)[1])
    assert not np.allclose(anew[RATE_HZ:], expected[7 * RATE_HZ :], atol=1e-3)


@pytest.mark.parametrize("model", [RollTracking, PitchTracking])
@pytest.mark.parametrize(("spacing_s", "judged"), [(0.41, True), (0.43, False)])
def test_a_demand_that_comes_twice_a_second_is_no_evidence(
    model: type[RollTracking | PitchTracking], spacing_s: float, judged: bool
) -> None:
    """A pilot's step lies anywhere between two samples, and a sound aircraft seems to lead or to lag."""
    flight = steady(12)
    flight["demand_spacing"] = np.full(12 * RATE_HZ, spacing_s)
    assert model().feed(rows(flight))[2].any() == judged


def test_pitch_follows_a_step_and_roll_between_the_demand_and_the_slowest_response() -> None:
    flight = steady(12)
    flight["pitch_demand"][100:] = flight["roll_demand"][100:] = 0.1
    since_s = 2.5 * np.maximum(np.arange(240) - 100, 0) / RATE_HZ
    _, answer, good = PitchTracking().feed(rows(flight))
    expected = -0.1 * (1.0 - np.exp(-since_s) * (1.0 + since_s))
    np.testing.assert_allclose(answer[good], expected[good], atol=1e-12)
    assert good.all()
    for roll, early, finally_ in ((0.3, 0.2, 0.2), (0.05, 0.0, -0.05), (-0.1, -0.1, -0.2)):
        flight["roll"][:] = roll
        _, answer, good = RollTracking().feed(rows(flight))
        assert good.all()
        assert answer[[99, 101, 239]] == pytest.approx([roll, early, finally_], abs=1e-2)


@pytest.mark.parametrize("cut", [40, 1, 7])
def test_a_stall_explains_a_low_nose_no_longer_than_a_recovery_takes(cut: int) -> None:
    """Slow with a low nose it stalls; from then on what lies below a nose that rises at 5°/s counts."""
    flight, at = steady(40), np.arange(40 * RATE_HZ) / RATE_HZ
    flight["pitch"] = np.interp(at, [10, 15, 19, 24, 24, 30], [0.0, -0.6, -0.6, -0.1, 0.0, -0.3])
    flight["speed"] = np.where((at >= 13) & (at < 16), 16.9, 18.0)
    expected, regained = [], np.inf
    for pitch, speed in zip(flight["pitch"], flight["speed"], strict=True):
        stalls = pitch < -np.radians(3) and speed < 0.95 * 18.0
        regained = pitch if stalls else regained + np.radians(5) / RATE_HZ
        expected.append(min(pitch - min(regained, 0.0), 0.0))
    whole, model = rows(flight), PitchTracking()
    parts = [model.feed(whole.cut(k, min(k + cut, 40))) for k in range(0, 40, cut)]
    answer, good = (np.concatenate([part[n] for part in parts]) for n in (1, 2))
    np.testing.assert_allclose(answer[good], np.array(expected)[good], atol=1e-9)
    assert good.all()


def test_the_offset_of_another_accelerometer_is_no_skid() -> None:
    flight = steady(80)
    flight["side_force"][60 * RATE_HZ :] = 2.0
    for source, known in ((0.0, True), (1.0, False)):
        flight["force_source"][60 * RATE_HZ :] = source
        last = Residual(SideForce()).feed(rows(flight))[-1]
        assert (last.deviations > 10.0) if known else np.isnan(last.deviations)
