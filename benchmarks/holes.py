"""Holes in the parameters of healthy logs: no alarm that the whole log has not.

Each parameter that the code reads is removed from a log, record by record, and so is each block of 512 and of
4,096 bytes in the part of the log that has the parameters, as a damaged card or a lossy download leaves it::

    python benchmarks/holes.py LOG …                  # all holes of each log
    python benchmarks/holes.py --every 8 LOG …        # every eighth hole
    python benchmarks/holes.py                        # a few holes of a simulated quad

Logs with an alarm of their own are left out. The exit status is 1 if a hole makes an alarm.
"""

from __future__ import annotations

import argparse
import gzip
import itertools
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mavhums import analyse
from mavhums.core.errors import MavhumsError
from mavhums.engine.axes import _FUNCTIONS as READ
from mavhums.vehicle.parameters import read_parameters
from mavhums_sim.multirotor.craft import draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import write_dataflash

SECTORS = (512, 4096)
_MOST = 4_000_000  # bytes: a longer log is left out
_ALARMS = ("emergency", "degraded")


def holes(log: bytes, names: list[str]) -> Iterator[tuple[str, bytes]]:
    """Yield what each hole removes, and the log with it."""
    found = {name: places for name in names if (places := [one.start() for one in _records(name, log)])}
    for name, places in found.items():
        if name.startswith(READ):
            hurt = bytearray(log)  # a name that nothing reads; in MAVLink a frame of a wrong checksum
            for at in places:
                hurt[at] = ord("~")
            yield name, bytes(hurt)
    first, last = min(map(min, found.values())), max(places[0] for places in found.values())
    for size in SECTORS:
        for at in range(max(first - first % size, size), last + 1, size):
            yield f"{size} B at {at}", log[:at] + b"\0" * size + log[at + size :]


def _records(name: str, log: bytes) -> Iterator[re.Match[bytes]]:
    """Yield where a log has a parameter: names end with a NUL, or in ULog follow the length of their key."""
    key = name.encode()
    ulog = b"|".join(
        b"(?<=%s)%s" % (re.escape(bytes([len(kind) + len(key)]) + kind), key)
        for kind in (b"float ", b"int32_t ")
    )
    yield from re.finditer(rb"(?<![A-Z0-9_])%s(?=\0)|%s" % (key, ulog), log)


def alarms(path: Path) -> set[tuple[str, str]]:
    """Return what a log alarms: subjects with their worst condition."""
    return {(one.actuator, one.worst) for one in analyse(path).verdicts if one.worst in _ALARMS}


def simulated(folder: Path) -> Path:
    """Write a healthy quad's log."""
    path = folder / "quad.BIN"
    rng = np.random.default_rng(3)
    write_dataflash(fly(draw_craft(rng, "quad x"), draw_plan(rng, 60.0), 3), path)
    return path


def run(path: Path, every: int = 1, offset: int = 0) -> tuple[int, list[str]]:
    """Return the number of holes that were made in a log, and those that make an alarm."""
    packed = path.read_bytes()
    log = gzip.decompress(packed) if path.suffix == ".gz" else packed
    if len(log) > _MOST or alarms(path):
        return 0, []
    count, wrong = 0, []
    name = path.name.removesuffix(".gz")
    with tempfile.TemporaryDirectory() as folder:
        hurt = Path(folder) / name
        for what, content in itertools.islice(
            holes(log, sorted(read_parameters(path).values)), offset, None, every
        ):
            hurt.write_bytes(content)
            count += 1
            try:
                found = alarms(hurt)
            except MavhumsError:
                continue
            wrong += [f"{what}: {subject} {condition}" for subject, condition in sorted(found)]
    return count, wrong


def main(arguments: list[str] | None = None) -> int:
    """Run the holes of all logs; return 1 if one makes an alarm."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take only each n-th hole")
    options = parser.parse_args(arguments)
    total, bad, logs = 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        small = not options.logs
        for path in options.logs or [simulated(Path(folder))]:
            try:
                count, wrong = run(path, 4 if small else options.every)
            except MavhumsError:
                continue
            logs, total, bad = logs + bool(count), total + count, bad + len(wrong)
            print(f"{path.name}: {count} holes, {len(wrong)} alarms", *wrong, sep="\n  ", flush=True)
    print(f"{logs} logs, {total} holes, {bad} alarms that the whole log has not")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
