"""Numbers that decide about an actuator with a data sheet: what each trades, and what set it.

Limits of a fault are the profile's. Where no benchmark or document is named, the number was chosen by hand
and not swept.
"""

from __future__ import annotations

from typing import Final

# Largest standard error that counts, of what lies between a healthy value and its limit, and of a back-EMF
# that contradicts the data sheet: at 0.5 three of 160 healthy torque constants are called degraded
# (benchmarks/false_alarms.py, from flight 9500).
WIDEST_ERROR_SHARE: Final = 0.2

# Departure of the back-EMF from the data sheet beyond which nobody knows what torque a current is worth: no
# wear does so much. benchmarks/severities.py flies losses up to 100 %.
CONTRADICTED_CONSTANT_SHARE: Final = 0.5

# What a flight's balance leaves out, as a share of the normal limit: play, wind-up and stick-slip, or the
# sensor's own error of the supply. A friction below it is none: no gear turns with less, so the current
# does not change. By hand.
MODEL_ERROR_LIMIT_SHARE: Final = 0.02

# A shaft that travels less of its error within a second is at rest, which is for the detector of jams. By
# hand.
FOLLOWING_REST_SHARE: Final = 0.1

# Times the limit that must be asked in a second to show that a shaft follows; less shows no fault and ends
# none. With it healthy individuals reach 0.8° (docs/method/verdicts.md).
FOLLOWING_ASKED_LIMITS: Final = 5.0

# Share of the commanded travel that a jam leaves out, and share of the current at stall that a jammed shaft
# takes at rest: of healthy actuators at most 0.15 and 0.3, with 1.0 to 1.5 N·m of friction 0.4 and
# 0.66 (docs/method/verdicts.md).
JAM_SHARE: Final = 0.8

# Commanded travel that shows a jam, °: several times what an actuator of 1.0 N·m of friction leaves out
# while its controller builds up the torque to break away (docs/method/verdicts.md).
JAM_COMMAND_DEG: Final = 4.0

# Parts of a slot by which a jam is sought: more find shorter ones, and the parts hold fewer samples. By hand.
JAM_PARTS_PER_SLOT: Final = 4

# Share of the current at rest that the shaft's latest motion took if the load stopped the shaft: 0.8–0.9
# of a real one too weak for its pendulum (benchmarks/real_actuators.py, weak). Lower misses jams. By hand.
LABOURED_SHARE: Final = 0.5

# Travel of a rotor before its jammed shaft, °: of a gear of 400 N·m/rad and 0.1° of play, by 5 N·m to
# either side.
WOUND_UP_DEG: Final = 1.5

# Seconds of two that a motor must push in vain: none of healthy actuators, 0.1 with 2.0 N·m of friction
# (docs/evidence/actuators.md, short jams).
STALLED_SECONDS: Final = 0.5
