"""Individual actuators and surfaces, which differ within their type."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from mavhums_sim.ema import EmaParameters

_WITHIN = 2.5  # standard deviations: the tolerance of quality control


@dataclass(frozen=True, slots=True)
class Individual:
    """Deviations of one actuator and its surface from the data sheet; none by default.

    The controller, and V8 = k_t·V5, use the data sheet, because the true values are not known on board.

    Attributes
    ----------
    torque_constant, friction, inertia, hinge
        Factors on k_t, healthy T_c, J and both hinge-moment coefficients.
    viscous
        Viscous drag, N·m·s/rad.
    """

    torque_constant: float = 1.0
    friction: float = 1.0
    viscous: float = 0.0
    hinge: float = 1.0
    inertia: float = 1.0

    @classmethod
    def draw(cls, seed: int, index: int) -> Individual:
        """Draw actuator ``index`` of aircraft ``seed``.

        Normal factors with standard deviations 3 % (torque constant) and 10 % (friction, hinge
        moment, inertia), cut at 2.5; viscous drag uniform from 0 to 0.05 N·m·s/rad.
        """
        rng = np.random.default_rng([seed, 6, index])
        spread = np.clip(rng.standard_normal(4), -_WITHIN, _WITHIN) * (0.03, 0.10, 0.10, 0.10)
        torque_constant, friction, hinge, inertia = (1.0 + spread).tolist()
        return cls(torque_constant, friction, rng.uniform(0.0, 0.05), hinge, inertia)

    def parameters(self, nominal: EmaParameters) -> EmaParameters:
        """Return the constants of this individual; its torque constant is applied as a degradation."""
        return replace(
            nominal, inertia=nominal.inertia * self.inertia, viscous=nominal.viscous + self.viscous
        )

    def truth(self) -> dict[str, float]:
        """Return the individual as plain data."""
        return asdict(self)
