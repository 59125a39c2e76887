"""Copter and Rover record on board when they arm and disarm, and Copter before 3.4 names outputs ``Ch1``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mavhums import analyse
from mavhums_sim import dataflash
from mavhums_sim.dataflash import records, write_records
from tests.judge import judged

ARMED_S, DISARMED_S, END_S = 5.0, 65.0, 80.0


@pytest.fixture(params=["C", "Ch"])
def log(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    outputs = ",".join(f"{request.param}{k}" for k in range(1, 5))
    monkeypatch.setitem(dataflash._TYPES, "EV", (90, "QB", "TimeUS,Id"))
    monkeypatch.setitem(dataflash._TYPES, "RCOU", (91, "QHHHH", f"TimeUS,{outputs}"))
    time_s = np.arange(0.0, END_S, 0.1)
    sent = dict.fromkeys(outputs.split(","), 1500 + 100 * (time_s > 10.0))
    path = tmp_path / "copter.BIN"
    mode = records("MODE", np.zeros(1), Mode=5, ModeNum=5, Rsn=1)
    said = records("MSG", np.zeros(1), Message=b"ArduCopter V4.5.7")
    events = records("EV", np.array([ARMED_S, 9.0, DISARMED_S]), Id=np.array([10, 28, 11]))
    write_records([said, mode, events, records("RCOU", time_s, **sent)], path)
    return path


def test_armed_time_is_that_between_the_events(log: Path) -> None:
    [usage] = analyse(log).usage
    assert usage.armed_s == pytest.approx(DISARMED_S - ARMED_S, abs=0.2)
    assert {output.servo for output in usage.outputs if output.commanded} == {1, 2, 3, 4}
    assert judged(log.read_bytes(), size=777)[0].usage == (usage,)


@pytest.mark.parametrize("size", [777, 1 << 20])
def test_the_time_before_a_first_disarming_is_not_known(log: Path, size: int) -> None:
    """A log that begins while armed records the disarming alone."""
    arms = records("EV", np.array([ARMED_S]), Id=10).rows.tobytes()
    content = log.read_bytes()
    assert content.count(arms) == 1
    [usage] = judged(content.replace(arms, b""), size=size)[0].usage
    assert usage.armed_s is None
