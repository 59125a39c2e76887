"""Numbers that decide for every kind of subject: what each trades, and what set it.

Where no benchmark or document is named, the number was chosen by hand and not swept.
"""

from __future__ import annotations

from typing import Final

# Allowed false alarms per actuator and 100 hours. Fewer find faults later; the default of ``--false-
# alarms``.
FALSE_ALARMS: Final = 1.0

# Windows of 10 s that share no sample in 100 hours: turns the rate into a probability of one window.
WINDOWS_PER_100_H: Final = 36_000.0

# The latest windows with which a fault may begin: more of them find a small fault by its long mean, and take
# longer to compute.
STARTS: Final = 60

# Time through which the windows of a quantity without an error must agree: a glitch lasts less. By hand.
AGREEING_S: Final = 13.5

# Degrees of freedom that earlier windows may add to an error, those of four windows: more would make the
# error deaf to rougher air. By hand.
MOST_POOLED_FREEDOM: Final = 36.0

# Fewer flights make no baseline: their scatter is too uncertain to keep the promised false alarms
# (docs/evidence/self-baseline.md).
BASELINE_FLIGHTS: Final = 10

# Degrees of freedom that a flight of few windows is taken to have, so that its error stays finite. By
# hand.
LEAST_WINDOW_FREEDOM: Final = 3

# Scatter of an axis between healthy flights: 6.5 % of the roll gain in 19 flights of the ALFA aircraft;
# chosen after a first run of benchmarks/control_history.py with aircraft 3–6.
AXIS_SCATTER_SHARE: Final = {"effectiveness": 0.07, "manoeuvre": 0.07}

# Windows that a drift is sought over: short spans find large changes soon, long ones small changes.
DRIFT_SPANS_WINDOWS: Final = (1, 2, 3, 5, 8, 13, 21, 34)

# Effective number of independent tests of these overlapping spans; benchmarks/health.py alarms counts what
# it keeps.
DRIFT_LOOKS: Final = 4.0

# Largest false-alarm probability of a whole flight, however long it is. By hand.
MOST_FLIGHT_TAIL: Final = 0.01

# Degrees of freedom of the confidence that is shown beside a shift; it decides nothing. By hand.
SHOWN_SHIFT_FREEDOM: Final = 10.0

# Minimum number of flights for a trend: fewer leave its slope no degrees of freedom to be sure. By hand.
TREND_FLIGHTS: Final = 8

# Distance of a limit, as a multiple of the span of the growing flights, from which it is said to be far: a
# straight line is a guess there. benchmarks/trend.py has how often the interval holds.
TREND_REACH_SPANS: Final = 3.0

# Bonferroni-corrected probability below which a flight is an outlier: larger values cost healthy
# flights.
OUTLIER_PROBABILITY: Final = 0.01

# One flight in so many may be an outlier, and at least one: more outliers are another course. By hand.
FLIGHTS_PER_OUTLIER: Final = 10

# Largest lag-one correlation that widens an interval, ninefold there: beyond it the course is no line. By
# hand.
MOST_AUTOCORRELATION: Final = 0.8

# Chance that an indicator that does not grow is ever said to, in so many flights: with the indicators of four
# actuators and three axes at most one aircraft in a hundred, by benchmarks/growth.py far fewer.
GROWTH_CHANCE: Final = 4e-4
GROWTH_HORIZON_FLIGHTS: Final = 200.0

# Flights for which an indicator must have grown: fewer are outliers. By hand.
GROWTH_FLIGHTS: Final = 5

# Slopes that are sought, in standard deviations of a flight: from a limit in 300 flights at 3 % scatter to
# one in 10 at 10 %. The false alarms do not depend on them.
GROWTH_SCALES: Final = (0.03, 0.1, 0.4, 1.6)

# Least size of a step, in standard errors by the scatter of neighbours, which weather that lasts makes too
# small; flights whose median is taken on either side, flights through which a line must be unlikely, and
# flights after a step that must confirm it. By benchmarks/growth.py, on its seeds for development.
STEP_SIZE: Final = 7.0
STEP_CONFIRMED_FLIGHTS: Final = 3
STEP_MEAN_FLIGHTS: Final = 5
STEP_NEIGHBOURS: Final = 8

# How much likelier a step must be than the line. By hand.
STEP_LIKELIHOOD_RATIO: Final = 20.0

# Least error of a flight, as a share of the largest: one with next to no error would be the line. By hand.
LEAST_ERROR_SHARE: Final = 1e-3

# Judged flights in a row without a fault that end it: five below a limit are a chance of 1 in 32 if half of
# all flights lie above it (sign test). More keep a repair that nobody recorded on the list for longer.
CLEAR_FLIGHTS: Final = 5

# Odds from which the flights of a baseline are taken to grow, so that it is the level before the growth: no
# alarm, so less than is needed to tell it. By hand.
BASELINE_GROWTH_ODDS: Final = 20.0

# Flights whose dates tell how often an aircraft flies, and for which a step is told.
RATE_FLIGHTS: Final = 20
