"""Sweep the control surfaces before take-off, at constant speed, out and back with rests.

    python examples/surface_sweep.py udpin:0.0.0.0:14550 [--px4] [--strokes 5] [--seconds 5]

The aircraft is on the ground, disarmed. ArduPilot is set to MANUAL and gets the sticks' positions
(RC_CHANNELS_OVERRIDE; outputs must be free, so press the safety switch first); PX4 gets
MAV_CMD_ACTUATOR_TEST for its servos. Record V1–V12 meanwhile, then: ``mavhums check LOG``. It stops as soon
as the vehicle is armed, and gives the sticks back.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

RATE_HZ = 50.0
REST_S = 3.0
ARDUPILOT_CHANNELS = (0, 1, 3)  # roll, pitch, yaw
PX4_SERVOS = 4
FIRST_SERVO = 33  # ACTUATOR_OUTPUT_FUNCTION_SERVO1
RELEASED, UNCHANGED = 0, 65535


def positions(strokes: int, seconds: float, rate_hz: float = RATE_HZ) -> Iterator[float]:
    """Yield the commanded positions, -1 to 1: rest, then strokes of ``seconds`` with rests between them."""
    rest, steps = round(REST_S * rate_hz), round(seconds * rate_hz)
    ends = [0.0] + [1.0 if k % 2 == 0 else -1.0 for k in range(strokes)] + [0.0]
    for begin, end in pairwise(ends):
        yield from [begin] * rest
        # The first and the last stroke are half as long, and as fast.
        count = round(steps * abs(end - begin) / 2)
        yield from (begin + (end - begin) * k / count for k in range(1, count + 1))
    yield from [ends[-1]] * rest


def sweep(
    link: Any,
    *,
    px4: bool,
    strokes: int = 5,
    seconds: float = 5.0,
    sleep: Callable[[float], None] = time.sleep,
) -> bool:
    """Sweep the surfaces; return False if the vehicle was armed, and nothing moved on."""
    move = _px4 if px4 else _ardupilot
    try:
        for position in positions(strokes, seconds):
            if link.motors_armed():
                return False
            move(link, position)
            link.recv_match(type="HEARTBEAT", blocking=False)
            sleep(1.0 / RATE_HZ)
    finally:
        if not px4:
            link.mav.rc_channels_override_send(link.target_system, link.target_component, *[RELEASED] * 8)
    return True


def _ardupilot(link: Any, position: float) -> None:
    pulses = [UNCHANGED] * 8
    for channel in ARDUPILOT_CHANNELS:
        pulses[channel] = round(1500 + 500 * position)
    link.mav.rc_channels_override_send(link.target_system, link.target_component, *pulses)


def _px4(link: Any, position: float) -> None:
    for servo in range(PX4_SERVOS):
        link.mav.command_long_send(
            link.target_system, link.target_component, mavlink.MAV_CMD_ACTUATOR_TEST, 0,
            position, 1.0, 0, 0, FIRST_SERVO + servo, 0, 0,
        )  # fmt: skip


def main() -> None:
    """Connect, set the mode, and sweep."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("link", help="as of pymavlink: udpin:0.0.0.0:14550, /dev/ttyACM0")
    parser.add_argument("--px4", action="store_true")
    parser.add_argument("--strokes", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=5.0, help="of a stroke from end to end")
    args = parser.parse_args()
    link: Any = mavutil.mavlink_connection(args.link)
    link.wait_heartbeat()
    if not args.px4:
        link.set_mode("MANUAL")
    done = sweep(link, px4=args.px4, strokes=args.strokes, seconds=args.seconds)
    print("swept" if done else "the vehicle is armed: nothing is swept in flight")


if __name__ == "__main__":
    main()
