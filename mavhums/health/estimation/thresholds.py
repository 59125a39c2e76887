"""Numbers of the estimation that a verdict rests on: what each trades, and what set it."""

from __future__ import annotations

from typing import Final

MOST_TWIST_OF_STIFFNESS: Final = 2.0
CERTAIN_DIRECTION_TIMES_MOVING_SPEED: Final = 3.0
STANDSTILL_OF_MOVING_SPEED: Final = 0.2
LOADED_AT_STANDSTILL_A: Final = 0.03
RESISTANCE_PRIOR_SHARE: Final = 0.2
BACK_EMF_PRIOR_SHARE: Final = 0.1
MOVING_ROTOR_REV_MIN: Final = 50.0
MOVING_ANGLE_DEG_S: Final = 2.5
OWN_RATE_HZ: Final = 20.0
OWN_FLIGHTS: Final = 10
TRACKING_FLIGHTS: Final = 20
