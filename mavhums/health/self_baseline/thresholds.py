"""Numbers that decide about a servo without a data sheet: what each trades, and what set it.

They were tuned on the simulated aircraft 0–2 and fixed before the figures of docs/evidence/self-baseline.md.
"""

from __future__ import annotations

from typing import Final

# Largest ratio of sample rates of flights that are compared: the estimate depends on the rate. By hand.
ALIKE_RATE_RATIO: Final = 1.25

# Times the baseline's largest error, by information, that a flight's own error counts at most; of healthy
# flights at most 2.4 (docs/evidence/self-baseline.md).
BLURRED_TIMES: Final = 3.0

# Latest flights among which the onset of a change is sought: bounds the time of a comparison.
TRAILING_FLIGHTS: Final = 100

# Temperature difference among the flights from which the slope over temperature can be determined, K. By
# hand.
WARMTH_K: Final = 5.0

# Temperature beyond the baseline's to which its line is extrapolated, K. By hand.
BEYOND_K: Final = 3.0

# Activity beyond the baseline's to which its line is extrapolated, of the logarithm: a fifth. By hand.
BEYOND_ACTIVITY: Final = 0.2

# Loss of the torque constant that explains a rise of the friction current: a hot magnet loses less. By
# hand.
LEAST_CONSTANT_LOSS_SHARE: Final = 0.03

# Bias of the friction current's level by flight mode, as measured on aircraft 0–2
# (docs/evidence/self-baseline.md); it cancels only in a comparison with the past.
STALL_BIAS_SHARE: Final = 0.1

# Times the stated supply beyond which a voltage at the motor shows that the statement is wrong. By hand.
OVER_SUPPLY_TIMES: Final = 1.1

# Load beyond those of the baseline's flights, as a share of the highest, that is extrapolated: the line of
# friction over load bends near stiction. By hand.
BEYOND_LOAD: Final = 0.05

# Highest over lowest load of the baseline's flights from which a line over the load is fitted: closer ones
# give it no slope. By hand.
DIFFERENT_LOADS: Final = 1.3

# Difference between two flights' mean signs of the load over their strokes from which they are loaded in
# opposite directions: signs of no load scatter about zero.
OTHER_DIRECTION: Final = 1.0
