"""The date of a flight: a clock that was set while it recorded, a cut beginning, no date at all."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

import pytest
from rich.console import Console

from mavhums.app.analysis import analyse_alone
from mavhums.app.settings import Options
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared
from mavhums.show.terminal import render
from tests.fleet_logs import records
from tests.judge import judged
from tests.live.conftest import verdicts

HEALTHY = Path(__file__).parents[1] / "data" / "healthy.tlog"


SOUND = [*records(HEALTHY.read_bytes())]


def log_of(stamped: list[tuple[int, bytes]]) -> bytes:
    return b"".join(time_us.to_bytes(8, "big") + frame for time_us, frame in stamped)


@pytest.mark.slow
@pytest.mark.parametrize("size", [10_000, 1 << 22])
def test_a_clock_that_is_set_in_flight_is_no_pause(size: int) -> None:
    first, third = SOUND[0][0], len(SOUND) // 3
    early = [(time_us - first + 10_000_000, frame) for time_us, frame in SOUND[:third]]
    found, right = (judged(log, size=size)[0] for log in (log_of(early + SOUND[third:]), log_of(SOUND)))
    assert found.log.duration_s == pytest.approx(right.log.duration_s, abs=0.1)
    starts = [datetime.fromisoformat(one.log.start_utc or "") for one in (found, right)]
    assert abs((starts[0] - starts[1]).total_seconds()) < 0.1
    conditions = [[(v.actuator, v.condition) for v in one.verdicts] for one in (found, right)]
    assert conditions[0] == conditions[1]


@pytest.mark.parametrize("cut", [3, 9, 14])
def test_a_log_that_begins_within_a_frame_begins_with_the_next_time(cut: int) -> None:
    sound = SOUND[:400]
    found = judged(log_of(sound)[cut:])[0]
    assert (found.log.start_utc or "")[:4] == datetime.fromtimestamp(sound[0][0] / 1e6).strftime("%Y")
    assert found.log.duration_s == pytest.approx((sound[-1][0] - sound[0][0]) / 1e6, abs=1.0)


def undated() -> bytes:
    return log_of([(time_us % 10**9, frame) for time_us, frame in SOUND[:400]])


def test_a_log_without_a_date_says_that_it_is_not_compared() -> None:
    alone = judged(undated())[0]
    assert alone.log.start_utc is None
    found = compared(StandaloneAssessment(alone, {}), lambda *_: {})
    assert "no date" in found.log.notices[-1]
    assert verdicts(found) == verdicts(alone)
    console = Console(record=True, width=200)
    render(found, console)
    assert "\nNot compared with earlier flights: the log has no date" in console.export_text()


@pytest.mark.parametrize(
    ("name", "began", "source"),
    [
        ("2022-05-24_15-52-12.tlog", "2022-05-24T15:52:12+00:00", "name"),
        ("20220524 155212.tlog", "2022-05-24T15:52:12+00:00", "name"),
        ("2022-13-41_15-52-12.tlog", None, "time"),
        ("flight.tlog", None, "time"),
    ],
)
def test_a_log_without_a_date_is_compared_by_that_of_its_file(
    tmp_path: Path, name: str, began: str | None, source: str
) -> None:
    log = tmp_path / name
    log.write_bytes(undated())
    os.utime(log, (1_700_000_000, 1_700_000_000))
    flight = analyse_alone(log, Options().resolved())
    summary = compared(flight, lambda *_: {}).log
    ended = datetime.fromtimestamp(1_700_000_000 - summary.duration_s, UTC).isoformat()
    assert summary.start_utc == (began or ended)
    assert summary.notices[-1].startswith(f"dated by the {source} of its file: the log has no date")
    assert summary.flight[0].start_utc is None  # other logs of the flight are found by clocks alone
