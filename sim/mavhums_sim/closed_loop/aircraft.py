"""The aircraft: an individual of Beard and McLain's Aerosonde in JSBSim, in wind and turbulence.

R. W. Beard, T. W. McLain, "Small Unmanned Aircraft: Theory and Practice", Princeton University Press, 2012:
the coefficients of the airframe (appendix E, with the authors' supplement) and the model of motor and
propeller (supplement). Turbulence is JSBSim's: MIL-F-8785C, Dryden spectra.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib.resources import files
from typing import Any

import numpy as np

from mavhums_sim._arrays import Array

FRAME_S = 0.01
_FOOT, _POUND, _POUND_FOOT, _KNOT = 0.3048, 4.4482216152605, 1.3558179483314, 0.5144444
_TUSTIN = 4

STATES = {
    "roll": ("attitude/phi-rad", 1.0),
    "pitch": ("attitude/theta-rad", 1.0),
    "yaw": ("attitude/psi-rad", 1.0),
    "p": ("velocities/p-rad_sec", 1.0),
    "q": ("velocities/q-rad_sec", 1.0),
    "r": ("velocities/r-rad_sec", 1.0),
    "airspeed": ("velocities/vt-fps", _FOOT),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    "height": ("position/h-sl-ft", _FOOT),
    "north_speed": ("velocities/v-north-fps", _FOOT),
    "east_speed": ("velocities/v-east-fps", _FOOT),
    "down_speed": ("velocities/v-down-fps", _FOOT),
    "x_force": ("accelerations/a-pilot-x-ft_sec2", _FOOT),
    "y_force": ("accelerations/a-pilot-y-ft_sec2", _FOOT),
    "z_force": ("accelerations/a-pilot-z-ft_sec2", _FOOT),
}
_INPUTS = {
    "surface/aileron-rad": 1.0,
    "surface/elevator-rad": 1.0,
    "surface/rudder-rad": 1.0,
    "external_reactions/thrust/magnitude": 1.0 / _POUND,
    "propeller/torque-lbsft": 1.0 / _POUND_FOOT,
}


@dataclass(frozen=True, slots=True)
class Dispersion:
    """One individual of the type: factors on coefficients, and offsets of moment coefficients.

    Examples
    --------
    >>> Dispersion().aileron, Dispersion.draw(3) == Dispersion.draw(3)
    (1.0, True)
    """

    lift: float = 1.0
    drag: float = 1.0
    pitch_stiffness: float = 1.0
    pitch_damping: float = 1.0
    elevator: float = 1.0
    roll_damping: float = 1.0
    dihedral: float = 1.0
    aileron: float = 1.0
    weathercock: float = 1.0
    yaw_damping: float = 1.0
    rudder: float = 1.0
    roll_offset: float = 0.0
    pitch_offset: float = 0.0
    yaw_offset: float = 0.0

    @classmethod
    def draw(cls, seed: int) -> Dispersion:
        """Return airframe ``seed``: factors of 7 % standard deviation, offsets of 1° of surface."""
        rng = np.random.default_rng([seed, 21])
        factors = 1.0 + 0.07 * np.clip(rng.standard_normal(11), -2.5, 2.5)
        offsets = np.clip(rng.standard_normal(3), -2.5, 2.5) * np.radians(1.0) * np.array([0.17, 0.99, 0.069])
        return cls(*factors.tolist(), *offsets.tolist())


@dataclass(frozen=True, slots=True)
class Air:
    """The air of a flight.

    Attributes
    ----------
    wind, direction_deg
        Mean wind, m/s, and the direction from which it blows.
    turbulence
        Wind speed at 20 ft that sets JSBSim's turbulence below 300 m, m/s: 0 is smooth air, 7.7 light,
        15.4 moderate (MIL-F-8785C).
    """

    wind: float = 0.0
    direction_deg: float = 0.0
    turbulence: float = 0.0

    def __post_init__(self) -> None:
        for name, most in (("wind", 20.0), ("turbulence", 25.0)):
            if not 0.0 <= getattr(self, name) <= most:
                raise ValueError(f"{name} of {getattr(self, name)} m/s is outside 0…{most:g} m/s")


@dataclass(frozen=True, slots=True)
class Trim:
    """Level flight: angle of attack and elevator, rad (positive pitches down), and thrust, N."""

    alpha: float
    elevator: float
    thrust: float


class Aircraft:
    """JSBSim with the Aerosonde model; SI units, inputs as in the aircraft's file.

    Raises
    ------
    ModuleNotFoundError
        If JSBSim is not installed; the message names the extra.
    """

    def __init__(self, dispersion: Dispersion | None = None, seed: int = 0) -> None:
        self.exec = _load()
        self.exec["simulation/randomseed"] = float(seed % 2**31)
        self.exec["atmosphere/randomseed"] = float(seed % 2**31)
        for field in fields(Dispersion):
            value = getattr(dispersion or Dispersion(), field.name)
            self.exec[f"dispersion/{field.name.replace('_', '-')}"] = value
        manager = self.exec.get_property_manager()
        self._read = [manager.get_node(name).get_double_value for name, _ in STATES.values()]
        self._write = [manager.get_node(name).set_double_value for name in _INPUTS]
        self._wind = [
            manager.get_node(f"atmosphere/wind-{to}-fps").set_double_value for to in ("north", "east")
        ]
        self.run = self.exec.run
        self._raw = np.empty(len(STATES))

    def place(self, height: float, airspeed: float, theta: float = 0.0, psi: float = 0.0) -> None:
        """Set the aircraft's state: no rotation, wings level, nose ``theta`` above its path."""
        self.exec["ic/h-sl-ft"] = height / _FOOT
        self.exec["ic/vt-fps"] = airspeed / _FOOT
        self.exec["ic/alpha-rad"] = theta
        self.exec["ic/theta-rad"] = theta
        self.exec["ic/psi-true-rad"] = psi
        self.exec.run_ic()

    def blow(self, air: Air) -> None:
        """Set wind and turbulence."""
        self.wind(*(-air.wind * np.array([np.cos(d := np.radians(air.direction_deg)), np.sin(d)])).tolist())
        self.exec["atmosphere/turb-type"] = float(_TUSTIN if air.turbulence else 0)
        self.exec["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = air.turbulence / _FOOT
        self.exec["atmosphere/turbulence/milspec/severity"] = 3.0

    def wind(self, north: float, east: float) -> None:
        """Set the mean wind, m/s, towards north and east."""
        self._wind[0](north / _FOOT)
        self._wind[1](east / _FOOT)

    def drive(self, inputs: list[float]) -> None:
        """Set aileron, elevator, rudder, rad, and thrust, lbf, and propeller torque, lbf·ft."""
        for write, value in zip(self._write, inputs, strict=True):
            write(value)

    def read(self) -> Array:
        """Return the states in JSBSim's units; :data:`STATES` has the factors to SI. The array is reused."""
        self._raw[:] = [read() for read in self._read]
        return self._raw

    def accelerations(self) -> Array:
        """Return u̇, v̇, ẇ in m/s² and ṗ, q̇, ṙ in rad/s², in the state after :meth:`place`."""
        names = [f"accelerations/{axis}dot-ft_sec2" for axis in "uvw"]
        names += [f"accelerations/{axis}dot-rad_sec2" for axis in "pqr"]
        factors = np.array([_FOOT] * 3 + [1.0] * 3)
        values: Array = np.array([float(self.exec[name]) for name in names]) * factors
        return values

    def trim(self, height: float, airspeed: float) -> Trim:
        """Find level, straight, still flight by Newton's method."""
        from scipy.optimize import fsolve

        def residual(guess: Array) -> Array:
            alpha, elevator, thrust = guess
            self.drive([0.0, float(elevator), 0.0, float(thrust) / _POUND, 0.0])
            self.place(height, airspeed, float(alpha))
            return self.accelerations()[[0, 2, 4]]

        alpha, elevator, thrust = fsolve(residual, np.array([0.05, 0.0, 10.0]), xtol=1e-10)
        residual(np.array([alpha, elevator, thrust]))
        return Trim(float(alpha), float(elevator), float(thrust))


def _load() -> Any:
    try:
        import jsbsim
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("the closed loop needs JSBSim: pip install 'mavhums[sim]'") from error
    silent: Any = jsbsim.FGJSBBase
    silent().debug_lvl = 0
    root = str(files("mavhums_sim"))
    loaded = jsbsim.FGFDMExec(root, None)
    loaded.set_debug_level(0)
    loaded.set_aircraft_path("aircraft")
    loaded.load_model("aerosonde")
    loaded.set_dt(FRAME_S)
    return loaded
