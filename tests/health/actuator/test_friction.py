"""The torque balance against motions whose friction is known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.actuator.detector import DetectorInput
from mavhums.health.actuator.detectors.friction import FrictionDetector
from mavhums.health.actuator.monitor import ActuatorFindings
from mavhums.health.decision.limits import Estimates
from mavhums.health.estimation.equations import Fits
from mavhums.health.estimation.motion import motion
from mavhums.health.estimation.slots import SlotCutter, Slots, with_extra_columns
from tests.health.builders import samples
from tests.health.flown import Telemetry, actuator_of, watch_blocks
from tests.present import present

Array = NDArray[np.float64]
PAPER = actuator_of()
EMA = PAPER.known_ema()
KNOWN = PAPER.model_copy(update={"ema": EMA.model_copy(update={"torque_uncertainty": 0.0})})
SECONDS = 12


def tones(t: Array, size: float) -> tuple[Array, Array, Array]:
    """Return angle, speed and acceleration of a motion of two tones, rad."""
    two = [(size * share, w) for share, w in ((3.0, 2.1), (1.0, 5.3))]
    angle = sum((a * np.sin(w * t) for a, w in two), np.zeros_like(t))
    speed = sum((a * w * np.cos(w * t) for a, w in two), np.zeros_like(t))
    return angle, speed, sum((-a * w**2 * np.sin(w * t) for a, w in two), np.zeros_like(t))


def balanced(angle: Array, speed: Array, inner: Array, load: Array, *, v11: bool) -> tuple[Array, Array]:
    """Return V3, V4, V7 and V11 of a motion, and its current: the balance of torques holds exactly.

    ``inner`` is what friction and inertia take.
    """
    current = (inner + EMA.viscous * speed + load) / EMA.gear_ratio / EMA.torque_constant
    voltage = EMA.resistance * current + EMA.gear_ratio * EMA.torque_constant * speed
    known = {"V3": np.degrees(angle), "V4": voltage, "V7": speed / PAPER.rad_s(1.0)}
    return samples(angle.size, **known, V11=load if v11 else np.nan), current


def synthetic(
    friction: float, *, noise: float = 0.0, seed: int = 0, rate_hz: float = 100.0, v11: bool = True
) -> tuple[Array, Array]:
    """Times and V1…V12 for which the torque balance holds exactly, plus white noise in the torque."""
    t: Array = (np.arange(round(rate_hz * SECONDS), dtype=np.float64) + 0.5) / rate_hz
    angle, speed, acceleration = tones(t, 0.1)
    inner = friction * np.sign(speed) + PAPER.inertia_output * acceleration
    inner += noise * np.random.default_rng(seed).standard_normal(t.size)
    values, current = balanced(angle, speed, inner, 4.0 * angle + 0.2, v11=v11)
    values[:, column("V8")] = current * EMA.torque_constant
    return t, values


def slots_of(time_s: Array, values: Array) -> Slots:
    return present(SlotCutter().feed(time_s, with_extra_columns(values)))


def estimate(time_s: Array, values: Array, actuator: Actuator = KNOWN) -> Estimates:
    """The friction in the last window of ten whole seconds."""
    slots = slots_of(time_s, values)
    moved = motion(actuator, slots)
    windows, flight = Fits(actuator, FrictionDetector.equations).feed(slots, moved)
    estimates = FrictionDetector(actuator).feed(DetectorInput(slots, moved, windows, flight))
    last = np.zeros(slots.index.size, dtype=bool)
    last[-1] = True
    return estimates.at(last)


def friction_of(time_s: Array, values: Array, actuator: Actuator = KNOWN) -> float:
    return float(estimate(time_s, values, actuator).value[0])


@given(st.floats(0.05, 2.0), st.booleans())
@settings(max_examples=30, deadline=None)
def test_exact_data_give_the_exact_friction(friction: float, v11: bool) -> None:
    assert friction_of(*synthetic(friction, v11=v11)) == pytest.approx(friction, rel=2e-3)


def test_a_friction_that_no_gear_has_is_none() -> None:
    """Of 0.375 N·m, the normal limit: 1.9 % and 2.1 %."""
    assert np.isnan(friction_of(*synthetic(0.0071)))
    assert friction_of(*synthetic(0.0079)) == pytest.approx(0.0079, abs=2e-5)


def test_the_current_serves_where_the_rotor_torque_is_not_measured() -> None:
    time_s, values = synthetic(0.4)
    values[:, column("V5")] = values[:, column("V8")] / EMA.torque_constant
    values[:, column("V8")] = np.nan
    assert friction_of(time_s, values) == pytest.approx(0.4, rel=2e-3)


def test_the_command_serves_where_the_angle_is_not_measured() -> None:
    time_s, values = synthetic(0.4, v11=False)
    values[:, column("V1")] = values[:, column("V3")]
    values[:, column("V3")] = np.nan
    assert friction_of(time_s, values) == pytest.approx(0.4, rel=2e-3)


@pytest.mark.parametrize("v11", [True, False])
def test_the_interval_covers_the_truth_as_often_as_it_says(v11: bool) -> None:
    found = [estimate(*synthetic(0.4, noise=0.3, seed=s, rate_hz=25.0, v11=v11)) for s in range(300)]
    shown = [f for f in found if np.isfinite(f.value[0])]
    inside = [abs(f.value[0] - 0.4) <= stats.t.ppf(0.975, f.freedom[0]) * f.error[0] for f in shown]
    assert len(shown) > 200
    assert 0.92 <= np.mean(inside) <= 0.995


def test_a_torque_constant_of_its_own_is_seen_in_the_back_emf() -> None:
    """The motor's k_t is 5 % below the data sheet's: V8 = k_t·V5 says too much, and V4 shows it."""
    time_s, values = synthetic(0.4)
    torque = values[:, column("V8")] * EMA.gear_ratio
    speed = values[:, column("V7")] * PAPER.rad_s(1.0)
    own = 0.95 * EMA.torque_constant
    current = torque / EMA.gear_ratio / own
    values[:, column("V5")] = current
    values[:, column("V8")] = EMA.torque_constant * current
    values[:, column("V4")] = EMA.resistance * current + EMA.gear_ratio * own * speed
    assert friction_of(time_s, values, PAPER) == pytest.approx(0.4, abs=0.006)
    values[:, column("V4")] = np.nan
    blind = estimate(time_s, values, PAPER)
    assert blind.value[0] == pytest.approx(0.4 / 0.95, abs=0.006)
    assert blind.error[0] >= 0.4 / 0.95 * EMA.torque_uncertainty / 2 * 0.99


def test_what_cannot_show_friction_is_not_estimated() -> None:
    time_s, moving = synthetic(0.4)
    assert np.isfinite(friction_of(time_s, moving))
    one_way, standing, half, blind = (moving.copy() for _ in range(4))
    one_way[:, column("V7")] = np.abs(one_way[:, column("V7")]) + 100.0
    standing[:, column("V7")] = 0.0
    # Without voltage, too: it would show the current.
    half[time_s > 3.0, column("V8")] = half[time_s > 3.0, column("V4")] = np.nan
    blind[:, [column("V8"), column("V4")]] = np.nan
    for values in (one_way, standing, half, blind):
        assert np.isnan(friction_of(time_s, values))


def corrections(friction: float, *, v11: bool = True) -> tuple[Array, Array]:
    """An autopilot's small corrections at 10 Hz: steps to and fro, each over within a tenth of a second."""
    rng = np.random.default_rng(5)
    t: Array = (np.arange(1000) + rng.uniform(0.3, 0.7, 1000)) / 10.0
    step, phase = np.floor(t / 0.3), np.mod(t, 0.3)
    way = np.where(np.isin(np.mod(step, 6), [0, 3, 4]), 1.0, -1.0)
    speed = way * np.where(phase < 0.1, 0.2 * (1.0 - phase / 0.1), 0.0)
    angle = np.cumsum(np.append(0.0, np.diff(t)) * speed)
    values, current = balanced(angle, speed, friction * np.sign(speed), 4.0 * angle + 0.2, v11=v11)
    values[:, column("V4")], values[:, column("V8")] = np.nan, current * EMA.torque_constant
    return t, values


def concluded(time_s: Array, values: Array) -> tuple[Estimates, Estimates | None]:
    """The friction over a whole flight: from lasting motion, and the one that it is judged by."""
    slots = slots_of(time_s, values)
    fits = Fits(KNOWN, FrictionDetector.equations)
    fits.feed(slots, motion(KNOWN, slots))
    detector = FrictionDetector(KNOWN)
    return detector.overall(fits.whole()), detector.conclusion(fits.whole())


@pytest.mark.parametrize("v11", [True, False])
@pytest.mark.parametrize("friction", [0.225, 0.975])
def test_motion_that_is_over_at_once_shows_the_friction_of_a_flight(friction: float, v11: bool) -> None:
    lasting, brief = concluded(*corrections(friction, v11=v11))
    assert np.isnan(lasting.value[0])
    assert present(brief).value[0] == pytest.approx(friction, abs=0.01)


def test_a_balance_that_does_not_hold_shows_no_friction() -> None:
    """A rotor that winds up the gear of a jammed shaft."""
    time_s, values = corrections(0.225)
    wound_up = 400.0 * np.radians(values[:, column("V3")] - values[:, column("V3")].mean())
    values[:, column("V8")] += wound_up / EMA.gear_ratio
    brief = present(concluded(time_s, values)[1])
    assert np.isnan(brief.value[0])


def test_a_flight_is_judged_by_the_motion_that_shows_more_of_it() -> None:
    lasting, judged_by = concluded(*synthetic(0.4))
    assert present(judged_by).value[0] == lasting.value[0]


def loaded(friction: float, load_friction: float, *, v11: bool = False) -> tuple[Array, Array]:
    """A minute of a gear whose friction grows with its load, T_c + μ·|load|."""
    t: Array = (np.arange(6000, dtype=np.float64) + 0.5) / 100.0
    angle, speed, acceleration = tones(t, 0.3)
    load = 2.0 * np.sin(angle)
    rubbed = (friction + load_friction * np.abs(load)) * np.sign(speed)
    values, current = balanced(angle, speed, rubbed + PAPER.inertia_output * acceleration, load, v11=v11)
    values[:, column("V5")] = current
    return t, values


def with_load_friction(value: float | None, uncertainty: float = 0.1) -> Actuator:
    share = {"load_friction": value, "load_friction_uncertainty": uncertainty}
    return KNOWN.model_copy(update={"ema": KNOWN.known_ema().model_copy(update=share)})


def judged(time_s: Array, values: Array, actuator: Actuator, size: int = 6000) -> ActuatorFindings:
    seen = Telemetry(time_s, values)
    parts = [seen.between(a, a + size) for a in range(0, time_s.size, size)]
    return watch_blocks(parts, actuator, measured=np.isfinite(values[0]))[1]


@pytest.mark.parametrize("v11", [True, False])
def test_the_load_takes_its_share_of_the_friction(v11: bool) -> None:
    time_s, values = loaded(0.225, 0.3, v11=v11)
    shown = judged(time_s, values, with_load_friction(0.3)).indicators
    (load,) = [one.load for one in shown if one.fault == "friction"]
    assert present(load) > 0.0
    friction = next(one.value.estimate for one in shown if one.fault == "friction")
    assert friction == pytest.approx(0.225, abs=0.03)
    assert judged(time_s, values, with_load_friction(0.3)).worst == "normal"
    # The term is what does it: a profile that denies it reads the load as wear.
    assert judged(time_s, values, with_load_friction(0.0)).worst != "normal"


@pytest.mark.parametrize("load_friction", [0.0, 0.25, 0.5])
def test_an_unknown_share_of_the_load_makes_no_emergency(load_friction: float) -> None:
    time_s, values = loaded(0.225, load_friction)
    assert judged(time_s, values, with_load_friction(None)).worst != "emergency"


def test_a_friction_that_may_be_that_of_the_load_is_no_verdict() -> None:
    """The same flight is one where the profile has the share of the load."""
    time_s, values = loaded(0.9, 0.3)
    found = judged(time_s, values, with_load_friction(None))
    assert found.condition == "undecided"
    assert present(found.no_friction).code == "load_friction"
    assert judged(time_s, values, with_load_friction(0.3)).condition == "emergency"


def test_a_friction_beyond_any_share_of_the_load_remains() -> None:
    time_s, values = loaded(2.5, 0.3)
    assert judged(time_s, values, with_load_friction(None)).worst == "emergency"
