"""Two aircraft under one system id: their data are no evidence on either of them."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from tests.conftest import CARRIED, REAL_LOGS, needs
from tests.judge import judged
from tests.links import records
from tests.strategies import START_US

FAULTY, HEALTHY = CARRIED / "aileron_frozen.tlog", CARRIED / "healthy.tlog"
REPORTED = REAL_LOGS.parent / "flights" / "reports" / "tlog_two_same_sysid.tlog.gz"


def moved(log: Path, delay_s: float) -> list[tuple[int, bytes]]:
    """Return the frames of a log as if it had begun that long after all others, with their times."""
    flight = records(log.read_bytes())
    shift_us = round(delay_s * 1e6) + START_US - flight[0][0]
    return [(time_us + shift_us, frame) for time_us, _, frame in flight]


def together(*flights: list[tuple[int, bytes]]) -> bytes:
    frames = sorted((frame for flight in flights for frame in flight), key=lambda one: one[0])
    return b"".join(struct.pack(">Q", time_us) + frame for time_us, frame in frames)


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [1.0, 7.03, 45.0])
def test_verdicts_on_two_aircraft_with_one_id_are_undecided(delay_s: float) -> None:
    """Whatever lies between their clocks; the finding on the faulty one could be on either."""
    data = together(moved(FAULTY, 0.0), moved(HEALTHY, delay_s))
    found = judged(data)[0]
    assert {one.worst for one in found.verdicts} == {"undecided", "unmonitored"}
    for one in found.verdicts:
        if one.worst == "undecided":
            assert one.reason_codes == ("several_senders",)
    assert not any(one.own or one.indicators or one.evidence for one in found.verdicts)
    assert judged(data, size=40_000)[0] == found


@pytest.mark.slow
def test_a_reboot_a_late_route_and_a_few_false_frames_are_one_sender() -> None:
    """A finding stays: the aircraft is heard again from its boot, over two links, or beside a forger."""
    alone = judged(FAULTY.read_bytes())[0]
    assert alone.exit_code.name == "DEGRADED"
    flight = moved(FAULTY, 0.0)
    length_s = (flight[-1][0] - flight[0][0]) / 1e6
    rebooted = judged(together(flight, moved(FAULTY, length_s + 5.0)))[0]
    copied = judged(together(flight, moved(FAULTY, 2.0)))[0]
    forged = judged(together(flight, moved(HEALTHY, 7.03)[::40]))[0]
    for one in (rebooted, copied, forged):
        assert not any("several_senders" in verdict.reason_codes for verdict in one.verdicts)


@needs(REPORTED)
def test_the_reported_log_is_of_two() -> None:
    from mavhums import analyse

    axes = [verdict for verdict in analyse(REPORTED).verdicts if verdict.subject == "axis"]
    assert axes
    assert {verdict.reason_codes for verdict in axes} == {("several_senders",)}
