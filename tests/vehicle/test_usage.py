"""Travel, reversals, stops and trim of outputs whose movement is known exactly."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mavhums.vehicle.facts import OUTPUTS, Signal
from mavhums.vehicle.usage import BAND_US, OutputUse, Usage

STEP_US = 100_000


def signal(name: str, values: NDArray[np.float64], first: int) -> Signal:
    """A signal at 10 Hz; of two of them, the messages come in turns."""
    frames = first + 2 * np.arange(len(values), dtype=np.int64)
    return Signal(1, name, name, frames, frames // 2 * STEP_US, values)


def outputs(pulses: NDArray[np.float64]) -> Signal:
    """The first output; the others are off."""
    return signal("outputs", np.pad(pulses[:, None], ((0, 0), (0, OUTPUTS - 1)), constant_values=np.nan), 0)


def state(armed: list[float]) -> Signal:
    """The armed state, reported right after each sample of the outputs."""
    return signal("state", np.array([[1.0, 3.0, one, 10.0] for one in armed]), 1)


def triangle(periods: int, low: int = 1100, high: int = 1900, step: int = 20) -> NDArray[np.float64]:
    up = np.arange(low, high, step)
    down = np.arange(high, low, -step)
    return np.append(np.tile(np.concatenate([up, down]), periods), low).astype(np.float64)


def used(*signals: Signal) -> Usage:
    usage = Usage()
    usage.feed(signals)
    return usage


def test_a_triangle_wave_has_its_travel_and_its_reversals() -> None:
    wave = triangle(5)
    found = used(outputs(wave)).outputs[1]
    assert (found.least_us, found.greatest_us) == (1100, 1900)
    assert found.travelled_us == 5 * 2 * 800
    assert found.reversals == 2 * 5 - 1
    assert found.held_s == pytest.approx((len(wave) - 1) * STEP_US / 1e6)
    assert found.mean_us == pytest.approx(1500, abs=1e-9)
    assert found.at_stops_s(1100, 1900) == pytest.approx((5 * 0.1, 5 * 0.1))
    assert found.commanded


@pytest.mark.parametrize(("amplitude", "reversals"), [(BAND_US - 1, 0), (BAND_US, 19)])
def test_only_what_exceeds_the_band_is_a_reversal(amplitude: int, reversals: int) -> None:
    wave = 1500.0 + amplitude * (np.arange(21) % 2).astype(np.float64)
    found = used(outputs(wave)).outputs[1]
    assert (found.reversals, found.commanded) == (reversals, reversals > 0)
    assert found.travelled_us == 20 * amplitude


def test_time_at_a_stop_counts_while_armed_or_unknown() -> None:
    stuck = np.array([1900.0] * 21)
    assert used(outputs(stuck)).outputs[1].at_stops_s(1100, 1900) == (0.0, 2.0)
    half = used(outputs(stuck), state([0.0] * 10 + [1.0] * 11))
    assert half.outputs[1].at_stops_s(1100, 1900)[1] == pytest.approx(1.0)
    assert half.armed_s == pytest.approx(1.0)
    never = used(outputs(stuck), state([0.0] * 21))
    assert (never.armed_s, never.outputs[1].at_stops_s(1100, 1900)) == (0.0, (0.0, 0.0))


def test_an_output_that_is_off_is_not_there_and_a_gap_is_not_held() -> None:
    assert used(outputs(np.full(9, np.nan))).outputs == {}
    signal = outputs(np.array([1500.0, 1500.0, 1500.0]))
    gap = signal._replace(time_us=np.array([0, 60_000_000, 60_100_000]))
    assert used(gap).outputs[1].held_s == pytest.approx(2.1)
    pause = used(outputs(np.array([1200.0, np.nan, 1800.0, 1810.0]))).outputs[1]
    assert pause.travelled_us == 10
    assert pause.held_s == pytest.approx(0.2)


def test_a_clock_that_rewinds_takes_no_time_back() -> None:
    signal = outputs(np.array([1500.0, 1600.0, 1700.0]))
    back = signal._replace(time_us=np.array([5_000_000, 1_000_000, 1_100_000]))
    assert used(back).outputs[1].held_s == pytest.approx(0.1)


@given(
    st.lists(st.one_of(st.floats(700, 2300), st.just(float("nan"))), min_size=1, max_size=60),
    st.lists(st.sampled_from([0.0, 1.0, float("nan")]), min_size=60, max_size=60),
    st.sets(st.integers(1, 59), max_size=6),
)
def test_it_does_not_depend_on_the_blocks(pulses: list[float], armed: list[float], cuts: set[int]) -> None:
    wave, states = outputs(np.array(pulses)), state(armed[: len(pulses)])
    whole, pieces = used(wave, states), Usage()
    edges = [0, *sorted(cut for cut in cuts if cut < len(pulses)), len(pulses)]
    for a, b in itertools.pairwise(edges):
        pieces.feed([cut_out(wave, a, b), cut_out(states, a, b)])
    assert pieces.armed_s == whole.armed_s
    assert pieces.outputs.keys() == whole.outputs.keys()
    for servo, found in whole.outputs.items():
        assert pieces.outputs[servo][:4] == found[:4]
        assert (pieces.outputs[servo].held_us == found.held_us).all()


def cut_out(signal: Signal, a: int, b: int) -> Signal:
    return signal._replace(frame=signal.frame[a:b], time_us=signal.time_us[a:b], values=signal.values[a:b])


def test_a_pulse_holds_until_the_next_sample() -> None:
    step = used(outputs(np.array([1500.0, 1500.0, 1900.0]))).outputs[1]
    assert step.mean_us == 1500.0
    assert step.at_stops_s(1100, 1900) == (0.0, 0.0)


def test_armed_time_is_exact() -> None:
    """It is disarmed in samples 5 to 9: 0.5 s of the 3 s between the first state and the last."""
    assert Usage().armed_s is None
    assert used(state([1.0] * 5 + [0.0] * 5 + [1.0] * 21)).armed_s == 2.5
    assert used(state([0.0, 0.0])).armed_s == 0.0


@pytest.mark.parametrize(("low", "high", "near"), [(1100, 1900, 8), (1500, 1520, 1), (1450, 1600, 2)])
def test_a_stop_is_within_a_hundredth_of_the_range(low: int, high: int, near: int) -> None:
    """Each microsecond from 800 to 2200 was held for a second: a stop counts a second per µs."""
    use = OutputUse(800, 2200, 0, 0, np.full(1401, 1_000_000))
    assert use.at_stops_s(low, high) == (low + near - 800 + 1, 2200 - (high - near) + 1)
    assert use.at_stops_s(0, 9000) == (0.0, 0.0)
    assert (use.held_s, use.mean_us) == (1401.0, 1500.0)
    assert OutputUse(1500, 1500, 0, 0, np.zeros(1401, dtype=np.int64)).mean_us is None
