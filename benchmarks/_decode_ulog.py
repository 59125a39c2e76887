"""The ULog section of ``decode.py``: one synthetic log with the topics of a PX4 flight, ours and pyulog.

    python benchmarks/_decode_ulog.py [--megabytes 60] [--large 1000] [--log FLIGHT.ulg]

CPU seconds of the best of ``--repeat`` runs after one that warms caches, each reader in a process of its
own, to pandas throughout. With ``--log`` a real log's data section is repeated until it has that size.
"""

from __future__ import annotations

import argparse
import json
import random
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NEEDED = [
    "actuator_outputs",
    "airspeed",
    "esc_status",
    "vehicle_attitude",
    "vehicle_attitude_setpoint",
    "vehicle_land_detected",
    "vehicle_rates_setpoint",
    "vehicle_status",
]
ESC = "uint64_t timestamp;uint32_t esc_errorcount;int32_t esc_rpm;float esc_voltage;float esc_current;"
MIX = {
    "actuator_motors": (10, "uint64_t timestamp_sample;float[12] control;"),
    "actuator_outputs": (10, "uint32_t noutputs;float[16] output;uint8_t[4] _padding0;"),
    "actuator_servos": (10, "uint64_t timestamp_sample;float[8] control;"),
    "airspeed": (10, "float indicated;float true;float temperature;float confidence;"),
    "battery_status": (5, "float voltage_v;float current_a;float[14] voltage_cell_v;uint8_t connected;"),
    "cpuload": (2, "float load;float ram_usage;"),
    "esc_status": (10, "uint16_t counter;uint8_t esc_count;uint8_t[5] _padding0;esc_report[8] esc;"),
    "estimator_innovations": (10, "float[40] all;"),
    "estimator_states": (10, "uint64_t timestamp_sample;float[25] states;uint8_t n_states;"),
    "rate_ctrl_status": (5, "float rollspeed_integ;float pitchspeed_integ;float yawspeed_integ;"),
    "sensor_accel": (50, "uint64_t timestamp_sample;float x;float y;float z;float temperature;"),
    "sensor_combined": (200, "float[3] gyro_rad;uint32_t dt;float[3] accelerometer;uint8_t clipping;"),
    "vehicle_acceleration": (50, "uint64_t timestamp_sample;float[3] xyz;"),
    "vehicle_angular_velocity": (50, "uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative;"),
    "vehicle_attitude": (20, "float[4] q;float[4] delta_q_reset;uint8_t quat_reset_counter;"),
    "vehicle_attitude_setpoint": (20, "float yaw_sp_move_rate;float[4] q_d;float[3] thrust_body;"),
    "vehicle_gps_position": (5, "uint64_t time_utc_usec;int32_t lat;int32_t lon;uint8_t fix_type;"),
    "vehicle_land_detected": (1, "bool freefall;bool ground_contact;bool maybe_landed;bool landed;"),
    "vehicle_local_position": (10, "float x;float y;float z;float vx;float vy;float vz;float[12] more;"),
    "vehicle_rates_setpoint": (50, "float roll;float pitch;float yaw;float[3] thrust_body;"),
    "vehicle_status": (2, "uint64_t armed_time;uint8_t nav_state;uint8_t arming_state;"),
}
"""Topics of a fixed wing with the logger's default profile: rate in Hz, fields behind ``timestamp``."""

SIZES = {"uint64_t": 8, "uint32_t": 4, "int32_t": 4, "uint16_t": 2, "float": 4, "bool": 1, "uint8_t": 1}
ROUND_US = 10_000_000


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def size_of(fields: str) -> int:
    """Bytes of a record behind its time stamp."""
    total = 0
    for field in fields.split(";"):
        kind, _, name = field.partition(" ")
        kind, _, count = kind.partition("[")
        size = 8 + size_of(ESC[len("uint64_t timestamp;") :]) if kind == "esc_report" else SIZES.get(kind, 0)
        total += (
            0 if name.startswith("_padding") and fields.endswith(field + ";") else size * int(count[:-1] or 1)
        )
    return total


def head() -> bytes:
    """Return the definitions: formats, a thousand parameters, subscriptions."""
    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    out += message("F", f"esc_report:{ESC}".encode())
    for name, (_, fields) in MIX.items():
        out += message("F", f"{name}:uint64_t timestamp;{fields}".encode())
    for k in range(1000):
        key = f"float PARAMETER_{k}".encode()
        out += message("P", bytes([len(key)]) + key + struct.pack("<f", k))
    for number, name in enumerate(MIX):
        out += message("A", struct.pack("<BH", 0, number) + name.encode())
    return out


def one_round(seed: int = 1) -> tuple[bytes, list[int]]:
    """Return ten seconds of data, and where its time stamps are."""
    rng = random.Random(seed)
    due: list[tuple[int, bytes]] = []
    for number, (rate, fields) in enumerate(MIX.values()):
        size = size_of(fields)
        for k in range(rate * ROUND_US // 1_000_000):
            now = k * 1_000_000 // rate
            record = struct.pack("<HQ", number, now) + b"".join(
                struct.pack("<f", rng.uniform(-1, 1)) for _ in range(size // 4 + 1)
            )
            due.append((now, message("D", record[: 10 + size])))
    due += [(k * 500_000, message("S", b"\x2f\x73\x13\x20\x25\x0c\xbb\x12")) for k in range(20)]
    due.sort(key=lambda entry: entry[0])
    places, place = [], 0
    for _, body in due:
        if body[2:3] == b"D":
            places.append(place + 5)
        place += len(body)
    return b"".join(body for _, body in due), places


def write_log(path: Path, megabytes: int) -> None:
    """Write rounds of the same data under ever later time stamps."""
    import numpy as np

    data, stamps = one_round()
    block = np.frombuffer(data, dtype=np.uint8).copy()
    where = np.array(stamps)[:, None] + np.arange(8)
    first = block[where].copy().view("<u8").ravel()
    with path.open("wb") as file:
        file.write(head())
        for k in range(max(1, round(megabytes * 1e6 / block.size))):
            block[where] = (first + np.uint64(1_000_000 + k * ROUND_US)).view(np.uint8).reshape(-1, 8)
            file.write(block.tobytes())


def messages_of(log: bytes) -> Iterator[bytes]:
    place = 16
    while place + 3 <= len(log):
        end = place + 3 + int.from_bytes(log[place : place + 2], "little")
        if end <= len(log):
            yield log[place:end]
        place = end


def repeat_log(source: Path, path: Path, megabytes: int) -> None:
    """Write a real, undamaged log with its data section repeated."""
    log = source.read_bytes()
    defining = {b"B", b"F", b"I", b"M", b"P", b"Q", b"A"}
    parts = list(messages_of(log))
    data = b"".join(part for part in parts if part[2:3] not in defining)
    with path.open("wb") as file:
        file.write(log[:16] + b"".join(part for part in parts if part[2:3] in defining - {b"B"}))
        for _ in range(max(1, round(megabytes * 1e6 / len(data)))):
            file.write(data)


def mavhums(path: str, needed: bool) -> int:
    from mavhums import read_log

    log = read_log(path, messages=NEEDED if needed else None)
    return sum(len(table.to_frame()) for name, table in log.tables.items() if name != "parameter")


def pyulog(path: str, needed: bool) -> int:
    import pandas as pd
    from pyulog import ULog

    log = ULog(path, NEEDED if needed else None)
    return sum(len(pd.DataFrame(topic.data)) for topic in log.data_list)


def memory(path: str, _: bool) -> int:
    return growth(path, head(), NEEDED)


def growth(path: str, first: bytes, needed: list[str]) -> int:
    """Return the most anonymous memory above the imports while a log streams through the decoder, bytes."""
    from mavhums.log import Decoder, read_blocks

    Decoder().feed(first, final=True)
    decoder = Decoder(needed)
    before = peak = _anonymous()
    for block in read_blocks(path):
        decoder.feed(block)
        peak = max(peak, _anonymous())
    return peak - before


def _anonymous() -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("RssAnon"):
            return int(line.split()[1]) * 1024
    raise OSError("no RssAnon in /proc/self/status")


TASKS = {f.__name__: f for f in (mavhums, pyulog, memory)}


def run_task(task: str, path: str, needed: bool, repeat: int) -> None:
    """Run one task in this process and print its figures as JSON."""
    best: dict[str, float] = {}
    for _ in range(repeat):
        cpu = time.process_time()
        result = TASKS[task](path, needed)
        found = {"cpu_s": time.process_time() - cpu, "result": result}
        if not best or found["cpu_s"] < best["cpu_s"]:
            best = found
    print(json.dumps(best))


def measure(task: str, path: Path, *, needed: bool = False, repeat: int = 1) -> dict[str, Any]:
    command = [sys.executable, __file__, "--task", task, "--path", str(path), "--repeat", str(repeat)]
    done = subprocess.run(
        [*command, "--needed"] if needed else command, capture_output=True, check=True, text=True
    )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def compare(path: Path, repeat: int) -> None:
    size = path.stat().st_size / 1e6
    print(f"{path.name}: {size:.1f} MB")
    print(f"{'':28}{'CPU s':>8}{'MB/s':>8}{'records':>11}{'records/s':>13}{'ratio':>8}")
    for needed in (False, True):
        what = f"{len(NEEDED)} topics" if needed else "all topics"
        rows = {name: measure(name, path, needed=needed, repeat=repeat) for name in ("pyulog", "mavhums")}
        for name, row in rows.items():
            cpu = row["cpu_s"]
            print(
                f"{name + ', ' + what:28}{cpu:8.3f}{size / cpu:8.1f}{row['result']:11,}"
                f"{row['result'] / cpu:13,.0f}{rows['pyulog']['cpu_s'] / cpu:8.1f}"
            )


def section(megabytes: int = 60, large: int = 1000, repeat: int = 5, log: Path | None = None) -> None:
    """Print the table of ULog."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "synthetic.ulg"
        if log is None:
            write_log(path, megabytes)
        else:
            repeat_log(log, path, megabytes)
        compare(path, repeat)
        for size in (megabytes, large):
            write_log(path, size)
            mebibytes = measure("memory", path)["result"] / 2**20
            print(f"anonymous memory above the imports, {size} MB: {mebibytes:.0f} MiB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--megabytes", type=int, default=60)
    parser.add_argument("--large", type=int, default=1000, help="megabytes of the second memory measurement")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--log", type=Path, help="a real log to repeat instead of the synthetic one")
    parser.add_argument("--task", choices=TASKS, help=argparse.SUPPRESS)
    parser.add_argument("--path", help=argparse.SUPPRESS)
    parser.add_argument("--needed", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.task:
        run_task(options.task, options.path, options.needed, options.repeat)
    else:
        section(options.megabytes, options.large, options.repeat, options.log)


if __name__ == "__main__":
    main()
