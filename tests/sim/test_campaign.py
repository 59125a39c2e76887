"""Campaigns: the paper's eight conditions and their ground truth."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mavhums_sim.campaign import CAMPAIGNS, PAPER_FRICTION_NM, paper_campaign, run_campaign, write_truth


def test_paper_campaign_holds_the_papers_conditions_and_one_that_grows() -> None:
    flights = dict(paper_campaign(seed=3, duration_s=10.0))
    constant = [f.friction_nm["elevator"] for name, f in flights.items() if name != "friction-growing"]
    assert constant == [(t, t) for t in PAPER_FRICTION_NM]
    assert flights["friction-growing"].friction_nm["elevator"] == (0.225, 1.0)
    assert len({flight.seed for flight in flights.values()}) == len(flights) == 9
    assert CAMPAIGNS["paper"] is paper_campaign


def test_campaign_writes_a_log_per_flight_and_the_truth(tmp_path: Path) -> None:
    flights = list(paper_campaign(seed=1, duration_s=2.0))[:2]
    seen: list[tuple[int, int]] = []
    truth = run_campaign(flights, tmp_path / "logs", lambda done, total: seen.append((done, total)))
    entries = json.loads(truth.read_text())["flights"]
    assert [entry["log"] for entry in entries] == ["friction-0.225.tlog", "friction-0.275.tlog"]
    assert all((truth.parent / entry["log"]).stat().st_size > 0 for entry in entries)
    assert entries[1]["actuators"]["elevator"]["friction_nm"]["start"] == pytest.approx(0.275)
    assert seen == [(1, 2), (2, 2)]


def test_truth_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "truth.json"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_truth([{"not": object()}], path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
