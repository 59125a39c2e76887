"""Logs and a fleet's store for the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fleet_logs import moved, small

DAY_S = 86_400.0
FLIGHTS = 9
END = {"D-GROWS": 0.55, "D-FAILS": 1.1, "D-KEEPS": 0.225}


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine flights each of an aircraft that stays healthy, of one that wears, and of one that fails."""
    pytest.importorskip("distributed")
    from mavhums import Options, fleet

    folder = tmp_path_factory.mktemp("fleet")
    for place, (aircraft, end) in enumerate(END.items()):
        for number in range(FLIGHTS):
            wear = number / (FLIGHTS - 1) if aircraft == "D-GROWS" else float(number == FLIGHTS - 1)
            friction = 0.225 + (end - 0.225) * wear
            log_of_its_own = small(3 * place + number % 3, friction)  # one log of two aircraft is kept once
            log = folder / "logs" / aircraft / f"{number:02}.tlog"
            log.parent.mkdir(parents=True, exist_ok=True)
            log.write_bytes(moved(log_of_its_own, DAY_S * number))
    options = fleet.ScanOptions(judging=Options(aircraft="folder"))
    fleet.scan([folder / "logs"], folder / "store", options)
    return folder / "store"
