"""Quantities that follow from others, against motions that are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.actuator.align import Aligned
from mavhums.actuator.derive import Deriver
from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.core.quantities import column

ACTUATOR = load_airframe("paper").actuators[2]
EMA = ACTUATOR.known_ema()
V = {f"V{k}": column(f"V{k}") for k in range(1, 13)}
Array = NDArray[np.float64]


def motor(current: Array, rotor_rad_s: Array) -> Array:
    """Terminal voltage of the motor."""
    return EMA.resistance * current + EMA.torque_constant * rotor_rad_s


def aligned(
    values: dict[str, Array], tier: str, *, signed: bool = True, rate: Array | None = None
) -> Aligned:
    count = len(next(iter(values.values())))
    table = np.full((count, 12), np.nan)
    for key, part in values.items():
        table[:, V[key]] = part
    command_rate = np.full(count, np.nan) if rate is None else rate
    times = np.arange(count, dtype=np.int64) * 10_000
    return Aligned(times, table, np.zeros((count, 12), dtype=np.int8), command_rate, tier, signed)


@pytest.fixture
def flown() -> tuple[Array, Array]:
    """Currents that drive and that oppose, at speeds both ways."""
    time = np.linspace(0, 2, 200)
    return 0.5 * np.sin(9 * time), 150.0 * np.cos(7 * time)


def test_magnitudes_find_their_signs(flown: tuple[Array, Array]) -> None:
    current, speed = flown
    voltage = motor(current, speed)
    rpm = speed * 30 / np.pi
    rate = np.degrees(speed / EMA.gear_ratio) * 1.1
    given = {"V4": np.abs(voltage).round(2), "V5": np.abs(current).round(2), "V7": np.abs(rpm).round(0)}
    deriver = Deriver(ACTUATOR)
    values = deriver.complete(aligned(given, "esc-unsigned", signed=False, rate=rate))
    clear = (np.abs(current) > 0.02) & (np.abs(rpm) > 150)
    assert np.array_equal(np.sign(values[clear, V["V7"]]), np.sign(speed[clear]))
    known = np.isfinite(values[:, V["V5"]])
    assert known[clear & (np.abs(rpm) > 400)].all()
    clear &= known
    assert np.array_equal(np.sign(values[clear, V["V5"]]), np.sign(current[clear]))
    strong = clear & (np.abs(voltage) > 0.3)
    assert np.array_equal(np.sign(values[strong, V["V4"]]), np.sign(voltage[strong]))
    assert "voltage equation" in deriver.derived["V5"]
    slow = np.abs(rpm) < 45
    assert slow.any()
    assert np.isnan(values[slow][:, [V["V4"], V["V5"]]]).all()


@pytest.mark.parametrize(
    ("volts", "amperes", "rpm", "command_deg_s", "speed"),
    [
        (5.66, 0.25, 0.0, 0.0, 0.0),  # at standstill no voltage shows the current's direction
        (5.0, 0.1, 600.0, 12.0, 600.0),
        (5.0, 0.1, 600.0, -60.0, np.nan),  # the command does not explain the speed
        (5.0, 0.1, 0.0, np.nan, 0.0),
        (11.1, 2.0, 600.0, 12.0, 600.0),  # a propulsion motor's ESC: no sign explains the voltage
    ],
)
def test_a_sign_that_nothing_explains_is_missing_and_not_zero(
    volts: float, amperes: float, rpm: float, command_deg_s: float, speed: float
) -> None:
    given = {"V4": np.array([volts]), "V5": np.array([amperes]), "V7": np.array([rpm])}
    sent = aligned(given, "esc-unsigned", signed=False, rate=np.array([command_deg_s]))
    [values] = Deriver(ACTUATOR).complete(sent)
    np.testing.assert_array_equal(values[[V["V7"], V["V4"], V["V5"]]], [speed, np.nan, np.nan])


def bus(actuator: Actuator) -> Actuator:
    return actuator.model_copy(update={"esc_side": "bus", "electronics_a": 0.05})


def test_a_bus_side_esc_shows_the_motors_power_and_no_more() -> None:
    speed = np.array([100.0, -100.0, 80.0, -80.0])
    current = np.array([0.4, -0.4, -0.3, 0.3])
    power = motor(current, speed) * current
    given = {"V4": np.full(4, 27.0), "V5": power / 27.0 + 0.05, "V7": speed * 30 / np.pi}
    deriver = Deriver(bus(ACTUATOR))
    values = deriver.complete(aligned(given, "esc-signed"))
    assert values[:, V["V6"]] == pytest.approx(power)
    assert np.isnan(values[:, [V["V4"], V["V5"], V["V8"]]]).all()
    assert "bus" in deriver.derived["V6"]
    assert deriver.dropped == {"V4", "V5"}


def test_a_bus_side_esc_without_signs_shows_nothing() -> None:
    given = {"V4": np.full(2, 27.0), "V5": np.full(2, 0.1), "V7": np.full(2, 600.0)}
    sent = aligned(given, "esc-unsigned", signed=False, rate=np.full(2, 12.0))
    values = Deriver(bus(ACTUATOR)).complete(sent)
    assert np.isnan(values[:, [V["V4"], V["V5"], V["V6"]]]).all()


def test_products_follow_and_measured_ones_stay() -> None:
    given = {"V5": np.array([0.5]), "V7": np.array([600.0]), "V8": np.array([0.02]), "V11": np.array([1.0])}
    deriver = Deriver(ACTUATOR)
    values = deriver.complete(aligned(given, "instrumented"))[0]
    rotor_rad_s = 600 * 2 * np.pi / 60
    assert values[V["V8"]] == 0.02
    assert values[V["V9"]] == pytest.approx(0.02 * rotor_rad_s)
    assert values[V["V10"]] == 2.0
    assert values[V["V12"]] == pytest.approx(rotor_rad_s / 300)
    assert np.isnan(values[V["V6"]])
    assert set(deriver.derived) == {"V9", "V10", "V12", "V2", "V3"}


def test_the_integral_starts_at_the_command_and_does_not_depend_on_blocks() -> None:
    time = np.arange(300) / 100
    speed = 500.0 * np.cos(3 * time)
    whole = aligned({"V7": speed, "V1": np.full(300, 5.0), "V5": np.zeros(300)}, "esc-signed")
    expected = Deriver(ACTUATOR).complete(whole)
    assert expected[0, V["V2"]] == 5.0 * 300
    exact = 5.0 + 500.0 * 6 / 300 * np.sin(3 * time) / 3
    assert expected[:, V["V3"]] == pytest.approx(exact, abs=0.02)
    assert np.array_equal(in_parts(whole, 1, 120), expected, equal_nan=True)


def test_the_integral_waits_for_the_first_speed_and_bridges_gaps_whatever_the_blocks() -> None:
    speed = np.full(300, 100.0)
    speed[:50] = speed[120:160] = np.nan
    rotor = np.full(300, np.nan)
    rotor[200:250] = 77.0
    whole = aligned({"V7": speed, "V2": rotor, "V1": np.arange(300.0), "V5": np.zeros(300)}, "esc-signed")
    expected = Deriver(ACTUATOR).complete(whole)[:, V["V2"]]
    assert np.isnan(expected[:50]).all()
    assert expected[50] == 50.0 * 300
    assert expected[119] == pytest.approx(50.0 * 300 + 69 * 6.0)
    assert np.ptp(expected[121:160]) == 0
    assert (expected[200:250] == 77.0).all()
    assert expected[299] == pytest.approx(77.0 + 50 * 6.0)
    for cuts in ((10, 49, 130, 150), (50, 120, 160, 210, 240), (1, 51, 121, 161, 299)):
        assert np.array_equal(in_parts(whole, *cuts)[:, V["V2"]], expected, equal_nan=True)


def in_parts(whole: Aligned, *cuts: int) -> Array:
    """What is derived from samples that come in parts."""
    deriver, edges = Deriver(ACTUATOR), itertools.pairwise((0, *cuts, len(whole.utc_us)))
    rows = ("utc_us", "values", "origin", "command_rate")
    parts = (whole._replace(**{name: getattr(whole, name)[a:b] for name in rows}) for a, b in edges)
    return np.concatenate([deriver.complete(part) for part in parts])
