"""The trend over flights as a user meets it: the table, the frame, the JSON, and the exit code."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import mavhums
from mavhums import fleet
from mavhums.core.conditions import Condition
from mavhums.core.errors import ExitCode
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared
from mavhums.flights.history import PastFlight
from mavhums.flights.trends import trend_report
from mavhums.health.decision.baseline import Baseline
from mavhums.results.standing import TrendReport
from mavhums.results.verdict import Evidence, Indicator, Interval
from mavhums.show.standing import sentence
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.dataflash import records as rows
from mavhums_sim.dataflash import write_records
from mavhums_sim.link import Link
from tests.conftest import Run
from tests.fleet.stores import table, write_store
from tests.fleet_logs import records
from tests.flights import START, flown, shown, verdict, write_wear
from tests.present import present


@pytest.fixture(scope="module")
def worn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty flights in which the elevator wears by 0.005 N·m each, and the rudder does not."""
    store = tmp_path_factory.mktemp("worn") / "store"
    write_wear(store)
    return store


def test_the_wearing_actuator_comes_first_with_its_flights_left(run: Run, worn: Path) -> None:
    outcome = run("trend", "--store", worn)
    assert outcome.code == ExitCode.DEGRADED
    assert outcome.err == ""
    lines = outcome.out.splitlines()
    assert lines[0].startswith("elevator: DEGRADED since flight ")
    assert "elevator grows: " in " ".join(lines[:3])
    rows = [line.strip() for line in lines if line.strip().startswith(("elevator ", "rudder "))]
    assert [row.split()[0] for row in rows] == ["elevator", "rudder"]
    assert "▁▂▃▄▅▆▇█" in rows[0]
    assert "elevator: Coulomb friction grows by 0.00" in outcome.out
    assert "rudder: no remaining useful life (RUL): no growth" in outcome.out
    assert max(map(len, lines)) <= 80


def test_json_holds_the_truth_within_its_interval(run: Run, worn: Path) -> None:
    report = json.loads(run("trend", "--store", worn, "--json").out)
    assert report["schema"] == "mavhums.trend/1"
    elevator, rudder = report["trends"]
    # From 0.225 N·m in the first of 40 flights it grows by 0.005 each: 0.42 in the last, 0.875 after 91 more.
    left = elevator["flights_left"]
    assert left["low"] <= 91 <= left["high"] < 100
    assert elevator["per_flight"]["low"] < 0.005 < elevator["per_flight"]["high"]
    assert elevator["level"]["low"] < 0.225 + 39 * 0.005 < elevator["level"]["high"]
    assert elevator["change"]["low"] > 0
    assert rudder["flights_left"] is None
    assert rudder["change"]["low"] < 0 < rudder["change"]["high"]
    assert len(rudder["points"]["flight"]) == rudder["flights"] == report["flights"] == 40


def test_the_table_has_a_row_for_each_flight(run: Run, worn: Path, tmp_path: Path) -> None:
    frame = mavhums.trend(worn).to_frame()
    assert list(frame.columns) == [
        *("vehicle", "actuator", "airframe", "fault", "quantity", "unit", "flight", "start_utc", "log"),
        *("estimate", "low", "high", "condition", "limit", "emergency", "highest", "end"),
    ]
    assert len(frame) == 80
    elevator = frame[frame["actuator"] == "elevator"]
    assert elevator["start_utc"].is_monotonic_increasing
    assert elevator["start_utc"].iloc[0] == START
    assert (elevator["flight"] == np.arange(1, 41)).all()
    assert (elevator["emergency"] == 0.875).all()
    csv, parquet = tmp_path / "t.csv", tmp_path / "t.parquet"
    for output in (csv, parquet):
        assert run("trend", "--store", worn, "--actuator", "elevator", "-o", output).code == ExitCode.DEGRADED
    read = pd.read_csv(csv, parse_dates=["start_utc"])
    pd.testing.assert_frame_equal(read, elevator.reset_index(drop=True), check_dtype=False)
    pd.testing.assert_frame_equal(pd.read_parquet(parquet), read, check_dtype=False)
    bad = run("trend", "--store", worn, "-o", tmp_path / "t.xlsx")
    assert bad.code == ExitCode.ERROR
    assert "use the extension .parquet or .csv" in bad.err


def wearing(
    count: int, per_flight: float, shows: Callable[[float, int], Indicator | None] = lambda at, day: shown(at)
) -> TrendReport:
    """The report of flights in which the friction grows by so much each."""
    flights = []
    for day in range(count):
        one = shows(0.225 + per_flight * day + 0.003 * np.cos(2.4 * day), day)
        flights.append(PastFlight.of(flown(verdict(*filter(None, [one])), day=day)))
    return trend_report(flights)


def test_flights_that_could_not_be_judged_count() -> None:
    """Wear goes on while nobody looks: every other flight shows nothing, and counts."""
    (one,) = wearing(40, 0.01, lambda at, day: None if day % 2 else shown(at)).trends
    assert one.flights == 40
    assert one.points.flight == (*range(1, 40, 2),)
    assert present(one.per_flight).estimate == pytest.approx(0.01, rel=0.02)


def test_what_grows_without_an_emergency_limit_has_no_remaining_life() -> None:
    (one,) = wearing(20, 0.02, lambda at, _: shown(at, fault="backlash")).trends
    assert (one.flights_left, one.reason) == (None, "it grows, but has no emergency limit")


def test_what_all_flights_share_makes_no_line_uncertain() -> None:
    """The torque scale widens every interval alike, and bends no line."""

    def wear(half: float) -> float:
        def wide(at: float, _: int) -> Indicator:
            return shown(at).model_copy(
                update={"value": Interval(estimate=at, low=at - half, high=at + half)}
            )

        left = present(wearing(20, 0.02, wide).trends[0].flights_left)
        return left.high - left.low

    assert wear(0.1) == wear(0.004)


def test_flights_of_one_window_are_weighted_by_their_interval() -> None:
    def level(error: float) -> float:
        def alone(at: float, day: int) -> Indicator:
            one = shown(at, error=error if day == 9 else 0.002)
            return one.model_copy(update={"windows": 1, "scatter": None})

        (one_trend,) = wearing(20, 0.02, alone).trends
        assert one_trend.baseline is None
        assert one_trend.change is None
        return present(one_trend.level).estimate

    assert level(0.002) != level(0.02)


@pytest.mark.slow
def test_flights_that_only_their_files_date_are_in_the_order_of_boots(tmp_path: Path) -> None:
    """A board counts its boots; the logs have no date, and copies of them have the times of the copying."""

    def trend(days: Sequence[int]) -> Any:
        flights = []
        for boots, day in enumerate(days, start=7):
            path = tmp_path / f"{boots}.BIN"
            written_s = (START + timedelta(days=day)).timestamp()
            board = b"CubeOrange 00112233 44556677 8899AABB"
            records = [
                rows("MSG", np.zeros(1), Message=board),
                rows("PARM", np.zeros(1), Name=b"STAT_BOOTCNT", Value=boots),
                rows("RCOU", np.arange(0.0, 20.0, 0.1), C1=1500),
            ]
            write_records(records, path)
            os.utime(path, (written_s, written_s))
            judged = verdict(shown(0.22 + 0.01 * boots + 0.001 * (boots % 3)))
            assessment = mavhums.analyse(path).model_copy(update={"verdicts": (judged,)})
            flights.append(PastFlight.of(assessment))
        return trend_report(flights).trends

    [right], [wrong] = trend(range(8)), trend([3, 2, 7, 0, 1, 6, 5, 4])
    assert right == wrong
    [same] = trend([0] * 8)
    assert (same.change, same.per_flight) == (right.change, right.per_flight)
    assert right.per_flight is not None


def test_a_repair_is_given_by_its_date(run: Run, tmp_path: Path) -> None:
    flights = []
    for day in range(40):
        value = 0.3 + 0.01 * day if day < 20 else 0.21 + 0.01 * (day - 20)
        jitter = 0.003 * np.cos(2.4 * day)
        both = (verdict(shown(value + jitter)), verdict(shown(0.2 + jitter), actuator="rudder"))
        flights.append(flown(*both, day=day))
    store = tmp_path / "store"
    write_store(store, {"D-A": flights})
    before = json.loads(run("trend", "--store", store, "--json").out)["trends"]
    elevator = next(one for one in before if one["actuator"] == "elevator")
    assert (elevator["step"]["flight"], elevator["step"]["better"]) == (21, True)
    assert elevator["growth"]["since_flight"] >= 21
    words = " ".join(run("trend", "--store", store).out.split())
    assert "fell by 0.2" in words
    assert "in one step at flight 21 (2026-03-21): a repair or swap?" in words
    date = (START + timedelta(days=20)).date().isoformat()
    assert run("fleet", "repairs", "--store", store, "--add", f"elevator={date}").code == 0
    outcome = run("trend", "--store", store, "--json")
    assert outcome.code == ExitCode.DEGRADED
    elevator, rudder = json.loads(outcome.out)["trends"]
    assert elevator["flights"] == 40
    assert elevator["baseline"]["estimate"] == pytest.approx(0.21, abs=0.01)
    assert elevator["flights_left"]["low"] <= (0.875 - 0.41) / 0.01 + 1 <= elevator["flights_left"]["high"]
    assert rudder["flights"] == 40


def test_one_odd_flight_is_named(run: Run, tmp_path: Path) -> None:
    values = [0.225 + 0.01 * day + 0.003 * np.cos(2.4 * day) + 0.2 * (day == 7) for day in range(20)]
    flights = [flown(verdict(shown(value)), day=day) for day, value in enumerate(values)]
    write_store(tmp_path / "store", {"D-A": flights})
    outcome = run("trend", "--store", tmp_path / "store")
    assert outcome.code == ExitCode.DEGRADED
    assert "elevator: outlier, left out of the trend line: 2026-03-08 09:00 UTC." in outcome.out
    assert "until emergency" in " ".join(outcome.out.splitlines()[:3])


def test_aircraft_and_profiles_are_kept_apart(run: Run, tmp_path: Path) -> None:
    flights = [flown(verdict(shown(0.2)), verdict(shown(0.3), vehicle=2), day=day) for day in range(9)]
    other = verdict(shown(0.4))
    flights += [flown(other, day=day, name=f"other-{day}", airframe="other") for day in range(9)]
    write_store(tmp_path / "store", {"D-A": flights})
    report = mavhums.trend(tmp_path / "store")
    shown_of = {(one.vehicle, one.airframe): {*one.points.estimate} for one in report.trends}
    assert shown_of == {(1, "paper"): {0.2}, (2, "paper"): {0.3}, (1, "other"): {0.4}}
    printed = run("trend", "--store", tmp_path / "store").out
    assert "2: elevator [paper]" in printed
    assert "1: elevator [other]" in printed


@pytest.mark.parametrize(
    ("last", "indicator", "code"),
    [
        ("normal", True, ExitCode.OK),
        ("degraded", True, ExitCode.DEGRADED),
        ("emergency", True, ExitCode.EMERGENCY),
        ("undecided", True, ExitCode.UNDECIDED),
        ("normal", False, ExitCode.UNDECIDED),
    ],
)
def test_the_exit_code_is_of_the_last_flight(
    run: Run, tmp_path: Path, last: Condition, indicator: bool, code: ExitCode
) -> None:
    indicators = (shown(0.2),) * indicator
    conditions: tuple[Condition, ...] = ("normal", "normal", last)
    flights = [flown(verdict(*indicators, condition=one), day=day) for day, one in enumerate(conditions)]
    write_store(tmp_path / "store", {"D-A": flights})
    outcome = run("trend", "--store", tmp_path / "store")
    assert outcome.code == code
    if indicator:
        assert "3 flights show it; a trend needs 8" in outcome.out
    else:
        assert outcome.out.startswith("No flight carries an indicator of a fault (3 flights)")
        assert "elevator: no indicator in any flight; in the last one normal" in outcome.out


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("trend", ExitCode.ERROR, "mavhums analyse LOG --keep"),
        ("trend --store /nowhere", ExitCode.ERROR, "/nowhere: no store of flights"),
        ("trend D-B --store WORN", ExitCode.ERROR, "the store has: D-A"),
        ("trend --store WORN --actuator flap", ExitCode.ERROR, "the flights show: elevator, rudder"),
        ("trend --store WORN --fault frictoin", ExitCode.ERROR, "the flights show: effectiveness, friction"),
        ("fleet repairs --store WORN --add flap=2026-03-01", ExitCode.ERROR, "no actuator flap"),
        ("fleet repairs --store WORN --add March", ExitCode.USAGE, "write 2026-03-01"),
        ("analyse x.tlog --keep --store none", ExitCode.USAGE, "--keep needs a store"),
    ],
)
def test_mistakes_are_one_line_and_a_remedy(
    run: Run, worn: Path, arguments: str, code: ExitCode, message: str
) -> None:
    outcome = run(*arguments.replace("WORN", str(worn)).split())
    assert outcome.code == code
    assert message in outcome.err
    assert "Traceback" not in outcome.err


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three short healthy flights, a day apart."""
    paths = [tmp_path_factory.getbasetemp() / f"flight-{day}.tlog" for day in range(3)]
    for day, path in enumerate(paths):
        record = fly(Flight(seed=40 + day, duration_s=15.0, rate_hz=25.0))
        write_tlog(record, path, Link(day=59.0 + day))  # the first of March
    return paths


def test_one_command_after_each_landing_keeps_the_history(
    run: Run, logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user's own store: nothing is made before the first flight is kept."""
    store = tmp_path / "own" / "flights.sqlite"
    monkeypatch.setenv("MAVHUMS_STORE", str(store))
    assert "Compared with" not in run("analyse", logs[0]).out
    assert not store.parent.exists()
    for count, log in enumerate(logs):
        outcome = run("analyse", log, "--keep")
        assert (outcome.code, outcome.err) == (ExitCode.OK, f"mavhums: 1 log is kept in {store}\n")
        assert fleet.status(store).judged == count + 1
        earlier = f"Compared with {count} earlier flight{'s' if count > 1 else ''} of this aircraft."
        assert (earlier in outcome.out) == (count > 0)
    assert run("analyse", logs[0], "--keep").code == ExitCode.OK
    assert "Compared with 2 earlier flights" in run("analyse", logs[2]).out
    assert "Compared with" not in run("analyse", logs[2], "--store", "none").out
    assert "3 flights" in run("trend").out
    (name,) = (str(row["name"]) for row in table(store, "aircraft"))
    several = run("analyse", *logs, "--keep", "--store", tmp_path / "at-once", "--json")
    assert several.code == ExitCode.OK
    assert fleet.verdicts(tmp_path / "at-once", name) == fleet.verdicts(store, name)
    assert [*dict(fleet.verdicts(store, name))] == [str(log) for log in logs]


def test_what_cannot_be_kept_is_shown_all_the_same(run: Run, logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "store").write_bytes(b"no database")
    outcome = run("analyse", logs[0], "--store", tmp_path / "store", "--keep")
    assert outcome.code == ExitCode.ERROR
    assert "cannot be read" in outcome.err
    assert "elevator" in outcome.out


def test_a_log_without_a_date_has_no_baseline(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str | None, datetime | None]] = []

    def baselines(airframe: str | None, before: datetime | None) -> dict[tuple[int, str, str], Baseline]:
        asked.append((airframe, before))
        return {}

    for log, undated in ((logs[0], False), (tmp_path / "flight.raw", True)):
        if undated:
            log.write_bytes(b"".join(frame for _, frame in records(logs[0].read_bytes())))
        engine = mavhums.Engine()
        engine.feed(log.read_bytes())
        engine.finish()
        said = compared(StandaloneAssessment(engine.assessment(), {}), baselines).log.start_utc
        assert (said is None) == undated
        assert {(name, before and before.isoformat()) for name, before in asked} == (
            set() if undated else {("paper", said)}
        )
        asked.clear()


def test_a_fault_without_an_indicator_is_reported_as_by_analyse(run: Run, tmp_path: Path) -> None:
    """An axis may be degraded by what no indicator shows; one that was not asked for hides no fault."""
    rolled = verdict(actuator="roll", condition="degraded").model_copy(update={"subject": "axis"})
    slack = verdict(shown(0.3, fault="backlash"), actuator="rudder", condition="degraded")
    write_store(tmp_path / "store", {"D-A": [flown(rolled, slack)]})
    outcome = run("trend", "--store", tmp_path / "store")
    assert outcome.code == ExitCode.DEGRADED
    assert outcome.out.splitlines()[0] == "roll and rudder: DEGRADED in the last flight (1 flight)"
    assert "roll: degraded in the last flight." in outcome.out
    states = json.loads(run("trend", "--store", tmp_path / "store", "--json").out)["standings"]
    assert {one["actuator"]: one["last"] for one in states} == {"roll": "degraded", "rudder": "degraded"}
    write_store(tmp_path / "store", {"D-A": [flown(verdict(actuator="roll"), verdict(shown(0.2)), day=1)]})
    later = run("trend", "--store", tmp_path / "store", "--actuator", "roll")
    assert later.code == ExitCode.DEGRADED  # one flight without it ends no fault
    assert "roll: degraded since flight 1 of 2 (2026-03-01); not seen in the last flight." in later.out


def test_an_emergency_is_listed_with_its_highest_value(run: Run, tmp_path: Path) -> None:
    """The mean of a flight in which friction grows lies below the limit that was passed."""
    found = Evidence(kind="friction", start_s=70.0, end_s=99.0, value=0.951, limit=0.875, rule="emergency")
    before = found.model_copy(update={"start_s": 0.0, "end_s": 70.0, "value": 0.37, "rule": "normal"})
    changes = {"friction_nm": Interval(estimate=0.93, low=0.92, high=0.94), "evidence": (before, found)}
    grew = verdict(shown(0.56), condition="emergency").model_copy(update=changes)
    write_store(tmp_path / "store", {"D-A": [flown(grew)]})
    outcome = run("trend", "--store", tmp_path / "store")
    assert outcome.code == ExitCode.EMERGENCY
    text = " ".join(outcome.out.split())
    assert "Coulomb friction up to 0.951 N·m (limit 0.875 N·m)" in text
    frame = mavhums.trend(tmp_path / "store").to_frame()
    assert frame[["estimate", "highest", "end"]].iloc[0].tolist() == [0.56, 0.951, 0.93]
    [state] = mavhums.trend(tmp_path / "store").standings
    assert sentence(state).endswith("friction up to 0.951 N·m (limit 0.875 N·m)")


def test_a_fault_is_not_shown_of_an_indicator_within_its_limit(run: Run, tmp_path: Path) -> None:
    worn = verdict(shown(0.95), shown(0.1, fault="backlash"), condition="emergency", suspect="friction")
    write_store(tmp_path / "store", {"D-A": [flown(worn)]})
    outcome = run("trend", "--store", tmp_path / "store", "--fault", "all")
    assert outcome.code == ExitCode.EMERGENCY
    rows = [line for line in outcome.out.splitlines() if line.startswith(" elevator")]
    assert ["EMERGENCY" in row for row in rows] == [True, False]
