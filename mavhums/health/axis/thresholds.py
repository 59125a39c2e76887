"""Numbers that decide about an axis: what each trades, and what set it.

Limits of a loss, a lag, a trim and a tracking error are the profile's (:class:`~mavhums.results.sections`).
Most others were chosen on the development flights of docs/evidence/axes.md: 24 real flights of the ALFA data
set, 49 flights in software in the loop, and closed-loop flights with seeds below 9000; "development" below.
"""

from __future__ import annotations

from typing import Final

# Seconds of flight that make a reference: fewer leave the gain too uncertain, more leave fewer to be judged.
# Development.
REFERENCE_S: Final = 45

# Seconds within which a reference is sought, over which a quiet axis excludes a loss, and which give the
# usual speed: a whole circuit, climb and cruise. Older ones are of another phase of the flight, and would
# excuse a loss by what was before it. Development.
LONGEST_REFERENCE_S: Final = 120

# Rows of 20 that make a second usable: two thirds, so that one lost sample of a slow stream passes. By
# hand.
LEAST_ROWS_PER_S: Final = 14

# Standard deviation of the drive that a reference needs, of the full travel: a weaker one in quiet air is the
# autopilot's answer to gusts, with another gain. By hand: 0.015 and 0.026 find the same.
LEAST_DRIVE: Final = 0.02

# Effectiveness that a normal axis has at least: a loss of 40 % is what the test is for.
NORMAL_EFFECTIVENESS: Final = 0.6

# Largest standard error of an effectiveness that is shown or counted, and of a reference's gain beside the
# other contributions: half of that loss.
JUDGED_ERROR: Final = (1.0 - NORMAL_EFFECTIVENESS) / 2.0

# Least deviation of a roll reference, rad/s: a calm reference does not promise a calm flight.
# Development.
SHIFT_FLOOR_RAD_S: Final = 0.045

# Seconds over which a shift of the trim and a residual are averaged, and for which a roll must be away: gusts
# are shorter, a hard-over lasts, and a large step of the command is followed within 2 s. Development.
SHIFT_S: Final = 3

# Deviation of the side force while the aircraft goes astray, in deviations of its reference, and the shares
# of the roll's deviations beside it: of an aileron and of a rudder that stays deflected. Development: 34
# rudders and 81 other surfaces (closed loop, seed 5002; ALFA; software in the loop).
SKID_DEVIATIONS: Final = 2.0
SKID_SHARES: Final = (0.1, 0.5)

# Deviations of a roll that is beyond what the regression covers. Development, as above.
UNKNOWN_ROLL_DEVIATIONS: Final = 40.0

# Seconds in a row that a trim or a pitch must be away: one alone may be a gust. With three, an elevator that
# stops at 25° is found more than a minute later (benchmarks/control.py --share 9, seed 5000), and the roll
# alarms before the rudder that is stuck (an ALFA flight).
PERSISTENT_S: Final = 2

# Time between samples beyond which no gain is determined, s: 3 Hz with jitter passes, 2 Hz does not.
SLOW_STREAM_S: Final = 0.42

# Errors of the speed, m/s, by its source: sensor, wind triangle, ground, ground less the current. The
# triangle does not know the gusts, nor the current the wind along the heading. Larger finds losses later,
# smaller calls gusts and wind a loss (benchmarks/control.py --no-airspeed, seed 5000: 0, 1 and 2 m/s tried;
# benchmarks/steering.py, seeds 25 and 26: 0, 0.2 and 0.3 m/s tried).
SPEED_ERRORS_M_S: Final = (0.0, 2.0, 0.0, 0.2)

# Wind, m/s, that is in the speed of a reference before the first turns, and no longer after them. With 0 a
# wind of 4 m/s was a loss of roll control (benchmarks/thinned.py, a flight without VFR_HUD); more hides
# losses. By hand.
WIND_M_S: Final = 5.0

# Seconds after a hard-over rudder in which findings about other axes are its consequence. Development.
MASKED_S: Final = 20

# Share of the reference's speed that a second before flight must be below to show a take-off, and from which
# a loss is excluded: what flies at half of its usual speed stalls, and near the stall ailerons lose effect,
# which hides no loss. By hand: 0.7 excludes as much.
GROUND_SPEED_SHARE: Final = 0.5

# Additional lags that are tested, s: neighbours differ by a quarter of the gain; healthy flights have up to
# 0.3.
EXTRA_LAGS_S: Final = (0.3, 0.45, 0.65, 1.0, 1.5)

# Losses between the least one and all, each a hypothesis: a step of 0.15 lies within the error of a loss.
LOSSES: Final = 6

# The least of them, beside the loss that the profile calls degraded: a smaller one is within the error of a
# reference.
LEAST_LOSS_PER_LIMIT: Final = 1.25

# Seconds over which the unexplained response and the trim are measured: a manoeuvre and its end.
GUST_WINDOW_S: Final = 6

# Deviation of the trim that thrust and speed change, of the full travel. Larger delays slow demands, smaller
# calls a change of thrust a loss of roll: 0 makes 5 false alarms in 58 h, 4 of them in calm air, where 0.013
# makes one (benchmarks/control.py --share 0 --seed 27000 --healthy-hours 60).
TRIM_CHANGE: Final = 0.013

# Relative deviation of the gain between manoeuvres of minutes, the reference's included, and the mean time
# for which it is the same, s. A larger deviation and a shorter time excuse losses of a surface of several, a
# smaller one and a longer time call a manoeuvre after minutes of another gain a loss (benchmarks/control.py,
# development: 0.02 to 0.05 and 60 to 300 tried; healthy seeds 12000 and 16000, and, of 90 minutes, 19000;
# faults of seeds 5000 and 7000).
GAIN_DEVIATION: Final = 0.03
GAIN_KEPT_S: Final = 300

# Share of the gain that seconds much larger than the reference's may lack. Larger excuses losses: with 0.3
# one of 28 faults is missed (benchmarks/alfa.py, ArduPlane). Smaller calls large manoeuvres after a reference
# of small ones a loss: with 0, 5 healthy axes are faulty where flights begin later, with 0.2, 3
# (benchmarks/thinned.py --beginnings). Development.
LARGER_LOSS: Final = 0.2

# Largest logarithm of a second's likelihood ratio: an alarm needs three seconds at least, for a single
# manoeuvre may differ. Development.
MOST_RATIO: Final = 5.0

# Relative deviation of the gain of ten seconds. Development: healthy windows scatter by 9 % in calm air.
WINDOW_DEVIATION: Final = 0.10

# Memory of the filter that removes trim, s: longer ones keep phugoid and wind. In pitch a step of thrust or
# speed changes the elevator's trim for good (docs/method/axes.md).
SLOW_PART_S: Final = {"roll": 8.0, "pitch": 2.0, "yaw": 8.0, "steering": 8.0}

# Delays of an axis's own response that are tried, s: whole rows of 0.05 s; each costs a fit. By hand.
DELAYS_S: Final = {
    "roll": (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3),
    "pitch": (0.0, 0.05, 0.1),
    "yaw": (0.1, 0.2, 0.3),
    "steering": (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3),
}

# Lags of an axis's own response that are tried, s: a third of the smallest additional lag apart. By hand.
LAGS_S: Final = {
    "roll": (0.0, 0.1, 0.2),
    "pitch": (0.0, 0.1),
    "yaw": (0.0, 0.2),
    "steering": (0.0, 0.1, 0.2, 0.3),
}

# Largest relative standard error of a reference's gain. Development: at 0.1 some frozen ailerons are found
# later (benchmarks/control.py), at 0.06 fewer axes are judged.
GAIN_ERROR: Final = 0.08

# Least variance of a second's score, relative to the gain's square: quiet air does not last. Development:
# more finds faults later (0.002: after 20 s in the median instead of 17, benchmarks/alfa.py, ArduPlane), less
# calls a healthy axis in calm air a loss.
SCORE_SCATTER: Final = 0.0015

# Share of the reference speed below which an aircraft may be stalling: there the gain of ailerons falls to
# 0.2–0.5 in flights with failed engines. Development.
LEAST_SPEED_SHARE: Final = 0.85

# Rows that are averaged, 0.4 s: noise of rates falls, delays of 0.05 s still show. Development.
MEAN_ROWS: Final = 8

# Least deviation of the tracking, rad: a calm beginning does not promise a calm flight. Development.
TRACKING_FLOOR_RAD: Final = 0.033

# Least deviation of the side force, m/s², as above. Development.
SIDE_FORCE_FLOOR_M_S2: Final = 0.15

# Prior deviation of an attitude's offset, rad: trim and mounting are smaller. By hand.
OFFSET_SPREAD_RAD: Final = 0.1

# Natural frequency of a controlled attitude, rad/s: that of roll, fitted over the development flights. Pitch
# fits 4 rad/s after 0.6 s, and finds the same.
RESPONSE_RAD_S: Final = 2.5

# Rate at which a large reversal of the bank may be followed, °/s: it takes seconds, and a calm beginning
# does not show how many. Development.
FASTEST_ROLL_DEG_S: Final = 45

# Least rate at which a working elevator raises the nose after a stall, °/s. By hand: a load factor of 1.2 at
# 22 m/s; what is slower is a lost elevator, or a dive that the pilot wants.
NOSE_RISES_DEG_S: Final = 5
