"""The second pass: new flights alone, or in parts, have the verdicts of one replay of all flights."""

from __future__ import annotations

import os
import random
import sys
import time
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from functools import partial
from importlib import import_module
from pathlib import Path

import pytest

from mavhums.app.analysis import analyse_alone
from mavhums.app.settings import Options
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.aircraft_table import Since
from mavhums.flights.compare import compared, packed
from mavhums.flights.history import FlightHistory
from mavhums_sim import Flight, fly, write_tlog
from tests.flights import identity
from tests.health.self_baseline.servo import Servo, left

pytest.importorskip("deltalake")
pytest.importorskip("duckdb")
distributed = pytest.importorskip("distributed")
cloudpickle = pytest.importorskip("cloudpickle")

from mavhums import fleet  # noqa: E402
from mavhums.fleet.second_pass import (  # noqa: E402
    FlightSpan,
    PartResult,
    compare_part,
    rows_of,
    second_pass,
)
from mavhums.flights.checkpoint import (  # noqa: E402
    FlightEntry,
    Superseded,
    _follow,
)
from mavhums.flights.corrections import Repair, add_repairs  # noqa: E402
from mavhums.flights.store import Store  # noqa: E402
from tests.fleet.stores import row_of  # noqa: E402

NAME = "D-A"
DAY = timedelta(days=1)
Rows = list[dict[str, object]]


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> list[StandaloneAssessment]:
    """Three flights of a healthy aircraft and one of it with a worn elevator, each judged alone."""
    path = tmp_path_factory.mktemp("kinds") / "flight.tlog"
    flights = []
    for seed, friction in ((0, 0.225), (1, 0.225), (2, 0.225), (8, 0.3)):
        wear = {"elevator": (friction, friction)}
        write_tlog(fly(Flight(seed, 21.0, wear, rate_hz=25.0, tiers=("instrumented",))), path)
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
    changed = {
        "path": f"{name}.tlog",
        "sha256": name,
        "start_utc": start.isoformat(),
        "flight": (identity().model_copy(update=times),),
    }
    verdicts = list(kind.assessment.verdicts)
    if own:
        learning = {"condition": "learning", "worst": "learning", "indicators": ()}
        record = left(Servo(), own, seconds=60.0)
        verdicts[-1] = verdicts[-1].model_copy(update=learning | {"own": (record,)})
    told = {"log": log.model_copy(update=changed), "verdicts": tuple(verdicts)}
    return kind._replace(assessment=kind.assessment.model_copy(update=told))


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


def since(seed: int) -> Callable[[datetime], Since]:
    """Return no date for most seeds, and one in the middle for others."""
    return partial(_since, datetime.fromisoformat("2026-01-03T00:00:00+00:00") if seed % 4 == 3 else None)


def _since(date: datetime | None, moment: datetime) -> Since:
    return {"rudder": date} if date and date <= moment else {}


def sequential(
    flights: Sequence[StandaloneAssessment], dates: Callable[[datetime], Since]
) -> tuple[Rows, object]:
    """Judge each flight by the whole history before it."""
    history = FlightHistory()
    rows: Rows = []
    for flight in flights:
        start = flight.assessment.log.start_utc
        given = dates(datetime.fromisoformat(start)) if start else {}
        assessment = compared(
            flight, partial(history.baselines, since=given), partial(history.past, since=given)
        )
        rows += rows_of(NAME, assessment)
        if start:
            history = history.with_flight(assessment)
    paths = {flight.log: flight.assessment.log.path for flight in history.flights}
    return rows, {key: paths[taken] for key, taken in history.superseded_recordings().items()}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_in_any_parts_the_verdicts_are_those_of_the_whole_history(
    kinds: list[StandaloneAssessment], seed: int
) -> None:
    flights, dates = fleet_of(kinds, seed), since(seed)
    rows, copies = sequential(flights, dates)
    assert copies
    assert any("drift" in str(row["verdict"]) for row in rows)
    cuts = sorted(random.Random(seed).sample(range(1, len(flights)), 3))
    part: PartResult | None = None
    found: Rows = []
    left_out: Superseded = {}
    for first, last in zip([0, *cuts], [*cuts, len(flights)], strict=True):
        data = [packed(flight) for flight in flights[first:last]]
        part = compare_part(FlightSpan(NAME, data, dates, part and part.checkpoint, whole=True))
        assert part is not None
        found += part.rows
        left_out |= part.superseded
    assert found == rows
    assert part is not None
    assert left_out | part.open_superseded == copies


@pytest.mark.slow
def test_a_flight_that_needs_all_records_is_refused_where_they_were_not_kept(
    kinds: list[StandaloneAssessment],
) -> None:
    before = compare_part(FlightSpan(NAME, [packed(on(0, kinds[0]))], since(0)))
    assert before is not None
    for own, settled in ((1, False), (0, True)):
        again = packed(on(1e-5, kinds[0], name="again", own=own))
        assert compare_part(FlightSpan(NAME, [again], since(0), before.checkpoint, settled)) is None
    assert (
        compare_part(FlightSpan(NAME, [packed(on(1, kinds[0]))], since(0), before.checkpoint, final=True))
        is not None
    )


class Judged:
    """Counts the flights of which the second pass makes verdicts."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.flights = 0
        monkeypatch.setattr(import_module("mavhums.fleet.second_pass"), "compare_part", self._counted)

    def _counted(self, part: FlightSpan) -> PartResult | None:
        self.flights += len(part.flights)
        return compare_part(part)

    def in_scan(self, store: Store, *flights: StandaloneAssessment) -> int:
        """Return how many flights are judged when some land."""
        self.flights = 0
        if flights:
            store.add_logs([row_of(flight.assessment, NAME, flight) for flight in flights])
        second_pass(store, [NAME])
        return self.flights


def told(place: Path) -> list[tuple[str, str]]:
    return [(log, verdict.model_dump_json()) for log, verdict in fleet.verdicts(place, NAME)]


def afresh(place: Path, flights: Sequence[StandaloneAssessment], repairs: Sequence[Repair] = ()) -> object:
    """Return what a store tells into which all flights come at once."""
    store = Store(place)
    store.add_logs([row_of(flight.assessment, NAME, flight) for flight in flights])
    add_repairs(store, repairs)
    second_pass(store, [NAME])
    return told(place), fleet.status(place).copies


@pytest.mark.slow
def test_a_landing_judges_its_flight_only_and_what_changes_the_past_all(
    kinds: list[StandaloneAssessment], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged, store = Judged(monkeypatch), Store(tmp_path / "store")
    flights = [on(day, kinds[3 if day > 11 else day % 3]) for day in range(14)]
    assert judged.in_scan(store, *flights[:11]) == 11
    assert judged.in_scan(store, flights[12]) == 1
    assert judged.in_scan(store) == 0
    assert judged.in_scan(store, flights[11]) >= 13  # a late log
    assert judged.in_scan(store, flights[13]) == 1
    copy = on(13 + 1e-5, kinds[0], name="copy", boot_s=-58.0)
    assert judged.in_scan(store, copy) >= 15
    again = on(14, kinds[3])
    assert judged.in_scan(store, again) == 1
    assert judged.in_scan(store, again) >= 16  # judged again, with other limits perhaps
    assert (told(tmp_path / "store"), fleet.status(tmp_path / "store").copies) == afresh(
        tmp_path / "all", [*flights, copy, again]
    )
    repair = Repair(NAME, None, datetime.fromisoformat("2026-01-05T00:00:00+00:00"))
    assert add_repairs(store, [repair]) == {NAME}
    assert judged.in_scan(store) == 16
    last = on(15, kinds[3])
    assert judged.in_scan(store, last) == 1
    assert (told(tmp_path / "store"), fleet.status(tmp_path / "store").copies) == afresh(
        tmp_path / "repaired", [*flights, copy, again, last], [repair]
    )


@pytest.mark.slow
def test_own_scale_flights_are_judged_with_all_that_were_kept(
    kinds: list[StandaloneAssessment], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged, store = Judged(monkeypatch), Store(tmp_path / "store")
    flights = [on(day, kinds[day % 3], own=day // 2) for day in range(6)]
    assert judged.in_scan(store, *flights[:2]) == 2
    assert judged.in_scan(store, flights[2]) > 3  # the first; earlier flights had kept nothing for it
    assert judged.in_scan(store, *flights[3:5]) == 2
    assert judged.in_scan(store, flights[5]) == 1
    assert told(tmp_path / "store") == afresh(tmp_path / "all", flights)[0]  # type: ignore[index]


@pytest.mark.slow
def test_verdicts_whose_state_was_lost_are_made_again(
    kinds: list[StandaloneAssessment], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged, store = Judged(monkeypatch), Store(tmp_path / "store")
    flights = [on(day, kinds[day % 3]) for day in range(4)]
    assert judged.in_scan(store, *flights[:2]) == 2

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(import_module("mavhums.fleet.second_pass"), "store_checkpoint", die)
        with pytest.raises(KeyboardInterrupt):
            judged.in_scan(store, flights[2])
    assert store.waiting() == {NAME}
    assert judged.in_scan(store, flights[3]) == 4
    assert store.waiting() == set()
    assert told(tmp_path / "store") == afresh(tmp_path / "all", flights)[0]  # type: ignore[index]


@pytest.mark.slow
def test_flights_judged_again_before_an_interruption_are_waiting(
    kinds: list[StandaloneAssessment], tmp_path: Path
) -> None:
    store, flight = Store(tmp_path), on(0, kinds[0])
    for _ in range(2):
        store.add_logs([row_of(flight.assessment, NAME, flight)])
        assert store.waiting() == {NAME}
        second_pass(store, [NAME])
        assert store.waiting() == set()


class Dies(distributed.WorkerPlugin):  # type: ignore[misc, name-defined]
    """A worker that dies over the flights of an aircraft, so often."""

    def __init__(self, times: int, count: Path) -> None:
        self.times, self.count = times, count

    def setup(self, worker: object) -> None:
        past = import_module("mavhums.fleet.second_pass")
        judge = past.compare_part

        def deadly(part: FlightSpan) -> PartResult | None:
            if part.aircraft == NAME and len(list(self.count.iterdir())) < self.times:
                (self.count / str(time.time_ns())).touch()
                os.kill(os.getpid(), 9)
            return judge(part)  # type: ignore[no-any-return]

        past.compare_part = deadly  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize("times", [0, 1, 1000])
def test_workers_make_the_same_verdicts_whether_they_die_or_not(
    kinds: list[StandaloneAssessment], tmp_path: Path, times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights = [on(day, kinds[day % 3]) for day in range(14)]
    expected = afresh(tmp_path / "all", flights)[0]  # type: ignore[index]
    monkeypatch.setattr(import_module("mavhums.fleet.second_pass"), "_PART_FLIGHTS", 5)
    store, names = Store(tmp_path / "store"), [NAME, "D-B", "D-C"]
    store.add_logs([row_of(each.assessment, name, each) for name in names for each in flights])
    (tmp_path / "count").mkdir()
    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import the tests
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.register_plugin(Dies(times, tmp_path / "count"))
        second_pass(store, names, client)
    for name in names:
        assert [
            (log, verdict.model_dump_json()) for log, verdict in fleet.verdicts(tmp_path / "store", name)
        ] == expected
    assert store.waiting() == set()


@pytest.mark.parametrize(
    ("settled", "new", "aircraft", "follows"),
    [
        ([1, 2], [3], NAME, True),
        ([1, 3], [2], NAME, False),
        ([1, 3], [3], NAME, False),
        ([1, 3, None], [4, None], NAME, True),
        ([1, 3, None], [2, None], NAME, False),
        ([], [1], NAME, True),
        ([1], [], NAME, True),
        ([None], [None], NAME, True),
        ([1, 3], [2], "", True),  # flights of no known aircraft are not compared
    ],
)
def test_new_flights_are_judged_alone_if_they_come_last(
    settled: list[int | None], new: list[int | None], aircraft: str, follows: bool
) -> None:
    before, after = ([FlightEntry("", 0, start, "") for start in starts] for starts in (settled, new))
    assert _follow(before, after, aircraft) == follows
