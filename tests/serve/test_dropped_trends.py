"""Trends over dropped logs: those of one board, without a store."""

from __future__ import annotations

from pathlib import Path

import pytest

from mavhums.results.assessment import Assessment
from mavhums.serve.sessions import Dropped
from mavhums.serve.views import dropped_trends
from tests.flights import flown, identity, shown, verdict


def dropped(folder: Path, number: int, assessment: Assessment | None) -> Dropped:
    log = Dropped(str(number), folder / str(number) / "f.tlog", state="done" if assessment else "judging")
    if assessment:
        log.assessment.parent.mkdir(parents=True)
        log.assessment.write_text(assessment.to_json(), encoding="utf-8")
    return log


def flight(day: int, board: str | None = "0A", value: float = 0.2) -> Assessment:
    return flown(
        verdict(shown(value)), day=day, name=f"{board}{day}", identities=[identity(day=day, board=board)]
    )


def test_the_flights_of_a_board_have_a_trend(tmp_path: Path) -> None:
    growing = [flight(day, value=0.2 + 0.02 * day) for day in (2, 0, 3, 1)]
    others = [flight(4, "0B"), flight(5, None), None]
    logs = [dropped(tmp_path, k, one) for k, one in enumerate([*growing, *others])]
    [one], left = dropped_trends(logs)
    assert (one.board, one.flights, left) == ("0A", 4, 2)
    [trend] = one.report.trends
    assert trend.points.estimate == pytest.approx((0.2, 0.22, 0.24, 0.26))


def test_what_was_removed_or_has_no_date_is_left_out(tmp_path: Path) -> None:
    undated = flight(1).model_copy(update={"log": flight(1).log.model_copy(update={"start_utc": None})})
    logs = [dropped(tmp_path, k, flight(k)) for k in range(2)] + [dropped(tmp_path, 7, undated)]
    removed = dropped(tmp_path, 8, flight(8))
    removed.assessment.unlink()
    assert dropped_trends([*logs, removed]) == ([], 4)
