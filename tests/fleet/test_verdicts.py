"""The verdicts of a store are those of one replay of all flights, whatever the order of arrival."""

from __future__ import annotations

import random
from collections.abc import Sequence
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from unittest.mock import patch

import pytest

from mavhums import fleet
from mavhums.app.analysis import analyse_alone
from mavhums.app.settings import Options
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared
from mavhums.flights.history import PastFlight, baselines_of, records_of, superseded
from mavhums.flights.store import Row
from tests.fleet.stores import add, row_of, table, verdicts_of
from tests.fleet_logs import small
from tests.flights import flown, identity, shown, verdict
from tests.health.self_baseline.servo import Servo, left

NAME = "D-A"
DAY = timedelta(days=1)
VerdictTexts = dict[str, list[str]]


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> list[StandaloneAssessment]:
    """Three flights of a healthy aircraft and one of it with a worn elevator, each judged alone."""
    path = tmp_path_factory.mktemp("kinds") / "flight.tlog"
    flights = []
    for log in (small(0), small(1), small(2), small(8, 0.3)):
        path.write_bytes(log)
        flights.append(analyse_alone(path, Options().resolved()))
    return flights


def on(
    day: float, kind: StandaloneAssessment, *, name: str = "", boot_s: float = -60.0, own: int = 0
) -> StandaloneAssessment:
    """Return a flight as flown on a day; ``own`` is the seed of the own-scale record of one servo."""
    log = kind.assessment.log
    start = datetime.fromisoformat(log.start_utc or "") + day * DAY
    boot, end = start + timedelta(seconds=boot_s), start + timedelta(seconds=log.duration_s)
    times = {"boot_utc": boot.isoformat(), "start_utc": start.isoformat(), "end_utc": end.isoformat()}
    name = name or f"{day:06.2f}"
    flown = (identity().model_copy(update=times),)
    changed = {"path": f"{name}.tlog", "sha256": name, "start_utc": start.isoformat(), "flight": flown}
    verdicts = list(kind.assessment.verdicts)
    if own:
        learning = {"condition": "learning", "worst": "learning", "indicators": ()}
        record = left(Servo(), own, seconds=60.0)
        verdicts[-1] = verdicts[-1].model_copy(update=learning | {"own": (record,)})
    changes = {"log": log.model_copy(update=changed), "verdicts": tuple(verdicts)}
    return kind._replace(assessment=kind.assessment.model_copy(update=changes))


def fleet_of(kinds: Sequence[StandaloneAssessment], seed: int) -> list[StandaloneAssessment]:
    """Return more flights than a baseline has, the last ones worn; some twice, undated or own-scale."""
    rng = random.Random(seed)
    flights = []
    for day in range(25):
        kind = kinds[3] if day > 21 else kinds[rng.randrange(3)]
        own = day + 1 if rng.random() < (0.0, 0.3, 1.0)[seed % 3] else 0
        flights.append(on(day, kind, own=own))
        if rng.random() < 0.2:
            other = on(day + 1e-5, kinds[rng.randrange(3)], name=f"{day:06.2f} again", boot_s=-58.0)
            flights.append(other)
    undated = kinds[0].assessment.log.model_copy(update={"start_utc": None, "sha256": "x", "flight": ()})
    return [*flights, kinds[0]._replace(assessment=kinds[0].assessment.model_copy(update={"log": undated}))]


def sequential(flights: Sequence[StandaloneAssessment]) -> tuple[VerdictTexts, dict[str, str]]:
    """Judge each flight by the whole history before it; return the verdicts by log, and the copies."""
    history: list[PastFlight] = []
    judged: VerdictTexts = {}
    for flight in flights:
        start = flight.assessment.log.start_utc
        assessment = compared(flight, partial(baselines_of, history), partial(records_of, history))
        judged[assessment.log.path or ""] = sorted(one.model_dump_json() for one in assessment.verdicts)
        if start:
            history.append(PastFlight.of(assessment))
    paths = {flight.log: flight.path or "" for flight in history}
    copies = {paths[log]: paths[taken] for (log, _), (taken, _) in superseded(history).items()}
    return {log: verdicts for log, verdicts in judged.items() if log not in copies}, copies


def rows_of(flights: Sequence[StandaloneAssessment]) -> list[Row]:
    return [row_of(flight.assessment, NAME, flight) for flight in flights]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_in_any_order_and_parts_the_verdicts_are_those_of_the_whole_history(
    kinds: list[StandaloneAssessment], tmp_path: Path, seed: int
) -> None:
    flights = fleet_of(kinds, seed)
    verdicts, copies = sequential(flights)
    assert any("drift" in each for several in verdicts.values() for each in several)
    rng, store = random.Random(seed), tmp_path / "store"
    arriving = rows_of(flights)
    if seed > 2:
        rng.shuffle(arriving)
    cuts = sorted(rng.sample(range(1, len(flights)), 3))
    for first, last in zip([0, *cuts], [*cuts, len(flights)], strict=True):
        add(store, *arriving[first:last])
    assert verdicts_of(store, NAME) == verdicts
    assert {one.log: one.counted for one in fleet.status(store).copies} == copies
    assert not any(row["due"] for row in table(store, "flight"))


@pytest.mark.parametrize(
    ("day", "again"),
    [(27.5, 1), (28.5, 1), (0.5, 29)],  # itself, and for the last one all but the first
    ids=["after the baseline", "the latest", "within the baseline"],
)
def test_a_late_flight_compares_again_what_it_changes(tmp_path: Path, day: float, again: int) -> None:
    """Twenty flights are a baseline, and five more may replace copies among them."""
    several = [flown(verdict(shown(0.2)), day=day) for day in (*range(29), day)]
    *there, late = (row_of(one, NAME) for one in several)
    add(tmp_path / "store", *there)
    with patch("mavhums.flights.store.verdicts.compared", wraps=compared) as comparing:
        add(tmp_path / "store", late)
    assert comparing.call_count == again
    add(tmp_path / "other", *there, late)
    assert verdicts_of(tmp_path / "store", NAME) == verdicts_of(tmp_path / "other", NAME)
