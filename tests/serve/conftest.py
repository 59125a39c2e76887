"""Logs and a fleet's store for the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums_sim import Flight, fly, write_tlog
from tests.fleet_logs import moved

DAY_S = 86_400.0
FLIGHTS = 9
END = {"D-GROWS": 0.55, "D-FAILS": 1.1, "D-KEEPS": 0.225}


@pytest.fixture(scope="session")
def healthy_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty healthy seconds."""
    path = tmp_path_factory.mktemp("healthy") / "healthy.tlog"
    write_tlog(fly(Flight(seed=21, duration_s=40.0)), path)
    return path


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine flights each of an aircraft that stays healthy, of one that wears, and of one that fails."""
    pytest.importorskip("distributed")
    from mavhums import fleet

    folder = tmp_path_factory.mktemp("fleet")
    made: dict[tuple[int, float], bytes] = {}
    for place, (aircraft, end) in enumerate(END.items()):
        for number in range(FLIGHTS):
            wear = number / (FLIGHTS - 1) if aircraft == "D-GROWS" else float(number == FLIGHTS - 1)
            friction = 0.225 + (end - 0.225) * wear
            key = (3 * place + number % 3, round(friction, 3))  # one log of two aircraft is kept once
            if key not in made:
                path = folder / "one.tlog"
                worn = {"elevator": (friction, friction)}
                write_tlog(fly(Flight(key[0], 21.0, worn, rate_hz=25.0, tiers=("instrumented",))), path)
                made[key] = moved(path.read_bytes(), 0.0)
            log = folder / "logs" / aircraft / f"{number:02}.tlog"
            log.parent.mkdir(parents=True, exist_ok=True)
            log.write_bytes(moved(made[key], DAY_S * number))
    options = fleet.ScanOptions(aircraft="folder")
    fleet.scan([folder / "logs"], folder / "store", options)
    return folder / "store"
