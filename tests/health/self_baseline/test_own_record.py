"""What a flight leaves of an own-scale equation, against the servo that it came from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavhums.core.quantities import column
from mavhums.health.estimation.equations.own_scale import CURRENT, TRACKING
from mavhums.health.estimation.flight_sums import KEPT, OwnSums
from mavhums.health.estimation.motor_identification import VoltageSums
from mavhums.health.estimation.wear import Nuisances, learned, mean_load, shows, wear
from mavhums.results.verdict import OwnRecord
from tests.health.self_baseline.servo import EQUATION, Servo, blank, collected, left
from tests.present import present

SERVO = Servo()
RECORDS = tuple(left(SERVO, seed) for seed in range(6))


def test_several_flights_teach_the_servos_own_drag_inertia_and_hinge_moment() -> None:
    nuisances = present(learned(RECORDS))
    held = {KEPT[column]: value for column, value in nuisances.held.items()}
    assert held["speed"] == pytest.approx(SERVO.drag, rel=0.05)
    assert held["acceleration"] == pytest.approx(SERVO.inertia, rel=0.1)
    assert held["load"] == pytest.approx(SERVO.hinge, rel=0.02)


def test_the_friction_of_a_flight_is_the_servos() -> None:
    nuisances = learned(RECORDS)
    worn = present(wear(left(Servo(friction_a=0.065), 77), nuisances))
    assert worn.value == pytest.approx(0.065, abs=4 * worn.error)
    assert worn.error < 0.001


def test_the_error_is_as_large_as_the_estimates_scatter() -> None:
    nuisances = learned(RECORDS)
    flights = [wear(left(SERVO, seed, noise_a=0.02, seconds=60.0), nuisances) for seed in range(100, 130)]
    values = [one.value for one in flights if one]
    assert len(values) == 30
    assert np.std(values) == pytest.approx(np.mean([one.error for one in flights if one]), rel=0.4)


def test_the_command_is_never_the_angle() -> None:
    time_s, values, airspeed = SERVO.flown(5)
    without = values.copy()
    without[:, column("V1")] = np.nan
    records = [collected(OwnSums(EQUATION, blank()), (time_s, each, airspeed)) for each in (values, without)]
    assert records[0] == records[1]


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(0, 2000), max_size=6))
def test_a_record_does_not_depend_on_how_the_flight_was_cut(cuts: list[int]) -> None:
    flight = SERVO.flown(9, seconds=40.0)
    whole = collected(OwnSums(EQUATION, blank()), flight)
    assert collected(OwnSums(EQUATION, blank()), flight, tuple(cuts)) == whole


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    cuts=st.lists(st.integers(0, 600), max_size=8),
    gaps=st.lists(st.tuples(st.integers(1, 599), st.sampled_from([0.05, 0.08, 0.3, 1.7])), max_size=6),
    late=st.dictionaries(st.sampled_from(["V1", "V3", "V4", "V5", "V7", "V10"]), st.integers(0, 500)),
    rate_hz=st.sampled_from([21.0, 30.0]),
)
def test_rate_and_sums_do_not_depend_on_the_cuts_of_a_patchy_flight(
    cuts: list[int], gaps: list[tuple[int, float]], late: dict[str, int], rate_hz: float
) -> None:
    """Quantities begin late, samples jitter, and some are far apart: what is known of a block changes."""
    time_s, values, airspeed = SERVO.flown(9, seconds=600 / rate_hz, rate_hz=rate_hz)
    time_s = time_s + sum((gap * (np.arange(600) >= at) for at, gap in gaps), start=np.zeros(600))
    values[:, column("V3")] = 20.0 * np.sin(time_s)
    values[:, column("V10")] = values[:, column("V7")] / 60.0
    for key, begin in late.items():
        values[:begin, column(key)] = np.nan
    flight = time_s, values, airspeed
    for equation in (CURRENT, TRACKING):
        whole, pieces = OwnSums(equation, blank()), OwnSums(equation, blank())
        assert collected(pieces, flight, tuple(cuts)) == collected(whole, flight)
        assert (pieces.rate_hz, pieces.gap) == (whole.rate_hz, whole.gap)
    assert collected(VoltageSums(blank()), flight, tuple(cuts)) == collected(VoltageSums(blank()), flight)


def test_a_long_flight_leaves_no_more_than_sixteen_parts() -> None:
    assert len(left(SERVO, 3, seconds=900.0).groups) <= 16


def test_a_flight_at_a_low_rate_leaves_nothing_and_says_why() -> None:
    sums = OwnSums(EQUATION, blank())
    assert collected(sums, SERVO.flown(1, rate_hz=19.0)) is None
    assert present(sums.gap).code == "own_too_slow"


def test_magnitudes_show_no_friction() -> None:
    time_s, values, airspeed = SERVO.flown(1)
    record = collected(OwnSums(EQUATION, blank()), (time_s, np.abs(values), airspeed))
    assert record is None or not shows(record)


def test_without_airspeed_the_load_is_free_in_each_flight() -> None:
    def still(seed: int) -> tuple[np.ndarray, ...]:
        time_s, values, airspeed = SERVO.flown(seed)
        return time_s, values, np.full_like(airspeed, np.nan)

    records = [collected(OwnSums(EQUATION, blank()), still(seed)) for seed in range(4)]  # type: ignore[arg-type]
    assert {record.setup for record in records if record} == {"angle from speed, no airspeed"}
    nuisances = present(learned([record for record in records if record]))
    assert [KEPT[column] for column in nuisances.free] == ["angle"]


def test_friction_that_grows_with_load_refers_to_one_load() -> None:
    """μ is learned; a flight in heavier air shows the same friction, and the load it was made at."""
    servo = Servo(load_friction=0.3)
    heavier = replace(servo, hinge=2.0 * servo.hinge)
    flights = [left(one, seed) for seed, one in enumerate([servo, heavier] * 5)]
    known = learned(flights)
    assert isinstance(known, Nuisances)
    assert known.load_friction == pytest.approx(0.3, abs=0.03)
    light, heavy = (present(wear(record, known)) for record in flights[-2:])
    assert heavy.value == pytest.approx(light.value, rel=0.1)
    assert light.value == pytest.approx(servo.friction_a + 0.3 * known.load, rel=0.1)
    assert mean_load(flights[-1]) == pytest.approx(2.0 * (mean_load(flights[-2]) or 0.0), rel=0.3)


def with_angle(seed: int, step_rad_s: float, late: int) -> OwnRecord:
    """What a flight leaves whose speed comes in steps and late, beside a measured angle."""
    time_s, values, airspeed = SERVO.flown(seed, rate_hz=100.0)
    speed = values[:, column("V7")] * np.pi / 30.0
    angle = np.cumsum(speed * np.gradient(time_s))
    values[:, column("V3")] = np.degrees(angle - angle.mean()) + 0.01
    register = np.round(speed / step_rad_s) * step_rad_s if step_rad_s else speed
    values[:, column("V7")] = np.roll(register, late) * 30.0 / np.pi
    return present(collected(OwnSums(EQUATION, blank()), (time_s, values, airspeed)))


def test_a_coarse_register_of_the_speed_gives_way_to_the_angle() -> None:
    fine, coarse = with_angle(1, 0.0, 0), with_angle(1, 8.0, 1)
    assert fine.setup == "angle from V3, airspeed"
    assert coarse.setup == "angle from V3, its speed, airspeed"
    free = present(wear(coarse, None))
    assert free.value == pytest.approx(SERVO.friction_a, rel=0.1)
