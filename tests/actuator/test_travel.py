"""The travel that a profile lacks: the log shows how the shaft's angle follows from the pulse."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import Actuator, Airframe
from mavhums.health.actuator.monitor import Monitor
from mavhums.log import Table
from mavhums.results.reasons import Reason
from tests.vehicle.tables import table_of

TIME_S = np.arange(0.0, 60.0, 0.02)
ELEVATOR = Actuator(name="elevator", servo=3, pwm_us=(1000, 1500, 2000))
MOTION = np.sin(1.3 * TIME_S) + 0.4 * np.sin(3.1 * TIME_S)


def tables(angle_deg: np.ndarray[tuple[int], np.dtype[np.float64]], rows: slice) -> dict[str, Table]:
    """Return the pulses to the elevator and its position, as a DroneCAN servo sends it, of some samples."""

    def table(name: str, frame: int, **columns: object) -> Table:
        fields = np.empty(TIME_S.size, dtype=[(key, "f8") for key in columns])
        for key, value in columns.items():
            fields[key] = value
        frames = np.arange(TIME_S.size) * 2 + frame
        return table_of(name, fields, frame=frames, time_us=1e6 * TIME_S).select(np.arange(TIME_S.size)[rows])

    position = table("CSRV", 1, Id=3, Pos=angle_deg, PosCmd=np.nan)
    return {"RCOU": table("RCOU", 0, C3=1500.0 + 200.0 * MOTION), "CSRV": position}


@pytest.mark.parametrize("cuts", [(), (7, 700, 701, 2000)])
@pytest.mark.parametrize(("jam_s", "worst"), [(np.inf, "undecided"), (40.0, "emergency"), (0.0, "undecided")])
def test_a_position_at_rest_while_the_pulse_moves_is_a_jam(
    jam_s: float, worst: str, cuts: tuple[int, ...]
) -> None:
    """The scale is negative and has an offset; of a shaft that never followed there is none."""
    angle = 3.0 - 11.0 * MOTION
    angle[jam_s <= TIME_S] = angle[np.searchsorted(TIME_S, min(jam_s, 59.0))]
    mapper, monitor = Mapper(Airframe(name="drafted", actuators=(ELEVATOR,))), Monitor(1, ELEVATOR)
    edges = [0, *cuts, TIME_S.size]
    for start, end in itertools.pairwise(edges):
        for new in mapper.feed(tables(angle, slice(start, end)), final=end == TIME_S.size):
            list(monitor.feed(new.utc_us / 1e6, new.values, new.measured))
            follows = (new.utc_us > 15_000_000) & (new.utc_us < min(jam_s, 60.0) * 1e6)
            np.testing.assert_allclose(new.values[follows, 0], new.values[follows, 2], atol=0.05)
    list(monitor.finish())
    assert monitor.worst == worst
    assert mapper.of(1, ELEVATOR).obstacle == (Reason("never_follows") if jam_s == 0.0 else None)
