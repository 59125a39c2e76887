"""The operator's table in a fleet names aircraft, also of logs that are there already; it dates actuators."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums.app.analysis import analyse
from tests.conftest import Run
from tests.fleet_logs import small

pytest.importorskip("distributed")

from mavhums import Options, fleet
from tests.fleet.stores import verdicts_of, write_logs

FLIGHTS = 14
SWAPPED = "2026-01-03"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    worn = [*[None] * (FLIGHTS - 1), 0.25]
    flown = [small(day % 3, friction, surface="rudder") for day, friction in enumerate(worn)]
    return sorted(write_logs(tmp_path_factory.mktemp("installed"), *flown).iterdir())


@pytest.fixture
def table(logs: list[Path], tmp_path: Path) -> Path:
    board = analyse(logs[0]).log.flight[0].board
    path = tmp_path / "table.csv"
    lines = (f"D-A,{board},,,,2026-01-14", f"D-B,{board},,,2026-01-14,", f"D-A,,rudder,R2,{SWAPPED},")
    path.write_text("\n".join(("aircraft,board,actuator,serial,from,to", *lines)))
    return path


@pytest.mark.slow
def test_a_fleet_with_a_table_says_what_single_commands_say(
    logs: list[Path], table: Path, scheduler: str, run: Run, tmp_path: Path
) -> None:
    expected = {}
    for log in logs:
        assessment = analyse(log, store=tmp_path / "landed", aircraft_table=table, keep=True)
        expected[str(log)] = sorted(verdict.model_dump_json() for verdict in assessment.verdicts)
    store = tmp_path / "store"
    plain = fleet.ScanOptions(scheduler=scheduler)
    given = fleet.ScanOptions(judging=Options(aircraft_table=table), scheduler=scheduler)
    fleet.scan(logs[4:9], store, plain)
    assert {(one.aircraft or "")[:5] for one in fleet.worst(store)} == {"board"}
    fleet.scan([*logs[:4], *logs[9:]], store, given)
    assert {one.aircraft for one in fleet.worst(store)} == {"D-A", "D-B"}
    assert verdicts_of(store, "D-A", "D-B") == expected
    assert fleet.status(store).judged == FLIGHTS
    assert fleet.scan(logs, store, plain) == (0, 0, FLIGHTS)
    assert verdicts_of(store, "D-A", "D-B") == expected
    table.write_text(table.read_text().replace(SWAPPED, "2026-01-08"))
    assert fleet.scan(logs, store, given) == (0, 0, FLIGHTS)
    assert verdicts_of(store, "D-B") == {str(logs[-1]): expected[str(logs[-1])]}
    assert verdicts_of(store, "D-A")[str(logs[12])] != expected[str(logs[12])]
    trend = fleet.trend(store, "D-A").trends
    assert {one.actuator: one.flights for one in trend if one.fault == "friction"}["rudder"] == 6
    refused = run("fleet", "scan", logs[0], "--store", store, "--aircraft-table", tmp_path / "none.csv")
    assert refused.code == 1
