"""What a store answers, held against the same questions asked without one."""

from __future__ import annotations

import json
import random
import sqlite3
from contextlib import closing
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, event

from mavhums import fleet
from mavhums.core.conditions import URGENCY, Condition
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.flights import queries
from mavhums.flights.history import PastFlight
from mavhums.flights.queries import exit_code
from mavhums.flights.store import Store
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Interval, OwnRecord, Verdict
from tests.conftest import Run
from tests.fleet.stores import write_store
from tests.flights import START, flown, shown, verdict

Made = tuple[Path, dict[str, list[Assessment]]]
CONDITIONS: tuple[Condition, ...] = ("normal", "degraded", "undecided", "emergency", "unchanged")


def flights(seed: int, count: int, *, dated: bool = True) -> list[Assessment]:
    """Return flights of one aircraft with two actuators, in any order of time."""
    rng = random.Random(seed)
    days = rng.sample(range(100), count)
    made = []

    def judged(name: str) -> Verdict:
        one = verdict(shown(rng.uniform(0.2, 0.3)), actuator=name, condition=rng.choice(CONDITIONS))
        friction = Interval(estimate=rng.uniform(0.2, 0.9), low=0.1, high=1.0)
        return one.model_copy(update={"friction_nm": friction})

    for day in days:
        verdicts = [judged("elevator"), judged("rudder's")]
        flight = flown(*verdicts, day=day, name=f"{seed}-{day}'s")
        undated = flight.log.model_copy(update={"start_utc": None})
        made.append(flight if dated else flight.model_copy(update={"log": undated}))
    return made


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    store = tmp_path_factory.mktemp("made") / "store"
    known = {"D'A": flights(1, 7), "D-B": flights(2, 5), "": flights(3, 3) + flights(4, 2, dated=False)}
    write_store(store, known)
    return store, known


EXAMPLES = Path(__file__).parents[2] / "examples"
COMMANDS = (*(("fleet", name) for name in ("worst", "status", "digest", "export")), ("trend", "D-B"))


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["header", "page", "text"])
def test_a_damaged_store_is_an_error_of_every_command(run: Run, tmp_path: Path, damage: str) -> None:
    store = tmp_path / "store"
    write_store(store, {"D-B": flights(2, 3)})
    if damage == "text":
        with sqlite3.connect(store) as base:
            base.execute("UPDATE standing SET standings = '[{'")
        base.close()
    else:
        content = store.read_bytes()
        every_other = bytes(byte * (k % 2) for k, byte in enumerate(content))
        store.write_bytes(every_other if damage == "page" else b"S" + bytes(len(content) - 1))
    for *command, last in COMMANDS:
        if damage == "text" and "trend" in command:  # it asks the flights alone
            continue
        output = ["-o", tmp_path / "out.csv"] if last == "export" else []
        outcome = run(*command, last, "--store", store, *output)
        assert outcome.code == ExitCode.ERROR
        assert f"{store}: the store cannot be read" in outcome.err
        assert "restore it from a backup" in outcome.err
        assert len(outcome.err.splitlines()) == 2


def test_a_flight_has_its_verdicts_or_is_none(made: Made) -> None:
    store, known = made
    for one in known["D'A"][:2]:
        found = queries.flight(store, "D'A", one.log.sha256 or "")
        assert (found.log, found.verdicts) == (one.log, one.verdicts)
    for aircraft, sha256 in (("D-B", known["D'A"][0].log.sha256 or ""), ("D'A", "00")):
        with pytest.raises(MavhumsError, match=f"no such flight of the aircraft \"?'?{aircraft}"):
            queries.flight(store, aircraft, sha256)


def last_flights(known: dict[str, list[Assessment]]) -> list[tuple[str, str, str]]:
    """Return aircraft, log and actuator, the worst first: the oracle in plain Python."""
    rows = []
    for aircraft, several in known.items():
        newest = max((flight.log.start_utc or "" for flight in several), default="")
        for flight in several:
            if aircraft and flight.log.start_utc != newest:
                continue
            for each in flight.verdicts:
                assert each.friction_nm is not None
                order = (-URGENCY[each.gravest], -each.friction_nm.estimate)
                rows.append((order, (aircraft, flight.log.path or "", each.actuator)))
    return [row for _, row in sorted(rows)]


def test_worst_is_every_actuator_in_its_last_flight(made: Made) -> None:
    store, known = made
    expected = last_flights(known)
    found = [(one.aircraft or "", one.log, one.verdict.actuator) for one in fleet.worst(store)]
    assert sorted(found) == sorted(expected)
    assert [one for one in found if not one[0]] == [one for one in expected if not one[0]]
    ranks = [one.standing.rank[:2] for one in fleet.worst(store) if one.standing]
    assert ranks == sorted(ranks)
    assert len(fleet.worst(store, most=3)) == 3
    verdicts = {
        (aircraft, flight.log.path, each.actuator): each
        for aircraft, several in known.items()
        for flight in several
        for each in flight.verdicts
    }
    for one in fleet.worst(store):
        assert one.verdict == verdicts[one.aircraft or "", one.log, one.verdict.actuator]
    assert exit_code(store) in (ExitCode.EMERGENCY, ExitCode.DEGRADED)


def test_a_trend_is_that_of_the_same_flights_in_memory(made: Made) -> None:
    store, known = made
    expected = trend_report(map(PastFlight.of, known["D'A"]))
    assert fleet.trend(store, "D'A").to_json() == expected.to_json()
    with pytest.raises(MavhumsError) as refused:
        fleet.trend(store, "D-C")
    assert "D'A, D-B" in (refused.value.remedy or "")
    with pytest.raises(MavhumsError, match="unknown aircraft"):
        fleet.trend(store, "")


def test_the_example_dashboard_asks_what_the_store_has(made: Made) -> None:
    store, known = made
    board = json.loads((EXAMPLES / "grafana.json").read_text(encoding="utf-8"))
    asked = [panel["targets"][0]["rawSql"] for panel in board["panels"]]
    with Store(store).reading() as connection:
        worst, trend, days, failed = (
            connection.exec_driver_sql(sql.replace("$aircraft", "D-B")).all() for sql in asked
        )
        names = connection.exec_driver_sql(board["templating"]["list"][1]["query"]).all()
    assert [(row.aircraft, row.actuator) for row in worst].count(("D-B", "elevator")) == 1
    assert len(trend) == 2 * len(known["D-B"])
    assert sum(row.flights for row in days) == sum(map(len, known.values())) - 2
    assert (failed, [row.name for row in names]) == ([], ["D'A", "D-B"])


def test_no_question_reads_a_whole_table(made: Made) -> None:
    asked: list[tuple[str, Any]] = []

    def note(*given: Any) -> None:
        asked.append(given[2:4])

    store, _ = made
    event.listen(Engine, "before_cursor_execute", note)
    try:
        for ask in (fleet.status, fleet.worst, exit_code, queries.actuators_in):
            ask(store)
        fleet.trend(store, "D-B")
        queries.flights(store, "D-B")
        write_store(store, {})
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    with closing(sqlite3.connect(store)) as base:
        plans = {
            step: text
            for text, given in asked
            if text.startswith(("SELECT", "UPDATE"))
            for *_, step in base.execute(f"EXPLAIN QUERY PLAN {text}", given)
        }
    large = ("flight", "verdict", "log", "recording", "record", "indicator")
    assert any("verdict_last" in step for step in plans)
    assert any("flight_due" in step for step in plans)
    assert [plans[step] for step in plans if step in {f"SCAN {name}" for name in large}] == []


def test_of_earlier_flights_a_comparison_reads_few_records(tmp_path: Path) -> None:
    own = (OwnRecord(equation="own_current", setup="-", rate_hz=10.0, duration_s=9.0, groups=((9.0,),)),)
    learning = verdict(condition="learning").model_copy(update={"own": own})
    write_store(tmp_path / "store", {"D-A": [flown(learning, day=day) for day in range(100)]})
    read: list[int] = []

    def note(*given: Any) -> None:
        read.extend([len(given[3])] * ("record.own" in given[2]))

    earlier = queries.earlier_flights(Store(tmp_path / "store"), "D-A")
    event.listen(Engine, "before_cursor_execute", note)
    try:
        past = earlier.past("paper", START + timedelta(days=200))[1, "elevator"]
        assert len(past) == 100
        assert read == []
        assert [*past[99].records, *past[98].records] == [*own, *own]
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    assert len(read) == 1
    assert read[0] < 40, "with those around them"
