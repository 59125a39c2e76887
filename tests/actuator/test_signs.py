"""Signs of magnitudes, against motions of which every sign is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.actuator.align import Aligned
from mavhums.actuator.derive import Deriver, _winding
from mavhums.actuator.profile import load_airframe
from mavhums.core.quantities import column
from tests.actuator.test_derive import in_parts

ACTUATOR = load_airframe("paper").actuators[2]
EMA = ACTUATOR.known_ema()
V4, V5, V7 = column("V4"), column("V5"), column("V7")
AMPERES_OF_1_NM = 1.0 / (EMA.torque_constant * EMA.gear_ratio)
Array = NDArray[np.float64]


def flight(
    rng: np.random.Generator,
    *,
    speed_deg_s: tuple[float, float],
    noise_a: float = 0.01,
    resistance: float = 1.0,
    rate_hz: float = 25.0,
    seconds: float = 300.0,
    driving: float = 0.95,
) -> tuple[Aligned, Array]:
    """Return what an ESC sends of moves of 0.6 s, each after 1.4 s of rest, and the signed current.

    The friction is 1 N·m: most moves need a driving current; in some the load drives and the motor brakes.
    """
    time = np.arange(0.0, seconds, 1.0 / rate_hz)
    move = (time // 2).astype(int)
    moving = time % 2 < 0.6
    way = np.where(move % 2 == 0, 1.0, -1.0)
    speed = moving * way * rng.uniform(*speed_deg_s, move.max() + 1)[move]
    along = np.where(rng.uniform(size=move.max() + 1) < driving, 1.0, -1.0)[move]
    current = AMPERES_OF_1_NM * way * along * rng.uniform(0.8, 1.2, time.size)
    rpm = speed * EMA.gear_ratio / 6.0
    volts = resistance * EMA.resistance * current + EMA.torque_constant * rpm * np.pi / 30
    values = np.full((time.size, 12), np.nan)
    values[:, V4] = np.abs(volts + rng.normal(0, 0.05, time.size)).round(2)
    values[:, V5] = np.abs(current + rng.normal(0, noise_a, time.size)).round(2)
    values[:, V7] = np.abs(rpm + rng.normal(0, 5.0, time.size)).round(0)
    times = np.rint(time * 1e6).astype(np.int64)
    origin = np.zeros(values.shape, dtype=np.int8)
    return Aligned(times, values, origin, speed, "esc-unsigned", signed=False), current


def winding(deriver: Deriver) -> tuple[float, float]:
    """Return the resistance, Ω, and the deviation of |U| − R·|I|, V, that standstill shows so far."""
    resistance, variance = _winding(deriver._at_rest, EMA.resistance)
    return resistance, variance**0.5


@pytest.mark.parametrize("speeds", [(3.0, 4.5), (3.0, 7.0), (10.0, 20.0)])
@pytest.mark.parametrize("resistance", [0.9, 1.0, 1.12])
def test_doubtful_signs_do_not_make_the_current_smaller(
    speeds: tuple[float, float], resistance: float
) -> None:
    """Guessed near standstill, a tenth to a third of the signs would be wrong: T_c too small by twice that.

    A warm or cold winding would make them wrong one way.
    """
    sent, current = flight(np.random.default_rng(4), speed_deg_s=speeds, resistance=resistance)
    values = Deriver(ACTUATOR).complete(sent)
    known = np.isfinite(values[:, V5]) & (sent.command_rate != 0)
    assert known[sent.utc_us > 20_000_000].mean() > 0.02
    later = known & (sent.utc_us > 20_000_000)
    along = np.sign(sent.command_rate)
    shown = (values[:, V5] * along)[later].mean() / (current * along)[later].mean()
    assert shown == pytest.approx(1.0, abs=0.03)


def test_which_signs_are_known_does_not_depend_on_the_current() -> None:
    """A selection by the current, or by what noise makes of it, would bias the friction."""
    sent, current = flight(np.random.default_rng(5), speed_deg_s=(2.0, 8.0))
    values = Deriver(ACTUATOR).complete(sent)
    moving = sent.command_rate != 0
    known = np.isfinite(values[:, V5])
    assert 0.2 < known[moving].mean() < 0.8
    size = np.abs(current)
    assert size[moving & known].mean() == pytest.approx(size[moving & ~known].mean(), rel=0.01)
    noise = np.abs(values[:, V5]) - size
    assert np.nanmean(noise[moving]) == pytest.approx(0.0, abs=0.001)


@given(
    noise_a=st.floats(0.002, 0.03),
    resistance=st.floats(0.85, 1.2),
    rate_hz=st.sampled_from([10.0, 25.0, 100.0]),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=25, deadline=None)
def test_resistance_and_noise_are_those_at_standstill(
    noise_a: float, resistance: float, rate_hz: float, seed: int
) -> None:
    rng, how = np.random.default_rng(seed), {"noise_a": noise_a, "resistance": resistance, "rate_hz": rate_hz}
    sent, _ = flight(rng, speed_deg_s=(2.0, 8.0), **how)
    deriver = Deriver(ACTUATOR)
    assert winding(deriver) == pytest.approx((EMA.resistance, EMA.resistance * 0.01))
    deriver.complete(sent)
    exact = np.hypot(0.05, EMA.resistance * np.hypot(noise_a * resistance, 0.01 / np.sqrt(12)))
    found, noise = winding(deriver)
    assert found == pytest.approx(resistance * EMA.resistance, rel=0.02)
    assert noise == pytest.approx(exact, rel=0.2)


@given(cuts=st.lists(st.integers(0, 2500), max_size=8), seed=st.integers(0, 5))
@settings(max_examples=30, deadline=None)
def test_signs_do_not_depend_on_blocks(cuts: list[int], seed: int) -> None:
    sent, _ = flight(np.random.default_rng(seed), speed_deg_s=(2.0, 12.0), seconds=100.0)
    expected = Deriver(ACTUATOR).complete(sent)
    assert np.array_equal(in_parts(sent, *sorted(cuts)), expected, equal_nan=True)


def test_an_actuator_that_never_moves_teaches_no_resistance_from_noise() -> None:
    """The noise of a current near zero has no voltage."""
    rng = np.random.default_rng(7)
    values = np.full((5000, 12), np.nan)
    values[:, V4] = np.abs(rng.normal(0, 0.05, 5000)).round(2)
    values[:, V5] = np.abs(rng.normal(0, 0.01, 5000)).round(2)
    values[:, V7] = 0.0
    times, origin = np.arange(5000, dtype=np.int64) * 10_000, np.zeros(values.shape, dtype=np.int8)
    deriver = Deriver(ACTUATOR)
    found = deriver.complete(Aligned(times, values, origin, np.zeros(5000), "esc-unsigned", signed=False))
    assert winding(deriver)[0] == EMA.resistance
    assert np.isnan(found[:, [V4, V5]]).all()
