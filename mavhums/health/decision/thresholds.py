"""Numbers that decide for every kind of subject: what each trades, and what set it.

Where no benchmark or document is named, the number was chosen by hand and not swept.
"""

from __future__ import annotations

from typing import Final

# Allowed false alarms per actuator and 100 hours. Fewer find faults later; the default of ``--false-
# alarms``.
FALSE_ALARMS: Final = 1.0

# The latest windows with which a fault may begin: more of them find a small fault by its long mean, and take
# longer to compute.
STARTS: Final = 60

# Scatter of an axis between healthy flights: 6.5 % of the roll gain in 19 flights of the ALFA aircraft;
# chosen after a first run of benchmarks/control_history.py with aircraft 3–6.
AXIS_SCATTER_SHARE: Final = 0.07

# Largest false-alarm probability of a whole flight, however long it is. By hand.
MOST_FLIGHT_TAIL: Final = 0.01

# Minimum number of flights for a trend: fewer leave its slope no degrees of freedom to be sure. By hand.
TREND_FLIGHTS: Final = 8

# Distance of a limit, as a multiple of the span of the growing flights, from which it is said to be far: a
# straight line is a guess there. benchmarks/trend.py has how often the interval holds.
TREND_REACH_SPANS: Final = 3.0

# Largest lag-one correlation that widens an interval, ninefold there: beyond it the course is no line. By
# hand.
MOST_AUTOCORRELATION: Final = 0.8

# Chance that an indicator that does not grow is ever said to: with the indicators of four actuators and three
# axes at most one aircraft in a hundred, by benchmarks/growth.py far fewer.
GROWTH_CHANCE: Final = 4e-4

# Flights over which growth may begin, and among the latest of which the onset of a change is sought: more of
# them find growth later, and a comparison takes longer.
HORIZON_FLIGHTS: Final = 200

# Slopes that are sought, in standard deviations of a flight: from a limit in 300 flights at 3 % scatter to
# one in 10 at 10 %. The false alarms do not depend on them.
GROWTH_SCALES: Final = (0.03, 0.1, 0.4, 1.6)

# Least size of a step, in standard errors by the scatter of neighbours, which weather that lasts makes too
# small. By benchmarks/growth.py, on its seeds for development.
STEP_SIZE: Final = 7.0

# Parts that must agree, for one may be a glitch or a gust, and two show no scatter: seconds of ten with a
# gear's load on either flank, or with an error of following; blocks of a trim, those that one after the other
# withdraw a loss, and flights of motors, whose scatter others show; flights after a step. More find a fault
# later. By hand; the flights by benchmarks/growth.py, on its seeds for development.
AGREEING: Final = 3

# Probability from which one of several motors or mixed surfaces is named alone: less names the opposite motor
# in the rebound; of 118 elevons and V-tails that reach it none is the wrong one.
NAMED: Final = 0.9

# Judged seconds without a fault from which an axis or the motors of a flight are normal. Development.
NORMAL_S: Final = 30

# At steeper banks neither axes nor motors are judged, °: the regressions are linear. By hand.
MOST_BANK_DEG: Final = 60

# Flights in a row that make something last: for fewer an indicator that grew is an outlier, and the level
# beside a step, or of an axis before a flight, is uncertain; as many without a fault end it: five below a
# limit are a chance of 1 in 32 if half of all flights lie above it (sign test). More keep a repair that
# nobody recorded on the list for longer.
LASTING_FLIGHTS: Final = 5

# Share of a stream that comes too late, or of values that no such actuator can have, from which a reason
# names it: below, verdicts hardly change. By hand.
NAMED_SHARE: Final = 0.2
