"""A flight that several logs record counts once, by its best recording, whatever came first."""

from __future__ import annotations

import itertools
import json
from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mavhums
from mavhums.core.errors import ExitCode
from mavhums.flights.history import PastFlight, with_copies
from mavhums.flights.queries import earlier_flights
from mavhums.flights.recordings import FlightRecording, Quality, superseded_recordings
from mavhums.flights.store import Store
from mavhums.flights.store.earlier import StoredFlights
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.sections import FlightIdentity
from mavhums.results.verdict import Coverage
from mavhums_sim import Flight, fly, write_dataflash, write_tlog
from mavhums_sim.link import Link
from tests.conftest import Run
from tests.fleet.stores import write_store
from tests.flights import START, flown, identity, shown, verdict

LATER = START + timedelta(days=10_000)


def recording(flight: FlightIdentity, decidable: int = 100, log: str = "a") -> FlightRecording:
    return FlightRecording(flight, Quality(4, decidable, 12, True, log))


@pytest.mark.parametrize(
    ("other", "same"),
    [
        (identity(), True),
        (identity(boot_s=-45.0, begin_s=20.0, end_s=500.0), True),  # another clock, a shorter recording
        (identity(boot_s=-80.0, begin_s=-20.0, end_s=580.0), True),
        (identity(boot_s=-80.0, begin_s=590.0, end_s=606.0), False),  # began 10 s after the end
        (identity(boot_s=-100.0), False),  # switched on at another time
        (identity(board="0B"), False),
        (identity(board=None), False),
        (identity().model_copy(update={"vehicle": 2}), False),
        (identity(begin_s=700.0, end_s=1300.0), False),  # the next flight without a power cycle
        (identity(begin_s=400.0, end_s=1200.0), False),  # parts of it in common
        (identity(begin_s=300.0, end_s=900.0), True),
        (identity(begin_s=599.0, end_s=599.0), True),
        (identity().model_copy(update={"end_utc": None}), True),
        (identity().model_copy(update={"boot_utc": None}), False),
    ],
)
def test_recordings_of_one_flight_share_board_boot_and_half_of_their_time(
    other: FlightIdentity, same: bool
) -> None:
    assert identity().is_same(other) is other.is_same(identity()) is same


def test_the_recording_with_more_to_judge_is_taken() -> None:
    order = [
        Quality(4, 300, 48, True, "a"),
        Quality(4, 300, 48, False, "z"),
        Quality(4, 300, 20, True, "b"),
        Quality(4, 200, 48, True, "c"),
        Quality(3, 900, 48, True, "d"),
    ]
    for pair in itertools.combinations([FlightRecording(identity(), one) for one in order], 2):
        assert superseded_recordings(dict(zip(("better", "worse"), pair, strict=True))) == {"worse": "better"}


def test_one_log_of_two_flights_and_a_log_of_each() -> None:
    """Without a power cycle the logger may write one file, and the station two."""
    whole = identity(end_s=1300.0)
    each = {
        "first": recording(identity(), 400, "b"),
        "second": recording(identity(begin_s=700.0, end_s=1300.0), 400, "c"),
    }
    found = superseded_recordings(each | {"whole": recording(whole, 900)})
    assert found == {"first": "whole", "second": "whole"}
    [(copy, counted)] = superseded_recordings(each | {"whole": recording(whole, 300)}).items()
    assert (copy, counted in each) == ("whole", True)


def test_flights_that_began_a_minute_apart_are_not_even_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the cost grows with the square of an aircraft's flights."""
    flights = {n: recording(identity(boot_s=60.0 * n)) for n in range(9)}
    monkeypatch.setattr(FlightIdentity, "is_same", lambda *_: pytest.fail("two flights are compared"))
    assert superseded_recordings(flights) == {}


spans = st.tuples(st.sampled_from([-60.0, -45.0, -30.0, -5.0]), st.integers(0, 9), st.integers(0, 9))


@given(several=st.lists(st.tuples(spans, st.integers(0, 3)), max_size=7), order=st.randoms())
def test_which_recordings_count_does_not_depend_on_their_order(
    several: list[tuple[tuple[float, int, int], int]], order: object
) -> None:
    known = {}
    for number, ((boot_s, begin, length), decidable) in enumerate(several):
        flight = identity(boot_s=boot_s, begin_s=100.0 * begin, end_s=100.0 * (begin + length))
        known[number] = recording(flight, decidable, str(number))
    shuffled = list(known.items())
    order.shuffle(shuffled)  # type: ignore[attr-defined]
    found = superseded_recordings(known)
    assert superseded_recordings(dict(shuffled)) == found
    counted = known.keys() - found.keys()
    for one, other in itertools.combinations(counted, 2):
        assert not known[one].flight.is_same(known[other].flight)
    for copy, taken in found.items():
        assert taken in counted
        assert known[copy].flight.is_same(known[taken].flight)
        assert known[copy].quality < known[taken].quality


def recorded(
    day: float, name: str, value: float, decidable: int, *, boot_s: float = -60.0, end_s: float = 600.0
) -> Assessment:
    covered = Coverage(moving_fraction=1.0, windows=decidable, decidable=decidable)
    judged = verdict(shown(value)).model_copy(update={"coverage": covered})
    return flown(judged, day=day, name=name, identities=[identity(day=day, boot_s=boot_s, end_s=end_s)])


def flights_of(store: Path, *flights: Assessment) -> StoredFlights:
    write_store(store, {"D-A": list(flights)})
    return earlier_flights(Store(store), "D-A")


def test_baselines_and_trends_count_a_flight_once(tmp_path: Path) -> None:
    logged = [recorded(day, f"logged-{day}", 0.2 + 0.01 * (day % 2), 500) for day in range(12)]
    sent = [recorded(day, f"sent-{day}", 0.5, 90, boot_s=-45.0) for day in range(12)]
    known = flights_of(tmp_path / "store", *logged, *sent)
    baseline = known.baselines("paper", LATER)[1, "elevator", "friction"]
    assert baseline.flights == 12
    assert baseline.mean == pytest.approx(0.205)
    assert len(known.past("paper", LATER)[1, "elevator"]) == 12
    assert known.count(PastFlight.of(recorded(99, "later", 0.2, 90))) == 12
    for report in (trend_report(map(PastFlight.of, [*logged, *sent])), mavhums.trend(tmp_path / "store")):
        [trend] = report.trends
        assert report.flights == trend.flights == 12
        assert [*trend.points.log] == [f"logged-{day}.tlog" for day in range(12)]


def test_a_copy_that_was_not_over_does_not_replace_one_that_was(tmp_path: Path) -> None:
    """A better recording that goes on into the next flight cannot be that flight's past."""
    whole = recorded(0, "whole", 0.3, 900, end_s=1300.0)
    whole = whole.model_copy(update={"log": whole.log.model_copy(update={"duration_s": 1300.0})})
    known = flights_of(tmp_path / "store", whole, recorded(0, "first", 0.2, 100))
    for after in (700, 1400):
        assert len(known.past("paper", START + timedelta(seconds=after))[1, "elevator"]) == 1


def test_an_assessment_names_the_other_recordings(tmp_path: Path) -> None:
    sent, another = recorded(0, "sent", 0.2, 90), recorded(1, "another", 0.2, 90)
    known = flights_of(tmp_path / "one", another)
    assert with_copies(sent, known.near(PastFlight.of(sent))) == sent
    others = recorded(0, "logged", 0.2, 500), recorded(0, "relayed", 0.2, 50)
    known = flights_of(tmp_path / "all", another, *others, sent)
    named = with_copies(sent, known.near(PastFlight.of(sent))).log.copies
    assert {(copy.log, copy.counts) for copy in named} == {("logged.tlog", True), ("relayed.tlog", False)}


def test_where_the_better_recording_shows_a_fault_the_worse_is_no_reference(tmp_path: Path) -> None:
    sound = [recorded(day, f"sound-{day}", 0.2, 90) for day in range(11)]
    found = recorded(0, "found", 0.2, 500)
    worn = found.verdicts[0].model_copy(update={"condition": "degraded", "worst": "degraded"})
    known = flights_of(tmp_path / "store", *sound, found.model_copy(update={"verdicts": (worn,)}))
    assert known.baselines("paper", LATER)[1, "elevator", "friction"].flights == 10


@pytest.mark.slow
def test_a_flight_of_two_stations_and_the_card_counts_once(run: Run, tmp_path: Path) -> None:
    kinds = (("csrv", "pwm"), ("instrumented",))
    record, sent = (fly(Flight(seed=3, duration_s=21.0, rate_hz=25.0, tiers=kind)) for kind in kinds)
    logs = [tmp_path / name for name in ("one.tlog", "two.tlog", "card.BIN", "next.tlog")]
    write_tlog(sent, logs[0], Link(day=3.0))
    write_tlog(sent, logs[1], Link(day=3.0, loss=0.01, latency_s=0.2))
    write_dataflash(record, logs[2], day=3.0)
    write_tlog(sent, logs[3], Link(day=4.0))
    store = tmp_path / "flights.sqlite"
    for log in logs:
        last = run("analyse", log, "--store", store, "--keep", "--airframe", "paper")
        assert last.code != ExitCode.ERROR
    assert "also recorded" not in last.out
    outcome = run("analyse", logs[1], "--store", store, "--airframe", "paper", "--verbose")
    assert f"alsorecordedin{logs[2]}and{logs[0]};{logs[0]}counts" in "".join(outcome.out.split())
    status = run("fleet", "status", "--store", store)
    assert f"{logs[1]}: is of the same flight as {logs[0]}, which counts" in status.out
    copies = json.loads(run("fleet", "status", "--store", store, "--json").out)["copies"]
    assert copies == [{"log": str(log), "counted": str(logs[0])} for log in sorted(logs[1:3])]
    [trend] = mavhums.trend(store, actuators=["elevator"], faults=["friction"]).trends
    assert trend.flights == 2
