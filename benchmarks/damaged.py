"""Damaged logs through every command that reads one: no traceback, no warning of numpy.

    python -m benchmarks.damaged [--seed N] [--count N] [LOG …]

makes ``--count`` damaged copies of each log, by default one log of each format, runs ``analyse``,
``inspect``, ``export``, ``report`` and ``analyse --rrd`` on each in this process, and prints what went wrong
with the seed of the copy. Damage: flipped bits, bursts of bytes, a cut end, removed and duplicated blocks,
and numbers in messages that become NaN, infinite or the greatest there are, with the right checksum.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import logging
import random
import struct
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavhums.cli.main import cli
from mavhums.core.errors import MavhumsError
from tests.log.ulog.writer import flown

DATA: Final = Path(__file__).parents[1] / "tests" / "data"
_KEPT_BYTES: Final = 160_000  # of a log: the commands take most of their time for the flight, not the damage
_MOST: Final = 20  # messages of one kind that get a number

NUMBERS: Final = (
    *(struct.pack("<f", x) for x in (float("nan"), float("inf"), float("-inf"), 3.4e38, -3.4e38, 1e-42)),
    *(struct.pack("<d", x) for x in (float("nan"), float("inf"), float("-inf"), 1.7e308, -1.7e308)),
    *(bytes([b]) * n for b in (0, 0xFF, 0x7F, 0x80) for n in (1, 2, 4, 8)),
    struct.pack("<q", 2**63 - 1),
    struct.pack("<q", -(2**63)),
    struct.pack("<q", 10**18),
)


class Message(NamedTuple):
    """A message of a log: its kind, and the bytes with numbers, from ``start`` to before ``end``."""

    kind: bytes
    start: int
    end: int


def messages_of(log: bytes, suffix: str) -> Iterator[Message]:
    """Yield the messages of an intact log."""
    return {".tlog": _tlog, ".bin": _dataflash, ".ulg": _ulog}[suffix.lower()](log)


def _tlog(log: bytes) -> Iterator[Message]:
    place = 0
    while place + 20 < len(log):
        magic, length = log[place + 8], log[place + 9]
        head = 6 if magic == 0xFE else 10
        kind = log[place + 13 : place + 14] if magic == 0xFE else log[place + 15 : place + 18]
        start = place + 8 + head
        yield Message(kind.ljust(3, b"\0"), start, start + length)
        signed = magic == 0xFD and log[place + 10] & 1
        place = start + length + 2 + (13 if signed else 0)


def _dataflash(log: bytes) -> Iterator[Message]:
    lengths, place = {128: 89}, 0
    while place + 3 <= len(log) and log[place + 2] in lengths:
        kind = log[place + 2]
        end = place + lengths[kind]
        if kind == 128:
            lengths[log[place + 3]] = log[place + 4]
        yield Message(bytes([kind]), place + 3, end)
        place = end


def _ulog(log: bytes) -> Iterator[Message]:
    place = 16
    while place + 3 <= len(log):
        size, kind = struct.unpack_from("<HB", log, place)
        yield Message(
            log[place + 2 : place + 5] if kind == ord("D") else bytes([kind]), place + 3, place + 3 + size
        )
        place += 3 + size


def _summed(log: bytearray, message: Message) -> None:
    """Write the checksum of a MAVLink message anew."""
    kind = int.from_bytes(message.kind, "little")
    start = message.start - (10 if log[message.start - 10] == 0xFD else 6) + 1
    crc = dialect.x25crc(log[start : message.end])
    crc.accumulate(bytes([dialect.mavlink_map[kind].crc_extra]))
    log[message.end : message.end + 2] = struct.pack("<H", crc.crc)


def numbers(log: bytes, suffix: str, rng: random.Random) -> bytes:
    """Replace a number of some messages of some kinds; rare kinds are as likely as frequent ones."""
    by_kind = defaultdict(list)
    for message in messages_of(log, suffix):
        if message.end <= len(log):
            by_kind[message.kind].append(message)
    out = bytearray(log)
    for kind in rng.sample(sorted(by_kind), min(rng.randint(1, 4), len(by_kind))):
        hit = rng.sample(by_kind[kind], min(rng.choice((1, 3, _MOST)), len(by_kind[kind])))
        value, at = rng.choice(NUMBERS), rng.random()
        for message in hit:
            room = message.end - message.start - len(value)
            if room < 0:
                continue
            start = message.start + int(at * (room + 1))
            out[start : start + len(value)] = value
            if suffix == ".tlog":
                _summed(out, message)
    return bytes(out)


def _flips(log: bytes, suffix: str, rng: random.Random) -> bytes:
    out = bytearray(log)
    for _ in range(rng.choice((1, 10, 200))):
        out[rng.randrange(min(len(log), rng.choice((4096, len(log)))))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _bursts(log: bytes, suffix: str, rng: random.Random) -> bytes:
    out = bytearray(log)
    for _ in range(rng.randint(1, 8)):
        start, noise = rng.randrange(len(log)), rng.randbytes(rng.randint(4, 512))
        out[start : start + len(noise)] = noise
    return bytes(out)


def _cut(log: bytes, suffix: str, rng: random.Random) -> bytes:
    return log[: rng.randrange(len(log))]


def _block(log: bytes, rng: random.Random) -> tuple[int, int]:
    start = rng.randrange(len(log))
    return start, min(start + rng.choice((16, 512, 4096, 32768)), len(log))


def _removed(log: bytes, suffix: str, rng: random.Random) -> bytes:
    start, end = _block(log, rng)
    return log[:start] + log[end:]


def _duplicated(log: bytes, suffix: str, rng: random.Random) -> bytes:
    start, end = _block(log, rng)
    place = rng.randrange(len(log))
    return log[:place] + log[start:end] + log[place:]


DAMAGE: Final[tuple[Callable[[bytes, str, random.Random], bytes], ...]] = (
    numbers,
    numbers,
    _flips,
    _bursts,
    _cut,
    _removed,
    _duplicated,
)


def default_logs() -> list[tuple[str, bytes]]:
    """Return the beginning of a log of each format, with its suffix."""
    files = [DATA / "healthy.tlog", DATA / "friction.BIN"]
    return [
        *((path.suffix, path.read_bytes()[:_KEPT_BYTES]) for path in files),
        (".ulg", flown(8.0)),
    ]


def commands(log: Path, out: Path) -> Iterator[list[str]]:
    """Yield the commands that read a log."""
    yield ["analyse", str(log)]
    yield ["inspect", str(log), "--messages"]
    yield ["export", str(log), "-o", f"{out}/table.csv"]
    yield ["report", str(log), "-o", f"{out}/report.html"]
    yield ["analyse", str(log), "--rrd", f"{out}/flight.rrd"]


def problems_of(arguments: Sequence[str]) -> list[str]:
    """Run a command in this process; return its traceback's end and its warnings."""
    nowhere = io.StringIO()
    found = []
    with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stdout(nowhere):
        warnings.simplefilter("always")
        try:
            with contextlib.redirect_stderr(nowhere):
                cli.main(list(arguments), prog_name="mavhums", standalone_mode=False)
        except (SystemExit, MavhumsError):
            pass
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            where = next((f for f in reversed(frames) if "mavhums" in f.filename), frames[-1])
            found.append(
                f"{type(error).__name__}: {error!s:.80} at {Path(where.filename).name}:{where.lineno}"
            )
    numpys = {f"{w.message!s:.60} at {Path(w.filename).name}:{w.lineno}" for w in caught}
    return found + [f"warning: {one}" for one in sorted(numpys)]


def run(logs: Sequence[tuple[str, bytes]], count: int, seed: int) -> Counter[str]:
    """Run every command on ``count`` damaged copies of each log; return the problems with their numbers."""
    found: Counter[str] = Counter()
    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder:
        for which, (suffix, log) in enumerate(logs):
            for k in range(count):
                rng = random.Random(f"{seed}/{which}/{k}")
                path = Path(folder, f"damaged{suffix}")
                path.write_bytes(rng.choice(DAMAGE)(log, suffix, rng))
                problems = {
                    (arguments[0], problem)
                    for arguments in commands(path, Path(folder))
                    for problem in problems_of(arguments)
                }
                for command, problem in sorted(problems):
                    found[problem] += 1
                    print(f"{suffix} {seed}/{which}/{k} {command}: {problem}", flush=True)
    logging.disable(logging.NOTSET)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return whether a command failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=800)
    parser.add_argument("logs", nargs="*", type=Path)
    given = parser.parse_args(arguments)
    logs = [(path.suffix.lower(), path.read_bytes()) for path in given.logs] or default_logs()
    begun = time.monotonic()
    found = run(logs, given.count, given.seed)
    print(f"{given.count * len(logs)} damaged logs, five commands each, {time.monotonic() - begun:.0f} s:")
    print(f"{sum(found.values())} problems of {len(found)} kinds")
    for problem, number in found.most_common():
        print(f"{number:6} {problem}")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
