"""Numbers of the estimation on which a verdict rests: what each trades, and what set it.

Where no benchmark or document is named, the number was chosen by hand and not swept.
"""

from __future__ import annotations

from typing import Final

# Length of a window, s. Longer ones estimate better and find later; benchmarks/health.py windows has
# both.
WINDOW_S: Final = 10

# A sample is evidence if the motion lasts so long before and after it, s: the time in which a shaft takes
# up the gear's play at a reversal. By hand, from the paper's actuator; not swept.
GUARD_S: Final = 0.06

# A longer gap between samples, in periods of the lowest rate, ends a motion, is no travel of a shaft, and
# starts what compares it with its command anew: two may be lost, three not. By hand.
LONGEST_GAP_PERIODS: Final = 2.5

# Larger values are damage, in any unit; they would swamp sums of squares.
MOST_PLAUSIBLE: Final = 1e9

# Slots of a window, parts of a flight and flights that make an error meaningful: a jackknife over fewer is
# itself uncertain by half. By hand.
LEAST_PARTS: Final = 4

# Standard errors by which the load must show in the power: its law rests on ratios to this coefficient. By
# hand.
LOAD_SHOWS_ERRORS: Final = 5.0

# Share of its mean by which a healthy actuator's friction scatters from flight to flight: 3–13 % from day to
# day on a real actuator on a bench (docs/evidence/self-baseline.md). It costs sensitivity and keeps the
# promised false alarms (docs/evidence/actuators.md, early detection with and without it).
NATURAL_SCATTER_SHARE: Final = 0.05

# Weight, in degrees of freedom, of the belief that flights scatter by their stated errors: the least with
# which drawn flights whose errors are right keep the promised false alarms, with ten flights before
# (benchmarks/promised.py); more of it hides rises where motions recur.
STATED_ERROR_FREEDOM: Final = 2.0

# Current that shows a winding at standstill, A: three steps of ESC_TELEMETRY. Less is noise, whose
# magnitude is no current.
LOADED_AT_STANDSTILL_A: Final = 0.03

# Prior deviation of the resistance: wide, because a fault may have changed it. By hand: at 0.1 a grave one is
# not seen (benchmarks/severities.py).
RESISTANCE_PRIOR_SHARE: Final = 0.2

# Prior deviation of the torque constant: wide, because a fault may have changed it. By hand: at 0.2 some
# flights of a servo on a bench contradict its data sheet (benchmarks/real_actuators.py).
BACK_EMF_PRIOR_SHARE: Final = 0.1

# Speed from which a rotor moves whose gear is not known, rev/min: noise of ESC telemetry is below. By
# hand.
MOVING_ROTOR_REV_MIN: Final = 50.0

# Speed from which a shaft moves by its angle alone, °/s: noise of 0.02° is 0.7 °/s between neighbours at 50
# Hz.
MOVING_ANGLE_DEG_S: Final = 2.5

# Slower telemetry is no evidence for an own-scale equation, Hz: at 25 Hz the figures of
# docs/evidence/self-baseline.md hold.
OWN_RATE_HZ: Final = 20.0

# Share of the angle's changes below which a speed is a coarse register, whose steps and delay pass for
# friction: that of a servo on a bench changes 41 times a second, its angle 99 times. As
# large a share of the slowest samples must show changes of the angle. By hand.
COARSE_SPEED_SHARE: Final = 0.5

# Time either way over which a line through the angle gives its speed, s: a shorter one has the angle's steps,
# a longer one the motion's curvature. By hand.
ANGLE_SPEED_S: Final = 0.04

# Largest share of the load that a gear's friction is: spur gears of small servos lose 0.29–0.34 of it on a
# bench (docs/method/verdicts.md); a worm or a screw that holds its load by itself has 0.5.
MOST_LOAD_FRICTION: Final = 0.5

# Slots over which the balance that gives the load is remembered: hinge moments change with the airspeed
# within minutes, and fewer slots do not separate load from friction. By hand.
LOAD_MEMORY_SLOTS: Final = 30.0

# Span over which the commanded speed is read, s: pulses of 0.1° blur that of single samples. By hand.
STROKE_SPAN_S: Final = 0.3

# Change of the commanded speed, as a share of it, that ends a stroke. By hand.
STROKE_SPEED_SHARE: Final = 0.1

# Part of a stroke that is left out at its beginning, s: the servo takes up its speed (set on the profile of
# the screw rig of benchmarks/real_actuators.py). At its end the span of the commanded speed is.
STROKE_BEGIN_S: Final = 1.4

# A longer motion at one speed is no stroke of a surface, s. By hand; it bounds the memory.
LONGEST_STROKE_S: Final = 30.0

# Strokes that a flight's record holds: its first. By hand; it bounds the memory.
MOST_STROKES: Final = 64

# Samples that a direction of motion or a friction rests on, and a network's vote, half to either side: fewer
# than two a slot. Twice as many, half to either side, determine a flight's wear or its load, else single
# reversals decide; four times as many its law of power, whose columns are products; as many show the
# roughness of a stroke. By hand.
LEAST_SAMPLES: Final = 20

# Flights of a baseline: with five neither the promised false alarms nor the stated least rise are kept, for
# their scatter is too uncertain (docs/evidence/self-baseline.md, 10 % scatter).
BASELINE_FLIGHTS: Final = 10

# Flights of a baseline by position only, whose line over the activity takes one more coefficient
# (docs/evidence/self-baseline.md), and flights that a newer one is compared with: their mean is known to a
# quarter of one flight's scatter.
REFERENCE_FLIGHTS: Final = 20

# Least error of a flight, as a share of the largest, or of its mean over strokes: nothing, but no zero to
# divide by; one with next to no error would be the line. By hand.
LEAST_ERROR_SHARE: Final = 1e-3
