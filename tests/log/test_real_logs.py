"""The decoder on logs that others flew, against pymavlink, message by message and field by field."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega

from mavhums.log import Table, read_log
from mavhums.log.base.decoder import ODD_TIME
from tests.conftest import REAL_LOGS, carried_logs, needs, real_logs
from tests.log.decode import differing_fields

DAMAGED = ("Avalanche", "LucaGemma", "ardusub_log_tools", "mavrik-control")
WITHOUT_STAMPS = ".tlog.raw"
LOGS = [path for path in (*carried_logs(), *real_logs()) if path.suffix == ".tlog"]
NOT_IN_PYMAVLINK = {
    "CURRENT_EVENT_SEQUENCE", "ESC_INFO", "ESC_STATUS", "EVENT", "LINK_NODE_STATUS",
    "TIME_ESTIMATE_TO_TARGET",
}  # fmt: skip


def by_pymavlink(path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Return its messages by type; without MAVLINK20 a log that begins in MAVLink 1 loses newer ids."""
    monkeypatch.setenv("MAVLINK20", "1")
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    messages: defaultdict[str, list[Any]] = defaultdict(list)
    while (message := connection.recv_msg()) is not None:
        messages[message.get_type()].append(message)
    connection.close()
    return messages


def assert_same_fields(table: Table, messages: list[Any]) -> None:
    assert np.array_equal(table.system, [m.get_srcSystem() for m in messages])
    assert np.array_equal(table.component, [m.get_srcComponent() for m in messages])
    assert np.array_equal(table.sequence, [m.get_seq() for m in messages])
    times = np.array([m._timestamp for m in messages])
    sound = table.flags & ODD_TIME == 0
    assert np.allclose(table.time_us[sound] / 1e6, times[sound], rtol=0, atol=1e-6)
    assert differing_fields(table, messages) == []


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_every_field_is_that_of_pymavlink(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = read_log(path)
    theirs = by_pymavlink(path, monkeypatch)
    bad = len(theirs.pop("BAD_DATA", ()))
    unknown = Counter({name: len(found) for name, found in theirs.items() if name.startswith("UNKNOWN_")})
    if path.name.startswith(DAMAGED):
        return assert_nothing_that_pymavlink_found_is_missing(log.tables, theirs)
    assert not log.losses.any
    if bad:  # after a payload of two bytes pymavlink takes the next record's time stamp for a frame
        return assert_nothing_that_pymavlink_found_is_missing(log.tables, theirs)
    ours = set(log.tables) - NOT_IN_PYMAVLINK
    assert ours == set(theirs) - set(unknown)
    for name in ours:
        assert len(log.tables[name]) == len(theirs[name])
        assert_same_fields(log.tables[name], theirs[name])
    newer = sum(len(log.tables[name]) for name in set(log.tables) & NOT_IN_PYMAVLINK)
    assert sum(log.unknown.values()) + newer == sum(unknown.values())
    return None


def assert_nothing_that_pymavlink_found_is_missing(
    tables: dict[str, Table], theirs: dict[str, list[Any]]
) -> None:
    """In order, message for message; its time stamps after damage are not to be trusted."""
    for name, messages in theirs.items():
        if name.startswith("UNKNOWN_"):
            continue
        table, size = tables[name], tables[name].fields.dtype.itemsize
        heads = (table.system.tolist(), table.component.tolist(), table.sequence.tolist())
        ours = Counter(zip(*heads, (row.tobytes() for row in table.fields), strict=True))
        found = Counter(
            (m.get_srcSystem(), m.get_srcComponent(), m.get_seq(), payload_of(m).ljust(size, b"\0")[:size])
            for m in messages
        )
        assert not found - ours, name


def payload_of(message: Any) -> bytes:
    buffer = bytes(message.get_msgbuf())
    head = 10 if buffer[0] == 0xFD else 6
    return buffer[head : head + buffer[1]]


@needs(REAL_LOGS)
def test_a_log_without_time_stamps_holds_what_pymavlink_parses() -> None:
    raw = next(path for path in real_logs() if path.name.endswith(WITHOUT_STAMPS))
    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    theirs: defaultdict[str, list[Any]] = defaultdict(list)
    for message in parser.parse_buffer(raw.read_bytes()):
        theirs[message.get_type()].append(message)
    theirs.pop("BAD_DATA")
    log = read_log(raw)
    assert log.sender_clock
    assert_nothing_that_pymavlink_found_is_missing(log.tables, theirs)
    boot_us = log.tables["ATTITUDE"]["time_boot_ms"].astype(np.int64) * 1000
    assert np.all(np.abs(log.tables["ATTITUDE"].time_us - boot_us) <= 1_000_000)
