"""Follow a vehicle over UDP and print each change of an actuator's condition.

    python examples/follow_udp.py 14550 [AIRFRAME]

The engine takes the records of a .tlog: eight bytes of time, then a frame. So each frame of a datagram
is stamped with the time of its reception. The verdicts are printed when nothing came for 30 s. It shows
how the engine is fed; ``mavhums live`` does it in earnest, with half frames, damage, recording and alerts.
"""

from __future__ import annotations

import socket
import sys
import time
from collections.abc import Callable, Iterator

import mavhums
from mavhums.health.decision.events import ConditionChanged

IDLE_S = 30.0


def main(port: int, airframe: str | None = None) -> None:
    """Process the datagrams of a UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("", port))
        link.settimeout(IDLE_S)
        print(follow(link, airframe).summary())


def follow(
    link: socket.socket, airframe: str | None = None, clock_ns: Callable[[], int] = time.time_ns
) -> mavhums.Assessment:
    """Feed the engine from a socket until it is silent for its time-out."""
    engine = mavhums.Engine(mavhums.Options(airframe=airframe).resolved())
    while True:
        try:
            datagram = link.recv(65535)
        except TimeoutError:
            engine.finish()
            return engine.assessment()
        stamp = (clock_ns() // 1000).to_bytes(8, "big")
        for event in engine.feed(b"".join(stamp + frame for frame in frames(datagram))):
            if isinstance(event, ConditionChanged):
                print(f"{event.since_s:6.0f} s  {event.actuator}: {event.before} → {event.after}", flush=True)


def frames(datagram: bytes) -> Iterator[bytes]:
    """Divide a datagram into its MAVLink 1 and 2 frames; other bytes are one piece."""
    while len(datagram) > 2:
        size = len(datagram)
        if datagram[0] == 0xFE:
            size = 8 + datagram[1]
        elif datagram[0] == 0xFD:
            size = 12 + datagram[1] + (13 if datagram[2] & 1 else 0)
        yield datagram[:size]
        datagram = datagram[size:]


if __name__ == "__main__":
    if len(sys.argv) < 2 or not sys.argv[1].isdecimal():
        sys.exit("usage: follow_udp.py PORT [AIRFRAME]")
    try:
        main(int(sys.argv[1]), *sys.argv[2:3])
    except mavhums.MavhumsError as error:
        sys.exit(str(error))
