"""The decoder on logs that others flew, against pymavlink."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from pymavlink import mavutil

from mavhums.errors import UnreadableLogError
from mavhums.log import read_log
from tests.conftest import real_logs

DAMAGED = ("Avalanche", "LucaGemma", "ardusub_log_tools", "mavrik-control")
LOGS = [path for path in real_logs() if path.suffix == ".tlog"]
OTHERS = [path for path in real_logs() if path.suffix != ".tlog"]

needs_logs = pytest.mark.skipif(not LOGS, reason="the folder of real logs is absent (MAVHUMS_REAL_LOGS)")


def by_pymavlink(path: Path) -> Counter[str]:
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    counts: Counter[str] = Counter()
    while (message := connection.recv_msg()) is not None:
        counts[message.get_type()] += 1
    connection.close()
    return counts


@needs_logs
@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_counts_are_those_of_pymavlink_or_better(path: Path) -> None:
    log = read_log(path)
    ours: Counter[str] = Counter()
    for (_, _, name), count in log.counts.items():
        ours[name] += count
    theirs = by_pymavlink(path)
    known = {name: n for name, n in theirs.items() if not name.startswith(("UNKNOWN_", "BAD_DATA"))}
    if path.name.startswith(DAMAGED):
        assert log.losses.any
        assert all(ours[name] >= n for name, n in known.items())
    else:
        assert not log.losses.any
        assert dict(ours) == known
        unknown = {int(name[8:]): n for name, n in theirs.items() if name.startswith("UNKNOWN_")}
        assert log.unknown == unknown


@needs_logs
@pytest.mark.parametrize("path", OTHERS, ids=lambda path: path.name)
def test_other_files_are_refused(path: Path) -> None:
    with pytest.raises(UnreadableLogError) as caught:
        read_log(path)
    assert caught.value.remedy
