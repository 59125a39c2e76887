"""Faults of motor and supply: resistance of the winding, torque constant, sag of the supply's voltage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator, Ema
from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import ERRORS_95
from mavhums.health.actuator.detector import EquationDetector, sharp
from mavhums.health.actuator.thresholds import (
    CONTRADICTED_CONSTANT_SHARE,
    MODEL_ERROR_LIMIT_SHARE,
    WIDEST_ERROR_SHARE,
)
from mavhums.health.decision.limits import Estimates, Levels
from mavhums.health.estimation.least_squares import Fit


class WindingResistanceDetector(EquationDetector):
    """Winding resistance, relative to the data sheet's."""

    fault: ClassVar[str] = "winding_resistance"
    quantity: ClassVar[str] = "winding resistance"
    unit: ClassVar[str] = "Ω"
    inspect: ClassVar[str] = "winding, connectors and wiring for a poor contact"
    equations: ClassVar[tuple[str, ...]] = ("voltage",)

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        gain = actuator.limits.resistance_gain if actuator.limits else None
        nominal = actuator.known_ema().resistance
        self.levels = Levels(None if gain is None else nominal * (1.0 + gain))

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the resistance; undecidable if the current varies too little."""
        fit, nominal = fits["voltage"], self.actuator.known_ema().resistance
        resistance, error = fit.corrected("resistance", noisy="resistance")
        shown = fit.spread & sharp(resistance, error, self.levels.normal, nominal)
        return Estimates.of(resistance, error, fit.freedom, shown)


class TorqueConstantDetector(EquationDetector):
    """Fraction of the data sheet's torque constant that is lost."""

    fault: ClassVar[str] = "torque_constant"
    quantity: ClassVar[str] = "torque constant lost"
    unit: ClassVar[str] = "1"
    inspect: ClassVar[str] = "the motor's magnets, which age and suffer from heat"
    equations: ClassVar[tuple[str, ...]] = ("voltage",)

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(actuator.limits.torque_constant_loss if actuator.limits else None)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the loss; undecidable if the shaft moves too little for evidence of the back-EMF.

        Magnets may lose most of it. A gain of half contradicts the data sheet, and so does a shaft that turns
        without back-EMF: the motor is not the profile's, or a sensor lies.
        """
        ema = self.actuator.known_ema()
        fit = fits["voltage"]
        constant, error = _from_back_emf(fit, ema, turned=self.turned)
        shown = fit.spread & sharp(1.0 - constant, error, self.levels.normal)
        shown &= (constant > ERRORS_95 * error) & (constant < 1.0 + CONTRADICTED_CONSTANT_SHARE)
        return Estimates.of(1.0 - constant, error, fit.freedom, shown)


def contradicts(voltage: Fit, ema: Ema, *, turned: bool | None) -> tuple[Flags, Array]:
    """Return whether the back-EMF surely departs from the data sheet by half or more, and its share of it.

    Then nobody knows what torque a current is worth, and no torque balance holds.
    """
    shown, error = _from_back_emf(voltage, ema, turned=turned)
    return (error < WIDEST_ERROR_SHARE) & (np.abs(1.0 - shown) >= CONTRADICTED_CONSTANT_SHARE), shown


def relative_constant(voltage: Fit, ema: Ema, *, turned: bool | None) -> tuple[Array, Array]:
    """Return torque constant over the data sheet's, and its standard error, shapes (k,).

    What the back-EMF shows and what the profile knows, each weighted with its certainty. NaN where the
    back-EMF contradicts the data sheet: then nobody knows what torque a current is worth.
    """
    shown, error = _from_back_emf(voltage, ema, turned=turned)
    known = max(ema.torque_uncertainty / 2, 1e-6)
    # What the profile knows and what the flight shows, each by its inverse variance.
    weight = known**2 / (known**2 + error**2)
    contradicted, _ = contradicts(voltage, ema, turned=turned)
    return np.where(contradicted, np.nan, 1.0 + weight * (shown - 1.0)), np.sqrt(weight) * error


def _from_back_emf(voltage: Fit, ema: Ema, *, turned: bool | None) -> tuple[Array, Array]:
    """Return what the back-EMF alone shows of it.

    Noise in the current is allowed for, or that of a speed which is the output shaft's: in calm cruise the
    shaft moves so much by itself that a tenth of the back-EMF seems lost.
    """
    nominal = ema.torque_constant * ema.gear_ratio
    if turned:
        constant, error = voltage.corrected("back_emf", noisy="back_emf", healthy=nominal)
    else:
        constant, error = voltage.corrected("back_emf", noisy="resistance")
    return constant / nominal, error / nominal


class SupplySagDetector(EquationDetector):
    """Supply voltage drop relative to the healthy supply."""

    fault: ClassVar[str] = "supply_sag"
    quantity: ClassVar[str] = "supply voltage lost"
    unit: ClassVar[str] = "V"
    inspect: ClassVar[str] = "battery, regulator and wiring of its supply"
    equations: ClassVar[tuple[str, ...]] = ("supply",)

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(actuator.limits.supply_sag_v if actuator.limits else None)
        self._supply = actuator.known_ema().supply_voltage or np.nan

    @classmethod
    def suits(cls, actuator: Actuator) -> bool:
        """Return whether the profile has the healthy supply's voltage, and shows where it is measured."""
        known = actuator.ema is not None and actuator.ema.supply_voltage is not None
        return known and (actuator.esc_side == "bus" or actuator.slew_deg_s is not None)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the sag; undecidable where no voltage is the supply's."""
        fit = fits["supply"]
        voltage, error = fit["voltage"]
        # The sensor's own error does not average out.
        error = np.hypot(error, MODEL_ERROR_LIMIT_SHARE * (self.levels.normal or 0.0))
        # A voltage at the motor that scatters by more than the limit is the controller's, not the supply's.
        steady = np.sqrt(fit.variance) < (self.levels.normal or np.inf)
        shown = fit.spread & (steady | (self.actuator.esc_side == "bus"))
        return Estimates.of(self._supply - voltage, error, fit.freedom, shown)
