"""What a hostile sender or a stalled reader can do to ``mavhums live``, and what it costs.

    python -m tests.live.attacks [NAME …]

starts ``mavhums live`` for each attack, and prints its resident memory, its share of a core in the
seconds after the attack, and the time from SIGTERM to its end.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as v2

from tests.live.programs import ENVIRONMENT, free_port, mavhums

HERE: Final = "127.0.0.1"
_QUIET_S: Final = 5.0
NUMBERS: Final = sorted(v2.mavlink_map)


@dataclass(frozen=True, slots=True)
class Attack:
    """Datagrams to send to the port, and how the program is started.

    Attributes
    ----------
    send
        Sends to a port of this computer; a crowd only one of each so many.
    arguments
        Of ``mavhums live``, after the link.
    reads
        Whether anybody reads the standard output.
    lasts
        Whether it is repeated until the program has ended.
    """

    send: Callable[[int, int], None]
    arguments: tuple[str, ...] = ("--json",)
    reads: bool = True
    lasts: bool = False


@dataclass(frozen=True, slots=True)
class Cost:
    """What an attack costs.

    Attributes
    ----------
    memory_mb
        Largest resident memory, MB.
    cpu
        Share of a core in the quiet seconds after the attack.
    shutdown_s
        From SIGTERM to the end of the program, s.
    """

    memory_mb: float
    cpu: float
    shutdown_s: float


def sent(message: v2.MAVLink_message, system: int, component: int = 1) -> bytes:
    return bytes(message.pack(v2.MAVLink(None, srcSystem=system, srcComponent=component)))


def heartbeat(system: int, component: int) -> bytes:
    return sent(v2.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3), system, component)


def attitude(system: int, component: int) -> bytes:
    return sent(v2.MAVLink_attitude_message(1000, 0, 0, 0, 0, 0, 0), system, component)


def random_message(rng: random.Random, k: int) -> bytes:
    """A message of a random kind with random or extreme numbers and a valid checksum; SYSTEM_TIME often."""
    number = 2 if k % 50 == 0 else rng.choice(NUMBERS)
    kind = v2.mavlink_map[number]
    size = struct.calcsize(kind.unpacker.format)
    fill = rng.random()
    payload = rng.randbytes(size) if fill < 0.8 else bytes([rng.choice((0, 0x7F, 0x80, 0xFF))]) * size
    message = v2.MAVLink_message(number, kind.msgname)
    voice = v2.MAVLink(None, srcSystem=rng.choice((1, 1, 1, 2, 9)), srcComponent=rng.choice((1, 1, 1, 7)))
    voice.seq = k % 256
    return bytes(message._pack(voice, kind.crc_extra, payload))


def named(system: int) -> bytes:
    return sent(v2.MAVLink_statustext_message(6, b"mavhums airframe=paper"), system)


def flown(system: int, time_us: int) -> Iterator[bytes]:
    """Telemetry of four actuators at one time."""
    voice = v2.MAVLink(None, srcSystem=system, srcComponent=1)
    for servo in range(1, 5):
        values = [float(time_us % 97) + k for k in range(12)] + [0.0] * 46
        yield bytes(v2.MAVLink_debug_float_array_message(time_us, b"EMA", servo, values).pack(voice))


def pour(port: int, datagrams: Iterator[bytes], pause_every: int = 100) -> None:
    """Send from one port, about as fast as they can be taken."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for k, datagram in enumerate(datagrams):
            out.sendto(datagram, (HERE, port))
            if k % pause_every == pause_every - 1:
                time.sleep(0.002)


def every_sender_as_a_vehicle(port: int, every: int) -> None:
    pour(port, itertools.starmap(attitude, itertools.product(range(1, 256), range(0, 256, every))))


def every_vehicle_by_name(port: int, _: int) -> None:
    pour(port, (frame for system in range(1, 256) for frame in (named(system), attitude(system, 1))))


def every_vehicle_flies(port: int, every: int) -> None:
    """255 vehicles with the telemetry of four actuators each, 12 s of flight at 5 Hz."""
    pour(port, (named(system) for system in range(1, 256)))
    moments = itertools.product(range(0, 12_000_000 // every, 200_000), range(1, 256))
    pour(port, (frame for time_us, system in moments for frame in flown(system, time_us)), 40)


def every_port(port: int, every: int) -> None:
    """A heartbeat of vehicle 1 from each of 20,000 source ports, and garbage from as many."""
    for k in range(20_000 // every):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            out.sendto(attitude(1, 1), (HERE, port))
            out.sendto(b"\xfd\xff garbage", (HERE, port))
        if k % 100 == 0:
            time.sleep(0.002)


def noise(port: int, every: int) -> None:
    pour(port, (os.urandom(200) for _ in range(50_000 // every)))


def nothing(port: int, _: int) -> None:
    """Only the vehicle speaks."""


ATTACKS: Final[dict[str, Attack]] = {
    "nothing": Attack(nothing),
    "an attitude from each of 65,280 senders": Attack(every_sender_as_a_vehicle),
    "the same, a profile given": Attack(every_sender_as_a_vehicle, ("--json", "--airframe", "paper")),
    "255 vehicles that name a profile": Attack(every_vehicle_by_name),
    "255 vehicles that fly": Attack(every_vehicle_flies),
    "40,000 source ports": Attack(every_port, ("--json", "--alerts")),
    "10 MB of noise": Attack(noise),
    "nobody reads standard output": Attack(every_vehicle_flies, reads=False),
    "ever new senders without end": Attack(every_sender_as_a_vehicle, lasts=True),
}


def endure(attack: Attack, folder: Path, *, every: int = 1, quiet_s: float = _QUIET_S) -> Cost:
    """Attack a program that listens on the loopback, and return what that cost it."""
    port = free_port()
    command = mavhums("live", f"udpin:{port}", "--record", folder / "live.tlog", *attack.arguments)
    out = folder / "out"
    reader, writer = os.pipe()
    with out.open("wb") as file, (folder / "err").open("wb") as err:
        program = subprocess.Popen(
            command, stdout=file if attack.reads else writer, stderr=err, cwd=folder, env=ENVIRONMENT
        )
    os.close(writer)
    try:
        _await_listening(program, port)
        attack.send(port, every)
        over = threading.Event()
        if attack.lasts:
            again = threading.Thread(target=_repeat, args=(attack, port, every, over), daemon=True)
            again.start()
        else:
            _await_quiet(program.pid)
        before_s = _used_s(program.pid)
        time.sleep(quiet_s)
        used_s = _used_s(program.pid) - before_s
        memory_mb = _peak_mb(program.pid)
        began = time.monotonic()
        program.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            program.wait(timeout=60)
        shutdown_s = time.monotonic() - began
        over.set()
    finally:
        if program.poll() is None:
            program.kill()
        program.wait()
        os.close(reader)
    return Cost(memory_mb, used_s / quiet_s, shutdown_s)


def _await_listening(program: subprocess.Popen[bytes], port: int) -> None:
    """Wait until the port is bound."""
    until = time.monotonic() + 120
    while f":{port:04X} " not in Path("/proc/net/udp").read_text():
        assert program.poll() is None, "it ended before it listened"
        assert time.monotonic() < until, "it does not listen"
        time.sleep(0.1)
    time.sleep(1.0)


def _repeat(attack: Attack, port: int, every: int, over: threading.Event) -> None:
    while not over.is_set():
        attack.send(port, every)


def _await_quiet(pid: int) -> None:
    """Wait until what was sent is worked off, at most 20 s."""
    for _ in range(20):
        before_s = _used_s(pid)
        time.sleep(1.0)
        if _used_s(pid) - before_s < 0.1:
            return


def _used_s(pid: int) -> float:
    """Return the CPU time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _peak_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    return next(int(line.split()[1]) / 1e3 for line in status.splitlines() if line.startswith("VmHWM"))


def main(names: list[str]) -> None:
    print(f"{'attack':45} {'memory, MB':>10} {'CPU after':>10} {'shutdown, s':>12}")
    for name, attack in ATTACKS.items():
        if not names or name in names:
            with tempfile.TemporaryDirectory() as folder:
                cost = endure(attack, Path(folder))
            print(f"{name:45} {cost.memory_mb:10.0f} {cost.cpu:10.1%} {cost.shutdown_s:12.2f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
