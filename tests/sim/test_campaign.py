"""Campaigns: the paper's eight conditions and their ground truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mavhums_sim import Flight, FlightRecord
from mavhums_sim.campaign import (
    CAMPAIGNS,
    PAPER_FRICTION_NM,
    consume,
    paper_campaign,
    run_campaign,
    write_truth,
)
from mavhums_sim.link import Link
from mavhums_sim.manoeuvres import CYCLOGRAMS


def test_paper_campaign_holds_the_papers_conditions_and_one_that_grows() -> None:
    flights = dict(paper_campaign(seed=3, duration_s=10.0))
    constant = [f.friction_nm["elevator"] for name, f in flights.items() if name != "friction-growing"]
    assert constant == [(t, t) for t in PAPER_FRICTION_NM]
    assert flights["friction-growing"].friction_nm["elevator"] == (0.225, 1.0)
    assert len({flight.seed for flight in flights.values()}) == len(flights) == 9
    assert CAMPAIGNS["paper"] is paper_campaign


def test_truth_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_truth([{"not": object()}], path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def peak(name: str, record: FlightRecord) -> tuple[str, float]:
    return name, float(np.abs(record.actuators["elevator"].values[:, 4]).max())


@pytest.mark.slow
def test_consumer_gets_every_flight_in_order_on_any_number_of_processes() -> None:
    flights = [(str(seed), Flight(seed=seed, duration_s=1.0)) for seed in range(4)]
    one = list(consume(flights, peak))
    two = list(consume(iter(flights), peak, workers=2))
    assert [name for name, _ in one] == [str(seed) for seed in range(4)]
    assert one == two
    assert all(result[0] == name for name, result in one)


def test_interrupted_campaign_is_resumed(tmp_path: Path) -> None:
    flights = list(paper_campaign(seed=1, duration_s=1.0))

    def stop(done: int, total: int) -> None:
        if done == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(flights, tmp_path, stop)
    assert not (tmp_path / "truth.json").exists()
    with (tmp_path / "truth.jsonl").open("a") as journal:
        journal.write('{"log": "cut')
    times = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.tlog")}
    assert len(times) == 4
    seen: list[tuple[int, int]] = []
    truth = run_campaign(flights, tmp_path, lambda *step: seen.append(step))
    assert seen == [(done, 9) for done in range(5, 10)]
    assert all(path.stat().st_mtime_ns == time for path, time in times.items())
    entries = json.loads(truth.read_text())["flights"]
    assert [entry["log"] for entry in entries] == [f"{name}.tlog" for name, _ in flights]
    assert entries[1]["actuators"]["elevator"]["friction_nm"]["start"] == pytest.approx(0.275)
    assert not (tmp_path / "truth.jsonl").exists()


def test_only_what_changed_is_flown_again(tmp_path: Path) -> None:
    flights = list(paper_campaign(seed=1, duration_s=1.0))[:3]
    run_campaign(flights, tmp_path)
    changed = [*flights[:2], (flights[2][0], replace(flights[2][1], seed=77))]
    seen: list[int] = []
    run_campaign(changed, tmp_path, lambda done, total: seen.append(done))
    assert seen == [3]
    (tmp_path / "friction-0.225.tlog").unlink()
    run_campaign(changed, tmp_path, lambda done, total: seen.append(done))
    assert seen == [3, 3]
    run_campaign(changed, tmp_path, lambda done, total: seen.append(done), link=Link(loss=0.1))
    assert seen == [3, 3, 1, 2, 3]
    for seed in (0, 1, 1):  # replayed flights differ by their commands
        replayed = [("turns", Flight(duration_s=1.0, cyclogram=CYCLOGRAMS["turns"](seed, 1.0)))]
        run_campaign(replayed, tmp_path / "turns", lambda done, total: seen.append(done))
    assert seen[5:] == [1, 1]
