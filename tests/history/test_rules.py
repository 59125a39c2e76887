"""The rules over flights at their boundaries: dates, states, ranks, names and messages, each by hand."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mavhums.core.conditions import Condition
from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import (
    AircraftResolver,
    aircraft_of,
    board_of,
    check_aircraft_rule,
)
from mavhums.flights.history import PastFlight, PastIndicator
from mavhums.flights.recordings import recordings_of, superseded_recordings
from mavhums.flights.reports import _kinds
from mavhums.flights.standing import Flown, flights_left, standing_of, step_of
from mavhums.results.standing import Growth, Standing, Step
from mavhums.results.verdict import Coverage, Evidence, Verdict
from tests.flights import START, flown, growth, identity, left, shown, standing, verdict
from tests.history.test_copies import recording

DAY = timedelta(days=1)


def flight(number: int, day: float, judged: Verdict | None = None) -> Flown:
    judged = judged or verdict()
    past = PastFlight.of(flown(judged, day=day))
    return Flown(number, past, past.start.isoformat(), past.verdicts[0], judged.gravest)


def step(at: int, *, fault: str = "friction", better: bool = True) -> Step:
    day = (START + at * DAY).isoformat()
    return Step(fault=fault, quantity=fault, unit="N·m", flight=at, at_utc=day, size=-1.0, better=better)


def test_dates_follow_from_the_last_twenty_flights() -> None:
    """Five flights at long intervals come first; the last twenty are half a day apart."""
    several = [flight(k, 100.0 * k) for k in range(1, 6)]
    several += [flight(k, 600 + 0.5 * (k - 6)) for k in range(6, 26)]
    found = flights_left((2.0, 4.0, 8.0), several, 4.0)
    dates = [(START + days * DAY).date().isoformat() for days in (610.5, 611.5, 613.5)]
    dated = dict(zip(("earliest_utc", "expected_utc", "latest_utc"), dates, strict=True))
    assert found == left(4.0, 2.0, 8.0).model_copy(update=dated)
    assert not left(4.0, 2.0, 8.0).is_far
    far = flights_left((2.0, 4.0, inf), several, 3.9)
    assert far is not None
    assert (far.high, far.latest_utc, far.is_far) == (None, None, True)
    assert flights_left((2.0, inf, inf), several, 4.0) is None


@pytest.mark.parametrize(("ahead", "dated"), [(36_524, True), (36_525, False)])
def test_no_date_is_given_beyond_a_hundred_years(ahead: float, dated: bool) -> None:
    found = flights_left((ahead, ahead, ahead), [flight(1, 0), flight(2, 1)], 0.0)
    assert found is not None
    assert (found.expected_utc is not None) is dated


@pytest.mark.parametrize("days", [(0.0,), (0.0, 0.0)])
def test_flights_without_a_rate_give_no_dates(days: tuple[float, ...]) -> None:
    several = [flight(k, day) for k, day in enumerate(days, 1)]
    assert flights_left((1.0, 2.0, 3.0), several, 9.0) == left(2.0, 1.0, 3.0)


@pytest.mark.parametrize(("fault", "better"), [("friction", False), ("effectiveness", True)])
def test_a_step_is_the_difference_of_five_flights_before_and_after(fault: str, better: bool) -> None:
    values = [9.0, 9.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 8.0, 9.0, 10.0, 11.0, 99.0]
    several = [PastIndicator.of(shown(value, fault=fault), ()) for value in values]
    pairs = [(flight(k, k), one) for k, one in enumerate(several, 1)]
    found = step_of(pairs, 7)
    assert (found.flight, found.size, found.better) == (8, 6.0, better)


def standing_after(conditions: str, steps: tuple[Step, ...] = (), grows: tuple[Growth, ...] = ()) -> Standing:
    """Return the standing after flights: d for degraded, n for normal, u for undecided, each a day later."""
    names: Mapping[str, Condition] = {"d": "degraded", "n": "normal", "u": "undecided", "e": "emergency"}
    judged = {
        letter: verdict(shown(0.2), condition=condition, suspect=None if letter in "nu" else "friction")
        for letter, condition in names.items()
    }
    several = [flight(k, k, judged[letter]) for k, letter in enumerate(conditions, 1)]
    trends: Any = [SimpleNamespace(fault=one.fault, step=one, growth=None) for one in steps]
    trends += [SimpleNamespace(fault="friction", step=None, growth=one) for one in grows]
    return standing_of(several, trends)


@pytest.mark.parametrize(
    ("conditions", "expected"),
    [
        ("nnn", ("normal", None, 0)),
        ("ndnnnn", ("degraded", 2, 4)),
        ("ndnnnnn", ("normal", None, 0)),
        ("ndnnnndn", ("degraded", 2, 1)),  # not five in a row
        ("ndnnnnnd", ("degraded", 8, 0)),
        ("ndununun", ("degraded", 2, 3)),  # what was not decided neither ends it nor counts
        ("ednn", ("emergency", 1, 3)),
        ("ednnnn", ("degraded", 1, 4)),
        ("u", ("undecided", None, 0)),
    ],
)
def test_a_fault_ends_after_five_judged_flights_without_it(
    conditions: str, expected: tuple[Condition, int | None, int]
) -> None:
    found = standing_after(conditions)
    assert (found.condition, found.since_flight, found.clear_flights) == expected


@pytest.mark.parametrize(
    ("steps", "condition"),
    [
        ((step(4),), "normal"),
        ((step(3),), "degraded"),
        ((step(4, better=False),), "degraded"),
        ((step(4, fault="backlash"),), "degraded"),
        ((step(2), step(4)), "normal"),
    ],
)
def test_a_step_to_the_better_after_the_fault_ends_it(steps: tuple[Step, ...], condition: str) -> None:
    assert standing_after("dddnn", steps).condition == condition


def test_only_a_step_of_the_last_twenty_flights_is_kept_and_the_soonest_growth() -> None:
    thirty = "n" * 30
    assert standing_after(thirty, (step(10),)).step is None
    assert standing_after(thirty, (step(11),)).step == step(11)
    assert standing_after(thirty, (step(20), step(25), step(15))).step == step(25)
    late, soon, never = growth(left(50.0)), growth(left(60.0), left(9.0)), growth()
    assert standing_after(thirty, grows=(late, soon, never)).growth == soon
    assert standing_after(thirty, grows=(never, late)).growth == late


def test_a_finding_without_an_indicator_rests_on_its_rule() -> None:
    jam = Evidence(kind="jam", start_s=0.0, end_s=1.0, value=0.1, limit=0.5, rule="degraded: it did not move")
    judged = verdict(shown(0.2), condition="degraded").model_copy(update={"evidence": (jam,)})
    found = standing_of([flight(1, 0, judged)], [])
    assert (found.fault, found.limit, found.quantity) == ("jam", 0.5, "degraded: it did not move")


SOON, LATE = growth(left(10.0)), growth(left(10.1), left(99.0))


@pytest.mark.parametrize(
    ("was", "now", "kinds"),
    [
        (None, standing("normal"), []),
        (None, standing("undecided"), []),
        (None, standing("degraded"), ["new"]),
        (standing("normal"), standing("degraded"), ["new"]),
        (standing("undecided"), standing("degraded", SOON), ["new"]),
        (standing("degraded"), standing("emergency"), ["worse"]),
        (standing("degraded"), standing("changed"), []),
        (standing("emergency"), standing("degraded"), ["eased"]),
        (standing("degraded"), standing("normal"), ["gone"]),
        (standing("degraded", LATE), standing("normal", LATE), ["eased"]),
        (None, standing("normal", LATE), ["growing"]),
        (standing("normal"), standing("normal", LATE), ["growing"]),
        (standing("normal", LATE), standing("normal", LATE), []),
        (standing("normal", LATE), standing("normal", SOON), ["growing"]),
        (standing("normal", SOON), standing("normal", LATE), []),
        (standing("normal", SOON), standing("normal"), ["gone"]),
        (standing("degraded", SOON), standing("degraded"), []),
        (standing("normal"), standing("normal", None, step(4)), ["step"]),
        (standing("normal", None, step(4)), standing("normal", None, step(4)), []),
        (standing("normal", None, step(3)), standing("degraded", None, step(4)), ["new", "step"]),
    ],
)
def test_what_changed_between_two_standings(was: Standing | None, now: Standing, kinds: list[str]) -> None:
    assert [*_kinds(was, now)] == kinds


@pytest.mark.parametrize("rule", ["=", "(", "x", "(?P<name>x)"])
def test_rules_that_cannot_identify_an_aircraft(rule: str) -> None:
    with pytest.raises(MavhumsError, match="--aircraft"):
        check_aircraft_rule(rule)


def test_a_rule_that_does_not_match_gives_no_name(tmp_path: Path) -> None:
    assert aircraft_of("x.tlog", "(?P<aircraft>D-[A-Z]+)") == ""
    assert aircraft_of("x.tlog", "(?P<aircraft>D)?x") == ""
    archive = tmp_path / "D-A" / "logs.zip"
    archive.parent.mkdir()
    archive.touch()
    assert aircraft_of(f"{archive}/x.tlog", "folder") == "D-A"
    resolver = AircraftResolver("=D-A", renamed={"D-A": "D-B"})
    assert [resolver.name(None, None, None), AircraftResolver().name("x", "0A", None)] == ["D-B", None]


@pytest.mark.parametrize(("apart_s", "joined"), [(30.0, True), (30.1, False)])
def test_recordings_whose_boots_lie_half_a_minute_apart_may_be_one_flight(
    apart_s: float, joined: bool
) -> None:
    two = {"a": recording(identity(boot_s=-60.0), 9), "b": recording(identity(boot_s=-60.0 + apart_s), 1)}
    assert superseded_recordings(two) == ({"b": "a"} if joined else {})
    end = two | {"c": recording(identity(boot_s=500.0, begin_s=900.0, end_s=950.0))}
    assert superseded_recordings(end) == superseded_recordings(two)


def test_the_quality_of_a_recording_is_of_its_vehicle_alone() -> None:
    def one(actuator: str, condition: Condition, decidable: int, vehicle: int = 1) -> Verdict:
        covered = Coverage(moving_fraction=1.0, windows=99, decidable=decidable)
        changes = {"coverage": covered, "provenance": {"V1": "x", "V5": "y"}}
        return verdict(actuator=actuator, condition=condition, vehicle=vehicle).model_copy(update=changes)

    several = [one("elevator", "normal", 5), one("rudder", "undecided", 3), one("flap", "unmonitored", 0)]
    several += [one("all", "normal", 50), one("elevator", "normal", 70, vehicle=2)]
    [found] = recordings_of(flown(*several, identities=[identity()]))
    assert found.quality[:4] == (1, 8, 6, True)
    assert found.quality.log == flown().log.sha256
    undated = identity().model_copy(update={"end_utc": "yesterday"})
    assert recordings_of(flown(*several, identities=[identity(board=None), undated])) == ()


@pytest.mark.parametrize(
    ("boards", "board"),
    [((), None), (("0A",), "0A"), (("0A", "0A"), "0A"), (("0A", "0B"), None), (("0A", None), None)],
)
def test_a_log_has_a_board_if_all_its_flights_have_the_same(
    boards: tuple[str | None, ...], board: str | None
) -> None:
    assert board_of(flown(verdict(), identities=[identity(board=one) for one in boards])) == board
