"""Decode one synthetic log with mavhums and its peers, each in a process of its own, and print the table.

    python benchmarks/decode.py [--format tlog] [--megabytes 100] [--large 2000] [--fasttlogparser PYTHON]
    python benchmarks/decode.py --format dataflash [--log FLIGHT.BIN]
    python benchmarks/decode.py --format ulog [--log FLIGHT.ulg]

``PYTHON`` is an interpreter that has fasttlogparser and pandas, by default this one. CPU seconds of
the best of ``--repeat`` runs after one that warms caches (pymavlink: one run). To pandas throughout.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks import _dataflash, _decode_ulog

NEEDED = ["ATTITUDE", "DEBUG_FLOAT_ARRAY", "ESC_TELEMETRY_1_TO_4", "SERVO_OUTPUT_RAW"]
STATES = ("cold", "cached")  # of the compiled loops at a first call
START_US = 1_700_000_000_000_000
ROUND = 5120
MIX = {
    "ATTITUDE": 10,
    "GLOBAL_POSITION_INT": 10,
    "SERVO_OUTPUT_RAW": 10,
    "ESC_TELEMETRY_1_TO_4": 6,
    "VFR_HUD": 8,
    "RC_CHANNELS": 6,
    "RAW_IMU": 6,
    "SYS_STATUS": 5,
    "GPS_RAW_INT": 5,
    "NAV_CONTROLLER_OUTPUT": 5,
    "SCALED_PRESSURE": 5,
    "NAMED_VALUE_FLOAT": 5,
    "BATTERY_STATUS": 4,
    "VIBRATION": 4,
    "EKF_STATUS_REPORT": 4,
    "PARAM_VALUE": 2,
    "HEARTBEAT": 2,
    "DEBUG_FLOAT_ARRAY": 1,
    "STATUSTEXT": 1,
}


def one_round(seed: int = 1) -> list[bytes]:
    """Frames of one vehicle: half MAVLink 2, a third MAVLink 1, the rest signed or unknown."""
    from pymavlink.dialects.v10 import ardupilotmega as v1
    from pymavlink.dialects.v20 import ardupilotmega as v2
    from pymavlink.generator.mavcrc import x25crc

    rng = random.Random(seed)
    frames = []
    names = list(MIX)
    for k in range(ROUND):
        name = rng.choices(names, list(MIX.values()))[0]
        form = rng.choices(["v2", "v1", "signed", "unknown"], [50, 30, 18, 2])[0]
        dialect = v2
        if form == "v1" and getattr(v2, f"MAVLINK_MSG_ID_{name}") < 256:
            dialect = v1
        link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        link.seq = k % 256
        if form == "signed":
            link.signing.secret_key = bytes(range(32))
            link.signing.sign_outgoing = True
            link.signing.timestamp = 1000 + k
        if form == "unknown":
            head = bytes([20, 0, 0, k % 256, 1, 1]) + (60_000).to_bytes(3, "little") + rng.randbytes(20)
            crc = x25crc(head + b"\x2a").crc
            frames.append(b"\xfd" + head + struct.pack("<H", crc))
            continue
        kind = getattr(dialect, f"MAVLink_{name.lower()}_message")
        frames.append(bytes(kind(*_values(kind, rng)).pack(link)))
    return frames


def _values(kind: Any, rng: random.Random) -> list[Any]:
    """Field values as in flight: small integers, so that some payloads end in zeros and are truncated."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    out: list[Any] = []
    for field, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        count = lengths[field]
        if type_ == "char":
            out.append(rng.choice([b"EMA", b"S1Pos", b"SERVO1_MIN"])[: max(count, 1)])
            continue
        size = int("".join(c for c in type_ if c.isdigit()) or 32)
        top = 2 ** (size - 1) - 1 if size < 64 else 2**40
        draw = [
            rng.uniform(-100, 100) if type_ in ("float", "double") else rng.choice([0, rng.randint(0, top)])
            for _ in range(count or 1)
        ]
        out.append(draw if count else draw[0])
    return out


def write_log(path: Path, megabytes: int) -> int:
    """Write rounds of the same frames under ever later time stamps; return the number of frames."""
    import numpy as np

    frames = one_round()
    block = np.frombuffer(b"".join(bytes(8) + frame for frame in frames), dtype=np.uint8).copy()
    sizes = np.array([8 + len(frame) for frame in frames])
    places = (np.cumsum(sizes) - sizes)[:, None] + np.arange(8)
    rounds = max(1, round(megabytes * 1e6 / block.size))
    with path.open("wb") as file:
        for k in range(rounds):
            times = START_US + 4000 * (k * ROUND + np.arange(ROUND, dtype=np.int64))
            block[places] = times.astype(">u8").view(np.uint8).reshape(-1, 8)
            file.write(block.tobytes())
    return rounds * ROUND


def _needed(path: str) -> list[str]:
    return NEEDED if path.endswith(".tlog") else _dataflash.NEEDED


def mavhums(path: str, needed: bool) -> int:
    from mavhums import read_log

    log = read_log(path, messages=_needed(path) if needed else None)
    return sum(len(frame) for frame in log.messages.values())


def pymavlink(path: str, needed: bool) -> int:
    os.environ["MAVLINK20"] = "1"
    import pandas as pd
    from pymavlink import mavutil

    connection = mavutil.mavlink_connection(path, dialect="ardupilotmega")
    columns: dict[str, list[Any]] = {}
    while (message := connection.recv_match(type=NEEDED if needed else None)) is not None:
        name = message.get_type()
        if name != "BAD_DATA" and not name.startswith("UNKNOWN_"):
            row = [message._timestamp, *(getattr(message, field) for field in message.fieldnames)]
            columns.setdefault(name, [message.fieldnames]).append(row)
    frames = [pd.DataFrame(rows, columns=["time", *fields]) for fields, *rows in columns.values()]
    return sum(len(frame) for frame in frames)


def fasttlogparser(path: str, needed: bool) -> int:
    import pandas as pd
    from fasttlogparser import parseTLog  # type: ignore[import-not-found]

    messages, _ = parseTLog(path, whitelist=NEEDED) if needed else parseTLog(path)
    frames = []
    for columns in messages.values():
        flat: dict[str, Any] = {}
        for name, values in columns.items():
            if getattr(values, "ndim", 1) > 1:
                flat |= {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}
            else:
                flat[name] = values
        frames.append(pd.DataFrame(flat, copy=False))
    return sum(len(frame) for frame in frames)


def memory(path: str, _: bool) -> int:
    return _decode_ulog.growth(path, b"\0" * 100, _needed(path))


def first_call(path: str, _: bool) -> int:
    from mavhums.log import read_log

    return sum(read_log(path).counts.values())


TASKS = {
    task.__name__: task
    for task in (mavhums, pymavlink, fasttlogparser, memory, first_call, _dataflash.dfreader)
}
PEERS = {"tlog": ("pymavlink", "fasttlogparser"), "dataflash": ("dfreader",)}
"""The peers of each format, first the one that the ratio is of."""


def run_task(task: str, path: str, needed: bool, repeat: int) -> None:
    """Run one task in this process and print its figures as JSON."""
    best: dict[str, float] = {}
    for _ in range(repeat):
        cpu, wall = time.process_time(), time.perf_counter()
        result = TASKS[task](path, needed)
        found = {"cpu_s": time.process_time() - cpu, "wall_s": time.perf_counter() - wall, "result": result}
        if not best or found["cpu_s"] < best["cpu_s"]:
            best = found
    print(json.dumps(best))


def measure(
    task: str,
    path: Path,
    *,
    needed: bool = False,
    repeat: int = 1,
    python: str = sys.executable,
    environment: dict[str, str] | None = None,
) -> dict[str, Any] | None:
    command = [python, __file__, "--task", task, "--path", str(path), "--repeat", str(repeat)]
    done = subprocess.run(
        [*command, "--needed"] if needed else command,
        capture_output=True,
        check=False,
        text=True,
        env=os.environ | (environment or {}),
    )
    if done.returncode:
        print(f"{task}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return None
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def compare(path: Path, peers: tuple[str, ...], repeat: int, python: str) -> None:
    size = path.stat().st_size / 1e6
    print(f"{path.name}: {size:.1f} MB")
    print(f"{'':28}{'CPU s':>8}{'wall s':>8}{'MB/s':>8}{'messages':>11}{'messages/s':>13}{'ratio':>8}")
    for needed in (False, True):
        what = "needed types" if needed else "all types"
        first, *others = peers
        rows = {first: measure(first, path, needed=needed)}
        rows |= {peer: measure(peer, path, needed=needed, repeat=repeat, python=python) for peer in others}
        rows["mavhums"] = measure("mavhums", path, needed=needed, repeat=repeat + 1)
        slowest = rows[first]
        for name, row in rows.items():
            if row is None:
                print(f"{name + ', ' + what:28}{'not installed':>16}")
                continue
            cpu = row["cpu_s"]
            ratio = f"{slowest['cpu_s'] / cpu:8.1f}" if slowest else ""
            print(
                f"{name + ', ' + what:28}{cpu:8.3f}{row['wall_s']:8.3f}{size / cpu:8.1f}"
                f"{row['result']:11,}{row['result'] / cpu:13,.0f}{ratio}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--format", choices=[*PEERS, "ulog"], default="tlog")
    parser.add_argument("--log", type=Path, help="compare on this log instead of a synthetic one")
    parser.add_argument("--megabytes", type=int, default=100)
    parser.add_argument("--large", type=int, default=2000, help="megabytes of the second memory measurement")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--fasttlogparser", default=sys.executable, metavar="PYTHON")
    parser.add_argument("--task", choices=TASKS, help=argparse.SUPPRESS)
    parser.add_argument("--path", help=argparse.SUPPRESS)
    parser.add_argument("--needed", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.format == "ulog":
        _decode_ulog.section(options.megabytes, options.large, options.repeat, options.log)
        return
    if options.task:
        run_task(options.task, options.path, options.needed, options.repeat)
        return
    with tempfile.TemporaryDirectory() as folder:
        suffix, write = (".tlog", write_log) if options.format == "tlog" else (".BIN", _dataflash.write_log)
        path, small = Path(folder) / f"synthetic{suffix}", Path(folder) / f"small{suffix}"
        if options.log is None:
            write(path, options.megabytes)
        compare(options.log or path, PEERS[options.format], options.repeat, options.fasttlogparser)
        write(small, 0)
        environment = {"NUMBA_CACHE_DIR": str(Path(folder) / "cache")}
        for state in STATES:
            row = measure("first_call", small, environment=environment)
            if row:
                print(f"first call, {state}: {row['wall_s']:.2f} s, with imports")
        for megabytes in (options.megabytes, options.large):
            write(path, megabytes)
            row = measure("memory", path)
            if row:
                mebibytes = row["result"] / 2**20
                print(f"anonymous memory above the imports, {megabytes} MB: {mebibytes:.0f} MiB")


if __name__ == "__main__":
    main()
