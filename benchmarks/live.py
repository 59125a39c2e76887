"""Cost of a live session: messages per second, processor load, latency, memory.

    python benchmarks/live.py [--hours 10] [--only throughput,share,memory]

throughput  records of a simulated flight through the engine, and through all of a session, on one
            core: in batches of 10,000 messages (100 ms at 100,000 a second) and of 100 ms of flight
share       `mavhums live` beside an aircraft of eight actuators, 100 Hz each, in real time: its CPU
            time, and the time from the arrival of the datagram that completes a window (the
            actuator's first sample at or after the window's end) to the window's line of JSON
memory      hours of flight at the highest speed through a session: resident memory over time
"""

from __future__ import annotations

import argparse
import json
import os
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console
from rich.table import Table

from mavhums import Engine, EngineOptions, load_airframe, read_log
from mavhums.learn import default_model
from mavhums.live.session import Session
from mavhums.live.status import Reception
from mavhums.log.mavlink.dialect import load_dialect
from mavhums.log.mavlink.signing import SignatureGuard
from mavhums.log.mavlink.stamping import Piece, Stamper
from mavhums_sim import Flight, fly
from mavhums_sim.link import Link, transmit
from mavhums_sim.stream import stream
from mavhums_sim.telemetry import messages

ROOT = Path(__file__).parents[1]
PORT = 15_773
KEY = bytes(range(32))
DEBUG_FLOAT_ARRAY = 350
Row = tuple[str, str, str]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, default=60.0, help="of the share's flight")
    parser.add_argument("--only", default="throughput,share,memory")
    parser.add_argument("--send", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.send:
        send(options.seconds)
        return
    parts: dict[str, Callable[[], Iterator[Row]]] = {
        "throughput": throughput,
        "share": lambda: share(options.seconds),
        "memory": lambda: memory(options.hours),
    }
    console = Console(width=120)
    console.print(f"load of the machine before: {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    table = Table("what", "measured", "goal", box=None, header_style="bold", pad_edge=False)
    for name in options.only.split(","):
        with console.status(name):
            for row in parts[name]():
                table.add_row(*row)
    console.print(table)


def pieces(duration_s: float, rate_hz: float = 100.0, key: bytes | None = None) -> list[Piece]:
    record = fly(Flight(seed=1, duration_s=duration_s, rate_hz=rate_hz))
    frames = transmit(messages(record), Link(key=key), 1)
    return [Piece("vehicle", frame.received_us, frame.data) for frame in frames]


def session(key: bytes | None = None) -> Session:
    stamper = Stamper(load_dialect(), SignatureGuard(key) if key else None)
    return Session(Engine(EngineOptions(models=[default_model()])), Reception(stamper))


def throughput() -> Iterator[Row]:
    plain, signed = pieces(100.0), pieces(100.0, key=KEY)
    for name, several, key in (("", plain, None), (", signed", signed, KEY)):
        whole = measured(several, 10_000, key)
        goal = "" if key else "≥ 100,000"
        yield (f"session, batches of 10,000 messages{name}: messages/s to verdict", f"{whole:,.0f}", goal)
    rate = measured(plain, 51)
    yield (
        "session, batches of 100 ms of flight (51 messages): messages/s to verdict",
        f"{rate:,.0f} ({rate * 100 / len(plain):,.0f} × real time)",
        "",
    )


def measured(several: list[Piece], batch: int, key: bytes | None = None) -> float:
    """Return the best of three runs, messages a second."""
    best = 0.0
    for _ in range(3):
        live = session(key)
        begin = time.process_time()
        for k in range(0, len(several), batch):
            live.take(several[k : k + batch])
        live.close()
        best = max(best, len(several) / (time.process_time() - begin))
    return best


def share(seconds: float) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        recording, lines = Path(folder) / "live.tlog", Path(folder) / "lines"
        command = [sys.executable, "-m", "mavhums", "live", f"udpin:{PORT}", "--json", "--record", recording]
        command += ["--airframe", write_profile(Path(folder))]
        with lines.open("w") as out:
            live = subprocess.Popen([str(part) for part in command], stdout=out)
        while not lines.stat().st_size:
            time.sleep(0.1)
        sender = subprocess.Popen([sys.executable, __file__, "--send", "--seconds", str(seconds)])
        while recording.stat().st_size < 100_000:
            time.sleep(0.1)
        process = psutil.Process(live.pid)
        before, begin = process.cpu_times(), time.monotonic()
        sender.wait()
        used, elapsed = process.cpu_times(), time.monotonic() - begin
        resident = process.memory_info().rss
        live.terminate()
        live.wait()
        objects = [json.loads(line) for line in lines.read_text().splitlines()]
        latency_ms = latencies(recording, objects)
    cpu = (used.user + used.system - before.user - before.system) / elapsed
    link = objects[-1]["link"]
    yield ("8 actuators at 100 Hz: share of a core", f"{cpu:.1%} over {elapsed:.0f} s", "≤ 5 %")
    p50, p99 = np.percentile(latency_ms, [50, 99])
    yield (
        "datagram to verdict event, p50 / p99",
        f"{p50:.0f} / {p99:.0f} ms of {latency_ms.size} windows, greatest {latency_ms.max():.0f} ms",
        "p99 ≤ 150 ms",
    )
    yield ("resident memory then", f"{resident / 1e6:.0f} MB", "")
    yield (
        "frames; missing; dropped",
        f"{link['frames']:,}; {link['missing_frames']}; {link['dropped_datagrams']}",
        "",
    )


def latencies(recording: Path, objects: list[dict[str, object]]) -> np.ndarray:
    """Return, for each window, the time from the datagram that completed it to its line, ms."""
    log = read_log(recording, messages=["DEBUG_FLOAT_ARRAY"])
    table = log.tables["DEBUG_FLOAT_ARRAY"]
    first_us = log.span[0] if log.span else 0
    sent_us, arrived_us = table["time_usec"].astype(np.int64), table.time_us
    flight_s = (sent_us + (arrived_us[0] - sent_us[0]) - first_us) / 1e6
    out = []
    for servo, actuator in enumerate(actuator_names(), start=1):
        rows = np.flatnonzero(table["array_id"] == servo)
        for line in objects:
            if line["event"] == "window" and line["actuator"] == actuator:
                k = int(np.searchsorted(flight_s[rows], float(str(line["end_s"]))))
                if k < rows.size:
                    written = np.datetime64(str(line["utc"])[:-6], "us").astype(np.int64)
                    out.append((written - arrived_us[rows[k]]) / 1e3)
    return np.array(out)


def actuator_names() -> list[str]:
    return [actuator.name for actuator in load_airframe(write_profile(Path(tempfile.mkdtemp()))).actuators]


def write_profile(folder: Path) -> str:
    """Write the packaged profile with each of its four actuators twice, and return the path."""
    packaged = resources.files("mavhums.actuator") / "airframes" / "paper.toml"
    head, *blocks = packaged.read_text(encoding="utf-8").split("[[actuators]]")
    for block in blocks[:4]:
        again = re.sub(r'^name = "(.*)"', r'name = "\1_2"', block, flags=re.M)
        again = re.sub(r"^(servo|esc) = (\d+)", lambda m: f"{m[1]} = {int(m[2]) + 4}", again, flags=re.M)
        blocks.append(again)
    path = folder / "eight.toml"
    path.write_text("[[actuators]]".join([head.replace('"paper"', '"eight"'), *blocks]), encoding="utf-8")
    return str(path)


def twice(message: Any) -> list[Any]:
    """Return the telemetry of an aircraft with eight actuators: that of four, twice."""
    name = message.get_type()
    if name == "DEBUG_FLOAT_ARRAY":
        return [
            message,
            mavlink.MAVLink_debug_float_array_message(
                message.time_usec, b"EMA", message.array_id + 4, message.data
            ),
        ]
    if name == "ESC_TELEMETRY_1_TO_4":
        fields = [getattr(message, field) for field in message.fieldnames]
        return [message, mavlink.MAVLink_esc_telemetry_5_to_8_message(*fields)]
    if name == "SERVO_OUTPUT_RAW":
        for k in range(1, 5):
            setattr(message, f"servo{k + 4}_raw", getattr(message, f"servo{k}_raw"))
    return [message]


def send(seconds: float) -> None:
    """Fly eight actuators in real time."""
    record = fly(Flight(seed=2, duration_s=seconds))
    voice = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = []
    for frame, (_, message) in zip(transmit(messages(record), Link(), 2), messages(record), strict=True):
        for one in twice(message):
            frames.append(frame._replace(data=bytes(one.pack(voice)), name=one.get_type()))
            voice.seq = (voice.seq + 1) % 256
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        stream(frames, lambda data: out.sendto(data, ("127.0.0.1", PORT)))


def memory(hours: float) -> Iterator[Row]:
    minute = pieces(60.0, rate_hz=50.0)
    live = session()
    process = psutil.Process()
    samples: list[tuple[float, float]] = []
    begin = time.process_time()
    for number in range(round(hours * 60)):
        shifted = [shift(piece, number * 60_000_000) for piece in minute]
        for k in range(0, len(shifted), 280):
            live.take(shifted[k : k + 280])
        live.tick()
        samples.append((number / 60, process.memory_info().rss / 1e6))
    spent = time.process_time() - begin
    settled = np.array([sample for sample in samples if sample[0] >= hours / 5])
    slope = np.polyfit(settled[:, 0], settled[:, 1], 1)[0]
    verdict = ", ".join(f"{v.actuator} {v.condition}" for v in live.close().verdicts)
    grown = f"{settled[0, 1]:.0f} → {settled[-1, 1]:.0f} MB, {slope:+.2f} MB per flight hour"
    yield (
        f"{hours:g} h of flight, 4 actuators at 50 Hz, {len(minute) * hours * 60 / 1e6:.1f} million messages",
        f"{grown}; {spent:.0f} s of CPU",
        "no slope",
    )
    yield ("its verdicts", verdict, "")


CLOCKS = {350: (10, 8, 1), 36: (10, 4, 1), 30: (10, 4, 1000)}
"""Of messages that carry the sender's clock: its offset in the frame, its bytes, µs per unit."""


def shift(piece: Piece, by_us: int) -> Piece:
    """Return the same datagram with later times of sending and reception, and a new CRC."""
    data = piece.data
    place = CLOCKS.get(data[7] | data[8] << 8 | data[9] << 16)
    if place is not None and by_us:
        offset, size, unit = place
        frame = bytearray(data)
        sent = int.from_bytes(frame[offset : offset + size], "little") + by_us // unit
        frame[offset : offset + size] = (sent % 2 ** (8 * size)).to_bytes(size, "little")
        number = frame[7] | frame[8] << 8
        extra = load_dialect().definitions[number].crc_extra
        frame[-2:] = struct.pack("<H", crc16.mcrf4xx(bytes(frame[1:-2]) + bytes([extra])))
        data = bytes(frame)
    return piece._replace(time_us=piece.time_us + by_us, data=data)


if __name__ == "__main__":
    main()
