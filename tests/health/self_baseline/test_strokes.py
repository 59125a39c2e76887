"""Strokes at constant speed: roughness, ripple and friction both ways, against truths of their own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.core.arrays import Array
from mavhums.core.quantities import column
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.equations.own_scale import RIPPLE, ROUGHNESS, TWO_WAYS
from mavhums.health.estimation.strokes import StrokeSums
from mavhums.health.self_baseline.comparison import compare
from mavhums.results.verdict import OwnRecord
from tests.health.builders import one_slot, samples
from tests.health.self_baseline.servo import blank, collected, past
from tests.present import present

RATE_HZ = 25.0


def swept(
    seed: int,
    *,
    rough: float = 0.25,
    friction: float = 0.3,
    load: float = 0.2,
    offset: float = 0.4,
    sweeps: int = 5,
) -> tuple[Array, Array]:
    """Times and V1…V12 of strokes of 120° in 5 s with 3 s of rest, and a current without sign."""
    rng = np.random.default_rng(seed)
    corners, angles = [0.0], [0.0]
    for _ in range(sweeps):
        for seconds, angle in ((5.0, 120.0), (3.0, 120.0), (5.0, 0.0), (3.0, 0.0)):
            corners.append(corners[-1] + seconds)
            angles.append(angle)
    time_s: Array = np.arange(0.0, corners[-1], 1.0 / RATE_HZ)
    command = np.interp(time_s, corners, angles)
    way = np.sign(np.round(np.gradient(command, time_s), 6))
    angle = command - 2.0 * way + rough * rng.standard_normal(time_s.size)
    current = offset + np.abs(way) * friction + way * load + 0.01 * rng.standard_normal(time_s.size)
    return time_s, samples(time_s.size, V1=command, V3=angle, V5=current)


def left(flight: tuple[Array, Array], equation: OwnEquation, cuts: tuple[int, ...] = ()) -> OwnRecord | None:
    return collected(StrokeSums(equation, blank()), (*flight, None), cuts)


def mean(record: OwnRecord | None) -> float:
    return float(np.mean([row[1] for row in present(record).groups]))


def test_the_strokes_show_what_they_are_made_of() -> None:
    flight = swept(1)
    assert mean(left(flight, ROUGHNESS)) == pytest.approx(0.25, rel=0.1)
    assert mean(left(flight, RIPPLE)) == pytest.approx(0.01, rel=0.15)
    # Neither the offset of the sensor nor the load is in it.
    assert mean(left(flight, TWO_WAYS)) == pytest.approx(0.3, abs=0.01)
    assert mean(left(swept(1, offset=2.0), TWO_WAYS)) == pytest.approx(0.3, abs=0.01)


def test_a_current_beside_a_speed_is_left_to_its_equation() -> None:
    time_s, values = swept(1)
    values[:, column("V7")] = 1.0
    assert left((time_s, values), TWO_WAYS) is None


def test_a_flight_without_strokes_has_no_record() -> None:
    time_s, values = swept(1)
    values[:, column("V1")] = 60.0 + 60.0 * np.sin(time_s)
    assert left((time_s, values), ROUGHNESS) is None


def test_without_rest_there_is_no_friction_both_ways() -> None:
    time_s, values = swept(1)
    values[values[:, column("V1")] % 120.0 == 0.0, column("V5")] = np.nan
    assert left((time_s, values), TWO_WAYS) is None


@pytest.mark.slow
@given(st.lists(st.integers(1, 1999), max_size=5, unique=True))
@settings(max_examples=20, deadline=None)
def test_the_record_does_not_depend_on_the_blocks(cuts: list[int]) -> None:
    flight = swept(2)
    for equation in (ROUGHNESS, RIPPLE, TWO_WAYS):
        assert left(flight, equation, tuple(cuts)) == left(flight, equation)


def test_memory_does_not_grow_with_the_flight() -> None:
    record = present(left(swept(3, sweeps=25), ROUGHNESS))
    assert len(record.groups) == 32  # and as many rests


@pytest.mark.parametrize("equation", [ROUGHNESS, TWO_WAYS])
def test_a_rise_is_changed_and_a_healthy_flight_is_not(equation: OwnEquation) -> None:
    before = past(*(present(left(swept(100 + seed), equation)) for seed in range(20)))
    # Fewer strokes scatter more than those of the baseline.
    flights = swept(200), swept(200, rough=0.4, friction=0.45), swept(201, sweeps=4)
    found = [compare(equation, present(left(flight, equation)), before).condition for flight in flights]
    assert found == ["unchanged", "changed", "learning"]


def test_the_stroke_with_which_a_log_ends_counts() -> None:
    time_s, values = swept(4, sweeps=2)
    ends = time_s < 29.5  # in the last rest but 0.5 s: strokes out and back, twice
    whole = present(left((time_s[ends], values[ends]), ROUGHNESS))
    assert len(whole.groups) == 4
    within = time_s < 28.5
    part = present(left((time_s[within], values[within]), ROUGHNESS))
    assert len(part.groups) == 4


def ramp(deg_s: float, count: int, bend: float = 0.0) -> OwnRecord | None:
    """Return what a log of one stroke leaves, half of it faster by a share ``bend``.

    Times are binary fractions, so that speeds are exact.
    """
    time_s: Array = np.arange(count) / 32.0
    later = np.maximum(time_s - time_s[count // 2], 0.0)
    angle = deg_s * (time_s + bend * later)
    sums = StrokeSums(ROUGHNESS, blank())
    sums.feed(one_slot(time_s, samples(count, V1=angle, V3=angle)))
    return sums.record()


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_stroke_is_faster_than_the_least_speed(way: float) -> None:
    assert ramp(way * 2.5, 160) is None
    assert ramp(way * 2.503, 160) is not None


def test_a_stroke_is_neither_too_short_nor_too_long() -> None:
    least, most = 45 + 20 + 10, 30 * 32 + 1  # 1.4 s and 0.3 s are left out
    found = [ramp(10.0, count) for count in (least - 1, least, most, most + 1)]
    assert [one is not None for one in found] == [False, True, True, False]
    assert (present(found[2]).rate_hz, present(found[2]).duration_s) == (32.0, 30.0)


@pytest.mark.parametrize(("bend", "steady"), [(0.09, True), (0.11, False)])
def test_the_speed_of_a_stroke_is_steady_within_a_tenth(bend: float, steady: bool) -> None:
    assert (ramp(10.0, 160, bend) is not None) == steady


def test_a_load_the_other_way_is_another_baseline() -> None:
    """Other flanks of the gear press: the friction differs there, and only flights there say by how much."""

    def at(seed: int, way: float) -> OwnRecord:
        return present(left(swept(seed, load=way * 0.2, friction=0.3 + 0.1 * (way < 0.0)), TWO_WAYS))

    one_way, both = (
        past(*(at(300 + k, way) for k, way in enumerate(ways))) for ways in ([1.0] * 14, [1.0, -1.0] * 7)
    )
    assert compare(TWO_WAYS, at(400, 1.0), one_way).condition == "unchanged"
    found = compare(TWO_WAYS, at(400, -1.0), one_way)
    assert (found.condition, found.flights, "loaded the other way" in found.why) == ("learning", 1, True)
    other = compare(TWO_WAYS, at(400, -1.0), both)
    assert other.condition == "unchanged"
    assert present(other.least_rise) < 0.3
