"""Numbers that decide the verdict on a motor.

Efforts and thrusts are in units of the hover thrust of a motor. ``benchmarks/motors.py`` shows what they
cost: false alarms in simulated healthy flights, and faults that are found late.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from mavhums.core.arrays import Array

LEAST_LOSS_QUAD: Final = 0.25
LEAST_LOSS_MORE: Final = 0.4
"""Least share of thrust lost that is looked for, of four rotors and of more: of more, a shifted payload looks
like a small loss."""


SPAN_ROWS: Final = 2
"""Rows over which the effort is a mean, and the motion a difference."""
CORRELATED_S: Final = 0.25
"""Rows that gusts correlate, which say as much as one."""
NOISE_SD: Final[Array] = np.array([0.07, 0.07, 0.027])
"""Effort about roll, pitch and yaw that a healthy flight shows over such rows, before its own is known."""

AIR: Final[Array] = np.array([[0.12, 0.12, 0.02], [0.25, 0.25, 0.05], [0.05, 0.05, 0.15]])
"""SD of the effort that a payload or moving air asks for: usual, rare, and in yaw alone, as at a touch-down
or where the craft is turned."""
AIR_RARITY: Final[Array] = np.array([1.0, 55.0, 20.0])
"""How many times less likely each is than the first."""
AIR_LEVELS: Final = ((0.0, 0.1, 0.2, 0.3), (0.0, 0.1, 0.2, 0.3), (0.0, 0.03, 0.06, 0.12))
AIR_YAWS: Final = (0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Grid of these efforts about roll, pitch and yaw, and about yaw alone."""
AIR_CHANGES_S: Final = 20.0
"""Mean time from one of them to the next; less explains a motor's loss as air."""
STILL: Final = 0.5
"""Probability that the next one is none."""

MODEL_ERROR: Final = 0.15
"""Error of a motor's column, as a share of the loss: geometry, thrust curve."""

LEAST_GAIN: Final[Array] = np.array([60.0, 60.0, 7.0])
MOST_GAIN: Final[Array] = np.array([500.0, 500.0, 50.0])
"""Angular acceleration by a unit of effort, rad/s²: what lies between is explained by motion."""
YAW_DAMPING: Final = 0.1
"""Effort that holds a yaw rate, per rad/s; two standard deviations between aircraft are as much."""
TURN: Final = 0.1
"""Yaw rate, rad/s, at which half as much effort about yaw is learned as trim: that of a turn is none. Above
it, or above as large a change, a window bounds no loss: yaw is the witness, and it is busy."""

REFERENCE_S: Final = 40.0
"""Memory of the trim before; a fault that grows more slowly is learned."""

LEAST_THRUST: Final = 0.7
"""Share of the hover thrust below which nothing is judged, for at touch-down the effort winds up; nor is what
lies above its inverse, where a motor may be at the end of its range."""
AIRBORNE_S: Final = 4.0
"""In the air before anything is judged, for the take-off is no trim; and below half of the most bank after it
was more."""
SETTLED_S: Final = 15.0
"""In the air before a loss is excluded, and a trim compared with earlier flights."""
BANK_GRACE_S: Final = 0.3
"""After 60° of bank a quad without a motor still shows which one: it passes 60° after 0.26 to 0.32 s."""

BOUND_S: Final = 1.4
"""Seconds over which a loss is excluded. Below half of the hover thrust for as long is no dip: the flight is
over, and its trim with it."""
BOUND_SHARE: Final = 0.8
"""Share of the judged seconds over which a loss is excluded: one gust spoils no flight."""
MOST_EXCLUDED: Final = 0.7
"""A flight that excludes no more than this is undecided: a motor may have failed unseen."""

EMERGENCY_LOSS: Final = 0.5
"""Share lost from which a motor is an emergency: a quad has no control left to spare."""

BETWEEN_FLIGHTS: Final[Array] = np.array([0.03, 0.05, 0.012])
"""Standard deviation between a quad's flights of its effort about roll, pitch and yaw, by the thrust of one
motor: six flights of one aircraft with whole propellers."""
TRIM_SCATTER_PER_MOTOR: Final = 0.011
"""Scatter of a motor's trim between flights, by the number of motors: that of the efforts, along the columns
of quads, hexas and octas."""
LEAST_TRIM_CHANGE: Final = 0.15
"""Least change of a motor's thrust that is reported: a battery moved by a centimetre makes 0.1."""
