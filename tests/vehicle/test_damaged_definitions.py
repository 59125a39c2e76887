"""Each field that is read, removed, renamed or retyped in its definition: a quantity that was not measured.

An on-board log defines its own fields, and one flipped bit changes a definition. Every field of every message
that a format reads is damaged, in each way in turn; each such log is judged without an error.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

from mavhums.vehicle.formats.dataflash import SERVO_SOURCES, SOURCES
from mavhums_sim import Flight, fly
from mavhums_sim import dataflash as recorder
from tests.judge import judged
from tests.log.ulog import writer
from tests.log.ulog.writer import FLIGHT, TOPICS, flown

pytestmark = pytest.mark.filterwarnings("error")

_BIN_READ = {  # of the messages that the simulator does not write
    "ARM": (90, "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
    "RATE": (91, "Qffff", "TimeUS,ROut,POut,YOut,AOut"),
    "RCO2": (93, "Q" + 14 * "H", "TimeUS," + ",".join(f"C{n}" for n in range(15, 29))),
    "EV": (94, "QB", "TimeUS,Id"),
}


_OTHERS = {"f": "nI", "I": "nf", "i": "nf", "L": "nf", "Q": "dq", "N": "", "Z": "a", "n": "f", "B": "bM"}
"""Letters of the same or another size to which a field is retyped: text, integer, float, array."""


@pytest.fixture(scope="module")
def dataflash_log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Three seconds with every record that is read."""
    path = tmp_path_factory.mktemp("fields") / "whole.BIN"
    flight = Flight(seed=3, duration_s=3.0, rate_hz=20.0, tiers=("csrv", "esc-unsigned", "named", "pwm"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "_TYPES", recorder._TYPES | _BIN_READ)
        kinds = [*recorder._kinds(fly(flight), 1_700_000_000_000_000)]
        time_s = np.arange(0, 3, 0.1)
        recorder.write_records([*kinds, *(recorder.records(name, time_s) for name in _BIN_READ)], path)
    return path.read_bytes()


def _definitions(log: bytes) -> Iterator[tuple[int, str]]:
    """Yield the place and the name of each FMT record."""
    for found in re.finditer(rb"\xa3\x95\x80", log[: 89 * 64]):
        yield found.start(), log[found.start() + 5 : found.start() + 9].rstrip(b"\0").decode()


def _redefined(log: bytes, place: int, letters: str, columns: list[str]) -> bytes:
    body = letters.encode().ljust(16, b"\0") + ",".join(columns).encode().ljust(64, b"\0")
    return log[: place + 9] + body[:80] + log[place + 89 :]


Damaged = Iterator[list[tuple[str, bytes]]]


def damaged_dataflash(log: bytes) -> Damaged:
    """Yield the log with a field damaged: renamed, retyped to text or to an array of equal size, removed.

    A definition without a field contradicts its length: all its records are unknown then.
    """
    wanted = {source.message for source in SOURCES} | {source.message for source in SERVO_SOURCES}
    wanted |= {"DSF", "GPS"}
    for place, name in _definitions(log):
        if name not in wanted:
            continue
        letters = log[place + 9 : place + 25].rstrip(b"\0").decode()
        columns = log[place + 25 : place + 89].rstrip(b"\0").decode().split(",")
        for k, column in enumerate(columns):
            renamed = [*columns[:k], chr(ord(column[0]) ^ 1) + column[1:], *columns[k + 1 :]]
            ways = [(f"{name}.{column} renamed", _redefined(log, place, letters, renamed))]
            for other in _OTHERS.get(letters[k], "hc"):
                retyped = letters[:k] + other + letters[k + 1 :]
                ways.append((f"{name}.{column} as {other}", _redefined(log, place, retyped, columns)))
            shorter = letters[:k] + letters[k + 1 :]
            without = _redefined(log, place, shorter, columns[:k] + columns[k + 1 :])
            yield [*ways, (f"{name}.{column} removed", without)]


def damaged_ulog(log: bytes) -> Damaged:
    """Yield the log with a field renamed, retyped to text and to an array, and removed."""
    sizes = {"uint64_t": 8, "uint8_t": 1, "int32_t": 4, "float": 4, "double": 8, "char": 1}
    topics = {name: "uint64_t timestamp;" + fields for name, (_, fields) in TOPICS.items()}
    topics["esc_report"] = FLIGHT["esc_report"]
    for topic, fields in topics.items():
        whole = writer.form(topic, fields)
        assert whole in log
        for field in fields.split(";")[:-1]:
            kind, _, name = field.partition(" ")
            base, _, count = kind.rstrip("]").partition("[")
            size = sizes.get(base, 0) * int(count or 1)
            changes = {"renamed": f"{kind} {name[:-1]}_;"}
            if size:
                changes |= {
                    "as text": f"char[{size}] {name};",
                    "as bytes": f"uint8_t[{size}] {name};",
                    "one less": f"uint8_t[{size - 1}] {name};uint8_t x;" if size > 1 else f"int8_t {name};",
                    "removed": f"uint8_t[{size}] _padding9;",
                }
            forms = {how: fields.replace(f"{field};", new, 1) for how, new in changes.items()}
            yield [
                (f"{topic}.{name} {how}", log.replace(whole, writer.form(topic, new), 1))
                for how, new in forms.items()
            ]


def failures(fields: Damaged) -> list[str]:
    """Judge a log for each field, with all that is followed; return what went wrong."""
    failed = []
    for number, ways in enumerate(fields):
        what, log = ways[number % len(ways)]
        try:
            judged(log, vehicle_states=True)
        except Exception as error:
            failed.append(f"{what}: {type(error).__name__}: {error}")
    return failed


@pytest.mark.slow
def test_each_field_of_a_dataflash_log(dataflash_log: bytes) -> None:
    assert failures(damaged_dataflash(dataflash_log)) == []


@pytest.mark.slow
def test_each_field_of_a_ulog() -> None:
    assert failures(damaged_ulog(flown(3.0))) == []
