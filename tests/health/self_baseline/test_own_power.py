"""Friction by the supply's power: a law that is known, what is stored, and what a bridge may do."""

from __future__ import annotations

import numpy as np
import pytest

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations.own_scale import POWER
from mavhums.health.estimation.flight_sums import POWER_COLUMNS, collector
from mavhums.health.estimation.wear import _learned_power, _power_wear, _shows_power
from mavhums.health.self_baseline.comparison import compare
from mavhums.health.self_baseline.verdict import comparison_reason
from mavhums.results.verdict import OwnRecord
from tests.health.self_baseline.servo import Array, Servo, blank, collected
from tests.present import present

FRICTION_NM, DRAG, INERTIA, HINGE = 8e-4, 2e-6, 9e-7, 2.5e-8
HEAT, STANDING_W, SUPPLY_V = 3e5, 1.35, 27.0
SCALE = 1.0 + 2.0 * HEAT * DRAG
Flight = tuple[Array, Array, Array]


def at_bus() -> Actuator:
    return blank().model_copy(update={"esc_side": "bus"})


def flown(
    seed: int,
    friction_nm: float = FRICTION_NM,
    *,
    noise_w: float = 0.02,
    burns: bool = False,
    slow_nm: float = 1e-4,
    **given: float,
) -> Flight:
    """Return a flight whose power follows the law, from the motion of the motor-side servo."""
    motor = Servo(friction_a=friction_nm, drag=DRAG, inertia=INERTIA, hinge=HINGE)
    time_s, values, airspeed = motor.flown(seed, **{"noise_a": 0.0, "seconds": 60.0} | given)
    speed = values[:, column("V7")] * np.pi / 30
    torque = (
        values[:, column("V5")] - 0.02 + slow_nm * np.sin(0.02 * time_s)
    )  # a slow load beside the hinge's
    power = HEAT * torque**2 + speed * torque
    power = (np.maximum(power, 0.0) if burns else power) + STANDING_W
    power += noise_w * np.random.default_rng([seed, 2]).standard_normal(power.size)
    values[:, column("V4")] = SUPPLY_V
    values[:, column("V5")] = power / SUPPLY_V
    return time_s, values, airspeed


def left(seed: int, friction_nm: float = FRICTION_NM, *, burns: bool = False, **given: float) -> OwnRecord:
    return present(collected(collector(POWER, at_bus()), flown(seed, friction_nm, burns=burns, **given)))


def past(*records: OwnRecord) -> list[PastRecord]:
    return [PastRecord((record,), "2026-03-01", True) for record in records]


def scattered(seed: int, friction_nm: float = FRICTION_NM, *, burns: bool = False) -> OwnRecord:
    own = 1.0 + 0.02 * np.random.default_rng([seed, 1]).standard_normal()
    return left(seed, friction_nm * own, burns=burns)


HEALTHY = past(*(scattered(seed) for seed in range(10)))


def test_the_law_that_made_the_power_is_found_again() -> None:
    frictions = FRICTION_NM * np.linspace(0.8, 1.4, 6)
    records = [left(seed, friction, noise_w=1e-4) for seed, friction in enumerate(frictions)]
    law = present(_learned_power(records))
    of_load, of_inertia, of_heat = law.quadratic[2], law.quadratic[4], law.quadratic[5]
    assert of_load == pytest.approx(HINGE * SCALE, rel=0.02)
    assert of_inertia == pytest.approx(2 * HEAT * INERTIA * HINGE, rel=0.05)
    assert of_heat == pytest.approx(HEAT * HINGE**2, rel=0.02)
    for record, friction in zip(records, frictions, strict=True):
        found = present(_power_wear(record, law))
        assert found.value == pytest.approx(friction * SCALE, rel=0.02)


def test_a_flight_alone_finds_its_friction() -> None:
    found = present(_power_wear(left(3, noise_w=1e-4), None))
    assert found.value == pytest.approx(FRICTION_NM * SCALE, rel=0.1)


def test_the_error_is_what_repeated_flights_scatter_by() -> None:
    law = _learned_power([record for flight in HEALTHY for record in flight.records])
    several = [_power_wear(left(seed, noise_w=0.1), law) for seed in range(30, 50)]
    values = np.array([one.value for one in several if one])
    error = float(np.mean([one.error for one in several if one]))
    assert len(values) == 20
    assert 0.4 < values.std(ddof=1) / error < 2.0


@pytest.mark.parametrize("burns", [False, True])
def test_more_friction_is_a_change_whatever_the_bridge_does(burns: bool) -> None:
    healthy = past(*(scattered(seed, burns=True) for seed in range(10))) if burns else HEALTHY
    assert compare(POWER, scattered(60, burns=burns), healthy[:9]).condition == "learning"
    same = compare(POWER, scattered(61, burns=burns), healthy)
    assert same.condition == "unchanged"
    assert same.least_rise is not None
    assert same.least_rise < 0.4
    risen = left(62, FRICTION_NM * (1.0 + 1.3 * same.least_rise), burns=burns)
    found = compare(POWER, risen, healthy)
    assert found.condition == "changed"
    assert comparison_reason(POWER, found).text.startswith("friction in the supply's power +")
    assert present(found.change).estimate == pytest.approx(1.3 * same.least_rise, abs=0.12 if burns else 0.06)


def test_a_long_flight_leaves_as_little_and_shows_the_same_friction() -> None:
    long = left(71, seconds=900.0, rate_hz=25.0, noise_w=0.1)
    assert len(long.groups) <= 17  # sixteen, and the open window
    assert {len(group) for group in long.groups} == {1 + POWER_COLUMNS * (POWER_COLUMNS + 1) // 2}
    assert len(long.model_dump_json()) < 25_000
    law = _learned_power([record for flight in HEALTHY for record in flight.records])
    found = present(_power_wear(long, law))
    assert found.value == pytest.approx(FRICTION_NM * SCALE, rel=0.05)
    unsteady = present(_power_wear(left(71, seconds=900.0, rate_hz=25.0, noise_w=0.1, slow_nm=3e-3), law))
    assert unsteady.value == pytest.approx(FRICTION_NM * SCALE, rel=0.05)
    assert unsteady.error < 4.0 * found.error


def test_the_motor_side_is_not_taken_for_the_supply() -> None:
    assert collected(collector(POWER, blank()), flown(72)) is None


def test_without_airspeed_it_says_so() -> None:
    time_s, values, airspeed = flown(73)
    sums = collector(POWER, at_bus())
    assert collected(sums, (time_s, values, np.full_like(airspeed, np.nan))) is None
    assert present(sums.gap).code == "own_no_airspeed"


def test_power_without_load_determines_nothing() -> None:
    time_s, values, airspeed = flown(74)
    values[:, column("V5")] = 0.05 + 0.001 * np.random.default_rng(74).standard_normal(time_s.size)
    record = present(collected(collector(POWER, at_bus()), (time_s, values, airspeed)))
    assert _shows_power(record)
    assert _power_wear(record, None) is None


def test_a_flight_that_hardly_moves_shows_nothing() -> None:
    time_s, values, airspeed = flown(75)
    values[150:, column("V7")] = 0.0
    record = collected(collector(POWER, at_bus()), (time_s, values, airspeed))
    assert record is None or not _shows_power(record)
    brief = left(75)
    assert _shows_power(brief)
    few = tuple((10.0, *numbers) for _, *numbers in brief.groups)
    assert not _shows_power(brief.model_copy(update={"groups": few}))
