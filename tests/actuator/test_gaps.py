"""A gap of the link hides motion: it makes no emergency of a healthy actuator, whatever its telemetry."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import load_airframe
from mavhums.health.actuator.monitor import Monitor
from mavhums.log import Table, read_log
from mavhums.vehicle.clocks import Clocks
from mavhums_sim import Flight, fly, write_dataflash, write_tlog

PAPER = load_airframe("paper")


@cache
def healthy(tier: str, cyclogram: str, rate_hz: float, seed: int = 5) -> Mapping[str, Table]:
    """Return the messages of a healthy flight of a minute, on the vehicle's clock."""
    tiers = (tier,) if tier == "csrv" else (tier, "pwm")
    flight = Flight(
        seed=seed, duration_s=60.0, rate_hz=rate_hz, cyclogram=cyclogram, individuals=7, tiers=tiers
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("healthy.BIN" if tier == "csrv" else "healthy.tlog")
        (write_dataflash if tier == "csrv" else write_tlog)(fly(flight), path)
        return Clocks().feed(read_log(path).tables)


def alarms(tables: Mapping[str, Table], gaps: Iterable[tuple[float, float]]) -> list[str]:
    """Return which actuators are an emergency at some time when these stretches are cut out."""
    begin_us = min(int(table.time_us.min()) for table in tables.values() if len(table))
    cut = {}
    for name, table in tables.items():
        time_s = (table.time_us - begin_us) * 1e-6
        gone = np.any([(time_s >= start) & (time_s < end) for start, end in gaps], axis=0)
        cut[name] = table.select(~gone)
    monitors: dict[str, Monitor] = {}
    for new in Mapper(PAPER).feed(cut, final=True):
        monitor = monitors.setdefault(new.actuator.name, Monitor(1, new.actuator))
        seen_s: NDArray[np.float64] = np.asarray((new.utc_us - begin_us) * 1e-6, dtype=np.float64)
        list(monitor.feed(seen_s, new.values, new.measured, new.bus_v, None, new.magnitudes))
    for monitor in monitors.values():
        list(monitor.finish())
    assert len(monitors) == len(PAPER.actuators)
    return [name for name, monitor in monitors.items() if monitor.worst == "emergency"]


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["instrumented", "esc-signed", "esc-unsigned", "named", "csrv"])
def test_no_gap_makes_a_healthy_actuator_an_emergency(tier: str) -> None:
    """Gaps of 0.2 to 5 s, many in a flight: what one leaves adds up with what the next leaves."""
    tables = healthy(tier, "turns", 50.0)
    assert not alarms(tables, [(1e3, 2e3)])
    for phase_s, lengths_s in itertools.product((0.0, 1.1, 2.7), ((1.3,), (0.2, 0.45, 0.7, 2.2, 5.0))):
        gaps, start = [], 4.0 + phase_s
        for gap_s in itertools.cycle(lengths_s):
            gaps.append((start, start + gap_s))
            start += gap_s + 4.1
            if start > 58.0:
                break
        assert not alarms(tables, gaps)


def test_a_command_just_before_a_gap_is_answered_in_it() -> None:
    """The last samples before a gap are confirmed after it, and are no command of then."""
    time_s = np.arange(0.0, 20.0, 0.02)
    values = np.full((time_s.size, 12), np.nan)
    values[:, 0] = np.where((time_s >= 9.94) & (time_s < 10.5), 8.0, 0.0)
    values[:, 2] = np.where((time_s >= 10.0) & (time_s < 10.6), 8.0, 0.0)
    there = (time_s < 9.995) | (time_s >= 11.2)
    monitor = Monitor(1, PAPER.actuators[0])
    list(monitor.feed(time_s[there], values[there]))
    list(monitor.finish())
    assert monitor.worst != "emergency"
