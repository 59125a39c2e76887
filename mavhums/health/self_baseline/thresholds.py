"""Numbers that decide about a servo without a data sheet: what each trades, and what set it.

They were tuned on the simulated aircraft 0–2 and fixed before the figures of docs/evidence/self-baseline.md.
"""

from __future__ import annotations

from typing import Final

# Ratio up to which flights are alike in their sample rates, on which the estimate depends, in their activity
# beyond the baseline's, and in their loads, over which closer ones give no line its slope. By hand.
ALIKE_RATIO: Final = 1.25

# Times the baseline's largest error, by information, that a flight's own error counts at most; of healthy
# flights at most 2.4 (docs/evidence/self-baseline.md).
BLURRED_TIMES: Final = 3.0

# Difference between two flights' mean signs of the load over their strokes from which they are loaded in
# opposite directions: signs of no load scatter about zero.
OTHER_DIRECTION: Final = 1.0
