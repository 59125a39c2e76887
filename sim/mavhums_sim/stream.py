"""Live streaming of a flight: sends its frames over a link in real time."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from pymavlink import mavutil

from mavhums_sim.link import Frame

_URL = re.compile(r"(udpout|udpbcast|tcp|tcpin):[^:\s]+:\d{1,5}")


@contextmanager
def connect(url: str) -> Iterator[Callable[[bytes], object]]:
    """Open a pymavlink connection and return its ``write``.

    Parameters
    ----------
    url
        ``udpout:HOST:PORT``, ``udpbcast:…``, ``tcp:…`` or ``tcpin:…``.

    Raises
    ------
    ValueError
        If the address has none of these forms.
    OSError
        If the address does not answer.
    """
    if not _URL.fullmatch(url):
        raise ValueError(f"{url!r} is not udpout:HOST:PORT, udpbcast:…, tcp:… or tcpin:…")
    connection = mavutil.mavlink_connection(url, retries=1)
    try:
        yield connection.write
    finally:
        connection.close()


def stream(
    frames: Iterable[Frame],
    write: Callable[[bytes], object],
    speed: float = 1.0,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], object] = time.sleep,
) -> dict[str, int]:
    """Write each frame at its time and return the number of messages by type.

    Parameters
    ----------
    speed
        Flight seconds per second, limited by the speed of the machine.
    """
    counts: dict[str, int] = {}
    begin = clock()
    first_us: int | None = None
    for frame in frames:
        first_us = frame.received_us if first_us is None else first_us
        wait_s = begin + (frame.received_us - first_us) * 1e-6 / speed - clock()
        if wait_s > 0.0:
            sleep(wait_s)
        write(frame.data)
        counts[frame.name] = counts.get(frame.name, 0) + 1
    return counts
