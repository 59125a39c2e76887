"""One aircraft's history takes no flight of another, and a swapped actuator begins a baseline of its own."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import pytest

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.flights.aircraft import AircraftResolver, OtherAircraftError, check_same_aircraft, latest
from mavhums.flights.aircraft_table import AircraftTable, Installation
from mavhums.flights.folder import FlightFolder, keep_assessment, read_history
from mavhums.results.assessment import Assessment
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.link import Link
from tests.conftest import Run
from tests.fleet_logs import nameless
from tests.flights import START, flown, identity, shown, verdict


def of(board: str | None, day: float, aircraft: str | None = None) -> Assessment:
    owned = identity(board=board, day=day).model_copy(update={"aircraft": aircraft})
    return flown(verdict(shown(0.2)), day=day, name=f"{board}-{day:g}", identities=[owned])


def held(folder: Path, flights: Sequence[Assessment], new: Assessment, table: AircraftTable) -> Assessment:
    for each in flights:
        keep_assessment(each, folder)
    by_index = check_same_aircraft(new, FlightFolder(folder), table)
    assert check_same_aircraft(new, read_history(folder), table) == by_index
    return by_index


NONE = AircraftTable()


def test_another_aircraft_is_refused_with_both_names(tmp_path: Path) -> None:
    with pytest.raises(OtherAircraftError) as error:
        held(tmp_path, [of("0A", 0)], of("0B", 1), NONE)
    told = "0B-1.tlog: is of the aircraft with the board 0B, but "
    assert error.value.problem == f"{told}{tmp_path} contains flights of the aircraft with the board 0A"
    assert "--history" in error.value.remedy
    assert "--aircraft-table" in error.value.remedy


def test_the_same_board_is_the_same_aircraft(tmp_path: Path) -> None:
    new = of("0A", 1)
    assert held(tmp_path, [of("0A", 0), of("0A", 3, "D-A")], new, NONE) == new


def test_a_swapped_board_is_known_from_the_table(tmp_path: Path) -> None:
    table = AircraftTable(
        Installation.model_validate({"aircraft": name, "board": board, "from": begins, "to": ends})
        for name, board, begins, ends in (
            ("D-A", "0A", None, START + timedelta(days=5)),
            ("D-B", "0A", START + timedelta(days=5), None),
            ("D-A", "0B", START + timedelta(days=5), None),
        )
    )
    whose = AircraftResolver(table=table)
    new = whose.named(of("0B", 6))
    assert new.log.flight[0].aircraft == "D-A"
    assert held(tmp_path, [of("0A", 0), of("0A", 1)], new, table) == new
    with pytest.raises(OtherAircraftError, match=r"is of D-B, but .* contains flights of D-A"):
        check_same_aircraft(whose.named(of("0A", 7)), FlightFolder(tmp_path), table)
    with pytest.raises(OtherAircraftError):
        check_same_aircraft(of("0B", 6), FlightFolder(tmp_path))


def test_a_mixed_history_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OtherAircraftError, match=r"board 0A and of .* board 0B"):
        held(tmp_path, [of("0A", 0), of("0B", 1)], of(None, 2), NONE)


@pytest.mark.parametrize(
    ("past", "new", "silent"), [("0A", None, "the log"), (None, "0A", "folder"), (None, None, "folder")]
)
def test_an_unknown_aircraft_is_accepted_with_a_notice(
    tmp_path: Path, past: str | None, new: str | None, silent: str
) -> None:
    told = held(tmp_path / "folder", [of(past, 0)], of(new, 1), NONE).log.notices
    assert len(told) == 1
    assert f"{silent} reports no board id" in told[0]


def test_a_foreign_board_is_told_where_the_name_is_the_same(tmp_path: Path) -> None:
    (told,) = held(tmp_path, [of("0A", 0, "D-A")], of("0B", 1, "D-A"), NONE).log.notices
    assert "flights of D-A with the board 0A, but this log has the board 0B: it is another aircraft" in told


def test_vehicles_with_different_ids_may_share_a_history(tmp_path: Path) -> None:
    other = of("0B", 1)
    flight = other.log.flight[0].model_copy(update={"vehicle": 2})
    other = other.model_copy(update={"log": other.log.model_copy(update={"flight": (flight,)})})
    assert held(tmp_path, [of("0A", 0)], other, NONE).verdicts == other.verdicts


def test_the_later_of_two_dates_counts() -> None:
    days = [START + timedelta(days=day) for day in range(4)]
    assert latest({None: days[2]}, {"rudder": days[1]}) == {None: days[2], "rudder": days[2]}
    assert latest({"rudder": days[0]}, {"rudder": days[3]}) == {"rudder": days[3]}
    assert latest(None, None) == {}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Thirteen flights of one aircraft and one of another."""
    folder = tmp_path_factory.mktemp("owned")
    paths = [folder / f"{day:02}.tlog" for day in range(14)]
    for day, path in enumerate(paths):
        flight = Flight(day % 3, 21.0, rate_hz=25.0, individuals=day // 13, tiers=("instrumented",))
        write_tlog(fly(flight), path, Link(day=float(day)))
    return paths


@pytest.mark.slow
def test_analyse_refuses_another_aircrafts_flight(run: Run, logs: list[Path], tmp_path: Path) -> None:
    folder = tmp_path / "flights"
    assert run("analyse", logs[0], "--history", folder, "--keep").code == ExitCode.OK
    for more in ((), ("--rrd", tmp_path / "x.rrd"), ("-o", tmp_path / "x.html")):
        command = "report" if "-o" in more else "analyse"
        refused = run(command, logs[13], "--history", folder, *more)
        assert refused.code == ExitCode.ERROR
        assert "13.tlog: is of the aircraft with the board" in refused.err
    assert not (tmp_path / "x.html").exists()
    assert len(list(folder.glob("*.json"))) == 1
    (tmp_path / "nameless.tlog").write_bytes(nameless(logs[1].read_bytes()))
    accepted = run("analyse", tmp_path / "nameless.tlog", "--history", folder)
    assert accepted.code == ExitCode.OK
    assert "The log reports no board id" in accepted.out
    named = run("analyse", tmp_path / "nameless.tlog", "--history", folder, "--aircraft", "folder")
    assert "reports no board id" not in named.out


@pytest.mark.slow
@pytest.mark.parametrize("recorded", [False, True])
def test_a_swapped_actuator_begins_a_baseline_of_its_own(
    logs: list[Path], tmp_path: Path, recorded: bool
) -> None:
    folder = tmp_path / "flights"
    for log in logs[:12]:
        keep_assessment(mavhums.analyse(log), folder)
    board = mavhums.analyse(logs[0]).log.flight[0].board
    table = tmp_path / "table.csv"
    table.write_text(
        f"aircraft,board,actuator,serial,from,to\nD-A,{board},,,,\nD-A,,rudder,1,,2026-01-12\n"
        "D-A,,rudder,2,2026-01-12,\n"
    )
    options = mavhums.Options(history=folder, aircraft_table=table)
    told = mavhums.analyse(logs[12], options, recording=tmp_path / "x.rrd" if recorded else None)
    compared = {
        each.actuator
        for each in told.verdicts
        for one in each.indicators
        if one.fault == "friction" and one.baseline is not None
    }
    assert compared == {"aileron_left", "aileron_right", "elevator"}
    assert told.log.flight[0].aircraft == "D-A"


def test_trend_refuses_a_folder_of_two_aircraft(run: Run, tmp_path: Path) -> None:
    folder, table = tmp_path / "flights", tmp_path / "table.csv"
    for day in range(6):
        keep_assessment(of("0A" if day < 3 else "0B", day), folder)
    with pytest.raises(OtherAircraftError, match=r"board 0A and of .* board 0B"):
        mavhums.trend(folder)
    refused = run("trend", folder)
    assert refused.code == ExitCode.ERROR
    assert f"{folder}: contains flights of the aircraft with the board 0A" in refused.err
    assert "--aircraft-table" in refused.err
    rows = ["aircraft,board,actuator,serial,from,to", "D-A,0A,,,,", "D-A,0B,,,,"]
    table.write_text("\n".join(rows))
    assert "estimate" in run("trend", folder, "--json", "--aircraft-table", table).out
    assert len(mavhums.trend(folder, aircraft_table=table)) == 6
    actuator = mavhums.trend(folder, aircraft_table=table)["actuator"][0]
    swapped = (START + timedelta(days=2)).date()
    table.write_text("\n".join([*rows, f"D-A,,{actuator},1,,{swapped}", f"D-A,,{actuator},2,{swapped},"]))
    assert len(mavhums.trend(folder, aircraft_table=table)) < 6


def test_a_wrong_table_or_rule_is_an_error(run: Run, logs: list[Path], tmp_path: Path) -> None:
    for given in (("--aircraft-table", tmp_path / "none.csv"), ("--aircraft", "(")):
        assert run("analyse", logs[0], *given).code == ExitCode.ERROR
