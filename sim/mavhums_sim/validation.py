"""Validation: checks of the actuator against its data sheet, and of the numerical solution.

Each check compares a simulation with an independent reference: the data sheet, an analytic solution,
a conservation law, a finer step or the other friction method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import pi, radians, sqrt

import numpy as np

from mavhums_sim._arrays import Array
from mavhums_sim.ema import DataSheet, EmaParameters, Gearbox
from mavhums_sim.energy import energy_balance
from mavhums_sim.motion import Degradation, Motion, simulate

_COULOMB = 0.225
_ONE = EmaParameters.from_data_sheet()
_TWO = _ONE.two_masses()
_MODELS = {"one mass": _ONE, "two masses": _TWO}


@dataclass(frozen=True, slots=True)
class Check:
    """One comparison.

    Attributes
    ----------
    name, unit
        Quantity and unit of the comparison.
    expected, measured
        Reference value and simulated value.
    tolerance
        Largest allowed difference, in ``unit``.
    """

    name: str
    expected: float
    measured: float
    unit: str
    tolerance: float

    @property
    def passed(self) -> bool:
        """Whether the difference is within the tolerance."""
        return bool(abs(self.measured - self.expected) <= self.tolerance)


def validate() -> Iterator[Check]:
    """Yield each check when it is complete."""
    for checks in CHECKS:
        yield from checks()


def _relative(name: str, expected: float, measured: float, unit: str, tolerance: float) -> Check:
    return Check(name, float(expected), float(measured), unit, abs(expected) * tolerance)


def _drive(
    parameters: EmaParameters,
    command: float | Array,
    seconds: float,
    *,
    load: tuple[float, float] = (0.0, 0.0),
    friction: float = _COULOMB,
    degradation: Degradation | None = None,
    period_s: float = 1e-3,
    step_s: float = 1e-4,
) -> Motion:
    n = round(seconds / period_s)
    return simulate(
        parameters,
        np.broadcast_to(np.asarray(command, dtype=np.float64), (n,)),
        np.full(n, friction),
        np.zeros(n),
        np.linspace(*load, n),
        degradation,
        control_period_s=period_s,
        step_s=step_s,
    )


def table_1() -> Iterator[Check]:
    """Compare no-load speed, nominal current, stall torque, stroke and supply with the paper's Table 1."""
    sheet = DataSheet()
    for model, parameters in _MODELS.items():
        speed = np.degrees(_drive(parameters, radians(60), 0.5).speed[400])
        yield _relative(f"Table 1, no-load speed ({model})", sheet.no_load_speed_deg_s, speed, "°/s", 1e-3)
        load = (sheet.nominal_torque_nm, sheet.nominal_torque_nm)
        current = _drive(parameters, radians(60), 0.6, load=load).current[-1]
        yield _relative(f"Table 1, nominal current ({model})", sheet.nominal_current_a, current, "A", 1e-3)
        pulled = _drive(parameters, radians(60), 5.0, load=(4.95, 5.05))
        stall = pulled.load[1000 + np.flatnonzero(pulled.speed[1000:] <= 0)[0]]
        yield _relative(f"Table 1, stall torque ({model})", sheet.stall_torque_nm, stall, "N·m", 1e-3)
        voltage = np.abs(pulled.voltage).max()
        yield _relative(f"Table 1, supply voltage ({model})", sheet.supply_voltage_v, voltage, "V", 1e-3)
        stroke = np.degrees(_drive(replace(parameters, integral_gain=4000.0), 3.0, 4.0).angle[-1])
        yield _relative(f"Table 1, output stroke ({model})", sheet.stroke_deg, stroke, "°", 1e-3)


def stalled_current() -> Iterator[Check]:
    """I = U/R·(1 − exp(−t·R/L)) while the shaft is held."""
    coil = replace(_ONE, inductance=0.2)
    motion = _drive(coil, radians(60), 0.05, friction=1e6)
    exact = 27.0 / coil.resistance * (1.0 - np.exp(-motion.time_s * coil.resistance / coil.inductance))
    worst = np.abs(motion.current - exact).max()
    yield Check("current of the stalled motor, largest error", 0.0, worst, "A", 1e-9)


def no_load_speed() -> Iterator[Check]:
    """ω = (U − R·T_c/(N·k_t))/(N·k_t) when only the supply limits the speed."""
    motion = _drive(replace(_ONE, slew_limit=1e3, stroke=1e3), 1e3, 1.0)
    exact = (27.0 - _ONE.resistance * _COULOMB / _ONE.torque_per_ampere) / _ONE.torque_per_ampere
    yield _relative("speed at full voltage without load", exact, motion.speed[-1], "rad/s", 1e-6)


def coast_down() -> Iterator[Check]:
    """dω/dt = −T_c/J once the motor gives no torque."""
    n = 600
    wear = replace(Degradation.none(n), torque_factor=np.where(np.arange(n) < 400, 1.0, 0.0))
    motion = _drive(_ONE, radians(60), n * 1e-3, degradation=wear)
    slope = np.polyfit(motion.time_s[410:500], motion.speed[410:500], 1)[0]
    yield _relative("deceleration under friction alone", -_COULOMB / _ONE.inertia, slope, "rad/s²", 1e-6)


def breakaway() -> Iterator[Check]:
    """Increase the load on a shaft at rest until it moves, at T_s = 1.2·T_c."""
    n = 4000
    dead = replace(Degradation.none(n), torque_factor=np.zeros(n))
    for method in ("impulse", "karnopp"):
        motion = _drive(replace(_ONE, friction_method=method), 0.0, 4.0, load=(0.0, 0.4), degradation=dead)
        torque = motion.load[np.flatnonzero(motion.speed)[0]]
        yield _relative(f"breakaway torque ({method})", 1.2 * _COULOMB, torque, "N·m", 1e-3)


def torsion() -> Iterator[Check]:
    """ω² = k·(1/J_rotor + 1/J_output) for the free two-mass oscillator."""
    gear = Gearbox(backlash=0.0, damping=0.0)
    n = 20_000
    dead = replace(Degradation.none(n), torque_factor=np.zeros(n))
    kick = np.where(np.arange(n) < 100, 1.0, 0.0)
    zeros = np.zeros(n)
    motion = simulate(
        _ONE.two_masses(gear), zeros, zeros, zeros, kick, dead, control_period_s=1e-5, step_s=1e-5
    )
    twist = (motion.rotor_angle - motion.angle)[200:]
    rises = np.flatnonzero((twist[:-1] < 0) & (twist[1:] >= 0))
    measured = (len(rises) - 1) / ((rises[-1] - rises[0]) * 1e-5)
    c = _ONE.two_masses(gear).constants()
    exact = sqrt(gear.stiffness * (1.0 / c.inertia + 1.0 / c.output_inertia)) / (2.0 * pi)
    yield _relative("torsional frequency", exact, measured, "Hz", 1e-3)


def lost_motion() -> Iterator[Check]:
    """Between two slow directions the rotor turns b + 2·T/k further than the output shaft."""
    time = np.arange(20_000) * 1e-3
    triangle = radians(10.0) * (1.0 - np.abs(time % 8.0 - 4.0) / 2.0)
    gear = Gearbox(backlash=radians(0.5))
    motion = _drive(_ONE.two_masses(gear), triangle, 20.0)
    twist = np.degrees(motion.rotor_angle - motion.angle)
    rest = np.degrees((1.0 - gear.rotor_friction) * _COULOMB / gear.stiffness)
    lost = np.median(twist[5000:6000]) - np.median(twist[9000:10_000])
    yield _relative("motion lost on reversal", -(0.5 + 2.0 * rest), lost, "°", 2e-3)


def limit_cycle() -> Iterator[Check]:
    """Without friction, play causes a limit cycle with an amplitude proportional to the play.

    The play is the only length scale of otherwise linear equations, so doubling it doubles the
    amplitude and keeps the period; without play the oscillation decays.
    """
    swings, periods = zip(*(_swing(play) for play in (0.0, 1.0, 2.0)), strict=True)
    yield Check("swing without backlash", 0.0, swings[0], "°", 1e-6)
    yield Check("swing at 1° of backlash over half of it (at least 1)", 1.25, swings[1] / 0.5, "1", 0.25)
    yield _relative("swing at 2° over swing at 1° of backlash", 2.0, swings[2] / swings[1], "1", 1e-3)
    yield _relative("period at 2° over period at 1° of backlash", 1.0, periods[2] / periods[1], "1", 1e-3)


def _swing(backlash_deg: float) -> tuple[float, float]:
    """Amplitude, °, and period, s, of the output shaft long after a step of the command."""
    gear = Gearbox(backlash=radians(backlash_deg))
    loop = replace(_ONE.two_masses(gear), slew_limit=1e3, supply_voltage=1e5, current_limit=1e5)
    angle = np.degrees(_drive(loop, radians(5.0 * max(backlash_deg, 1.0)), 8.0, friction=0.0).angle[4000:])
    swing = angle - angle.mean()
    rises = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    return float(np.ptp(angle)) / 2.0, float(np.mean(np.diff(rises)) * 1e-3) if len(rises) > 2 else 0.0


def energy() -> Iterator[Check]:
    """Energy supplied equals energy stored, dissipated and delivered, to 0.1 %."""
    for model, parameters in _MODELS.items():
        balance = energy_balance(parameters)
        yield Check(
            f"energy unaccounted for ({model})", 0.0, 100.0 * balance.residual / balance.supplied, "%", 0.1
        )


def convergence() -> Iterator[Check]:
    """Refine the step: the error of the angle shrinks with it (first order)."""
    for model, parameters in _MODELS.items():
        fine, middle, coarse = (_waves(parameters, step).angle for step in (1e-5, 1e-4, 1e-3))
        errors = [np.degrees(sqrt(np.mean((angle - fine) ** 2))) for angle in (middle, coarse)]
        yield Check(f"angle at steps of 0.1 ms against 0.01 ms ({model})", 0.0, errors[0], "°", 0.005)
        yield Check(f"error at 1 ms over error at 0.1 ms ({model})", 10.0, errors[1] / errors[0], "1", 2.0)


def friction_methods() -> Iterator[Check]:
    """Impulse and Karnopp friction give the same motion and the same current."""
    for model, parameters in _MODELS.items():
        one, other = (_waves(replace(parameters, friction_method=m), 1e-4) for m in ("impulse", "karnopp"))
        angle = np.degrees(sqrt(np.mean((one.angle - other.angle) ** 2)))
        current = sqrt(np.mean((one.current - other.current) ** 2))
        yield Check(f"angle, impulse against Karnopp ({model})", 0.0, angle, "°", 0.01)
        yield Check(f"current, impulse against Karnopp ({model})", 0.0, current, "A", 0.005)
        fractions = one.moving_fraction - other.moving_fraction
        yield Check(f"moving fraction, impulse against Karnopp ({model})", 0.0, fractions, "1", 0.02)


def stiff_gear() -> Iterator[Check]:
    """Two masses with a stiff gear without play move like one mass of the same total."""
    gear = Gearbox(stiffness=40_000.0, damping=15.0, backlash=0.0, surface_inertia=0.0)
    rigid, stiff = (_waves(p, 1e-5) for p in (_ONE, _ONE.two_masses(gear)))
    angle = np.degrees(sqrt(np.mean((rigid.angle - stiff.angle) ** 2)))
    yield Check("angle, stiff two masses against one mass", 0.0, angle, "°", 0.01)


def _waves(parameters: EmaParameters, step_s: float) -> Motion:
    """Return ten seconds of two superposed sines with a hinge moment proportional to the deflection."""
    n = 10_000
    time = np.arange(n) * 1e-3
    command = np.radians(15.0 * np.sin(2 * pi * 0.25 * time) + 5.0 * np.sin(2 * pi * 0.63 * time))
    friction, slope, offset = np.full(n, _COULOMB), np.full(n, 5.6), np.full(n, 0.5)
    return simulate(parameters, command, friction, slope, offset, step_s=step_s)


CHECKS: tuple[Callable[[], Iterator[Check]], ...] = (
    table_1,
    stalled_current,
    no_load_speed,
    coast_down,
    breakaway,
    torsion,
    lost_motion,
    limit_cycle,
    energy,
    convergence,
    friction_methods,
    stiff_gear,
)
