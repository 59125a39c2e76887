from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")

from rerun.chunk import RrdReader

from mavhums.core.errors import MavhumsError
from mavhums.show import record_trend
from tests.show.test_recording import entities, static


def trend(**columns: Any) -> pd.DataFrame:
    frame = pd.DataFrame(
        {
            "actuator": ["elevator", "rudder", "elevator"],
            "start_utc": ["2026-01-03T09:00:00Z", "2026-01-01T09:00:00+00:00", "2026-01-01T09:00:00.5Z"],
            "friction_nm": [0.5, np.nan, 0.3],
            "friction_low_nm": [0.45, np.nan, 0.25],
            "friction_high_nm": [0.55, np.nan, 0.35],
            "condition": ["degraded", "undecided", "normal"],
            "normal_limit_nm": 0.375,
            "emergency_limit_nm": 0.875,
        }
    )
    return frame.assign(**columns)


def values(path: Path, entity: str, component: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for part in RrdReader(path).stream().filter(content=entity, is_static=False):
        batch = part.to_record_batch()
        times = [str(time) for time in batch.column("utc").to_pylist()]
        found |= dict(zip(times, batch.column(component).to_pylist(), strict=True))
    return found


def test_each_flight_lies_at_its_date(tmp_path: Path) -> None:
    path = tmp_path / "trend.rrd"
    record_trend(trend(), path, report="# Nothing to do")
    friction = values(path, "/elevator/friction", "Scalars:scalars")
    assert list(friction.values()) == [[0.3, 0.25, 0.35], [0.5, 0.45, 0.55]]
    assert [pd.Timestamp(time).isoformat() for time in friction] == [
        "2026-01-01T09:00:00.500000",
        "2026-01-03T09:00:00",
    ]
    states = values(path, "/elevator", "StateChange:state")
    assert list(states.values()) == [["normal"], ["degraded"]]
    assert np.isnan(next(iter(values(path, "/rudder/friction", "Scalars:scalars").values()))).all()
    assert static(path, "/report")["TextDocument:text"] == ["# Nothing to do"]


def test_vehicles_are_kept_apart(tmp_path: Path) -> None:
    path = tmp_path / "trend.rrd"
    record_trend(trend(vehicle=[1, 1, 2]), path)
    assert {"/vehicle_1/elevator", "/vehicle_1/rudder", "/vehicle_2/elevator"} <= entities(path)
    assert "/report" not in entities(path)


def test_a_place_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MavhumsError, match="cannot write"):
        record_trend(trend(), tmp_path / "nowhere" / "trend.rrd")
