"""What changed since yesterday: the difference of what the store says and what it said then."""

from __future__ import annotations

import csv
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mavhums.core.errors import ExitCode
from mavhums.fleet import digest, worst
from mavhums.results.assessment import Assessment
from mavhums.results.standing import FleetDigest
from mavhums.show.standing import digest_blocks
from mavhums.show.terminal import plain
from tests.conftest import Run
from tests.fleet.stores import write_store
from tests.flights import START, flown, shown, verdict


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Flights of two aircraft; their states are stored after 15, 24 and 40 days."""
    folder = tmp_path_factory.mktemp("fleet") / "store"
    rng = np.random.default_rng(2)

    def flights(name: str, days: int, slope: float) -> list[Assessment]:
        values = 0.215 + slope * np.arange(days) + 0.006 * rng.standard_normal(days)
        verdicts = [verdict(shown(value)) for value in values.tolist()]
        return [flown(one, day=day, name=f"{name}-{day}") for day, one in enumerate(verdicts)]

    grows, still = flights("G", 40, 0.005), flights("S", 20, 0.0)
    for days in (5, 24, 40):
        flown_then = {"D-G": grows[:days], "D-S": still[: min(days, 20)]}
        write_store(folder, flown_then, START + timedelta(days=days))
    return folder


def between(store: Path, first: float, last: float) -> FleetDigest:
    return digest(store, START + timedelta(days=first), START + timedelta(days=last))


@pytest.mark.slow
def test_growth_is_reported_when_it_becomes_certain_and_a_finding_when_it_is_one(store: Path) -> None:
    (grows,) = between(store, 6, 25).changes
    assert (grows.kind, grows.aircraft, grows.now.condition) == ("growing", "D-G", "normal")
    (new,) = between(store, 25, 40.5).changes
    assert (new.kind, new.now.condition) == ("new", "degraded")
    assert new.before is not None
    lines = plain(digest_blocks(between(store, 25, 40.5))).splitlines()
    assert lines[0].startswith("1 new, 1 not heard of since 2026-03-26 09:00 UTC:")
    assert any("D-G elevator: degraded since flight " in line for line in lines)
    assert any("D-S: last flight 2026-03-20" in line for line in lines)


@pytest.mark.slow
def test_nothing_to_say_is_one_line(store: Path) -> None:
    quiet = between(store, 41, 42)
    assert quiet.is_empty
    assert (quiet.standing, quiet.silent_longer) == (1, 1)
    (line,) = plain(digest_blocks(quiet)).splitlines()
    assert line.startswith("Nothing new since 2026-04-11 09:00 UTC")
    assert line.endswith("of 2 aircraft; 1 finding open; 1 silent for longer")


def test_the_command_ends_with_0_whatever_is_new_unless_asked(run: Run, store: Path, tmp_path: Path) -> None:
    since = (START + timedelta(days=25)).date().isoformat()
    news = run("fleet", "digest", "--store", store, "--since", since, "--json", "--html", tmp_path / "d.html")
    assert news.code == ExitCode.OK
    assert {one["kind"] for one in json.loads(news.out)["changes"]} == {"new"}
    assert "<h2>New findings</h2>" in (tmp_path / "d.html").read_text(encoding="utf-8")
    news = run("fleet", "digest", "--store", store, "--since", since, "--fail-on-news")
    assert news.code == ExitCode.DEGRADED
    assert "D-G elevator" in news.out
    later = datetime.now(UTC) + timedelta(days=1)
    assert run("fleet", "digest", "--store", store, "--since", later.isoformat(), "--quiet").out == ""
    assert run("fleet", "digest", "--store", store, "--since", "yesterday").code == ExitCode.USAGE


@pytest.mark.slow
def test_a_table_and_the_status_give_the_flights_left(run: Run, store: Path, tmp_path: Path) -> None:
    (growth,) = (row.standing.growth for row in worst(store) if row.standing and row.standing.growth)
    assert growth.to_emergency is not None
    assert "D-G elevator: Coulomb friction grows by 0.0" in run("fleet", "status", "--store", store).out
    (said,) = json.loads(run("fleet", "status", "--store", store, "--json").out)["growing"]
    assert (said["aircraft"], said["standing"]["growth"]["since_flight"]) == ("D-G", growth.since_flight)
    for name in ("t.csv", "t.parquet"):
        assert run("fleet", "export", "--store", store, "-o", tmp_path / name).code == ExitCode.OK
    with (tmp_path / "t.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["aircraft"] == "D-G"]
    assert [row["state"] for row in rows] == [""] * 39 + ["degraded"], "in the row of the last flight alone"
    last = rows[-1]
    assert float(last["flights_to_emergency"]) == pytest.approx(growth.to_emergency.estimate)
    assert last["date_emergency"] == growth.to_emergency.expected_utc
    assert float(last["flights_to_degraded"]) == 0.0
    table = pd.read_parquet(tmp_path / "t.parquet")
    assert table["flights_to_emergency"].notna().sum() == 1
    assert str(table["start_utc"].dtype).startswith("datetime64")
