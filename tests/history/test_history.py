"""A folder of flights: what is read of it, what is not, and the baselines that come out of it."""

from __future__ import annotations

import json
import os
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavhums.core.conditions import Condition
from mavhums.core.errors import MavhumsError
from mavhums.flights.folder import keep_assessment, read_history
from mavhums.flights.history import FlightHistory, PastFlight, kept_records
from mavhums.flights.trends import trend_report
from mavhums.health.decision.baseline import Baseline
from mavhums.health.self_baseline.thresholds import REFERENCE_FLIGHTS
from mavhums.results.assessment import SCHEMA, Assessment
from mavhums.results.standing import to_frame
from mavhums.results.verdict import OwnRecord
from mavhums.show.terminal import plain
from mavhums.show.trend import trend_blocks
from tests.flights import START, flown, identity, shown, verdict, write_wear

KEY = (1, "elevator", "friction")
LATER = START + timedelta(days=10_000)


def history(*assessments: Assessment) -> FlightHistory:
    return FlightHistory(tuple(PastFlight.of(assessment) for assessment in assessments))


def test_flights_come_in_the_order_of_time_whatever_their_names(tmp_path: Path) -> None:
    for day, name in ((2, "a"), (0, "b"), (1, "c")):
        keep_assessment(flown(verdict(), day=day, name=name), tmp_path)
    several = [json.loads(flown(verdict(), day=day).to_json()) for day in (4, 3)]
    whole = json.dumps({"schema": SCHEMA, "assessments": several})
    (tmp_path / "0-several.json").write_text(whole, encoding="utf-8")
    flights = read_history(tmp_path).flights
    assert [(flight.start - START).days for flight in flights] == [0, 1, 2, 3, 4]


def test_the_offset_from_utc_is_heeded() -> None:
    early = flown(verdict(), name="early")
    log = early.log.model_copy(update={"start_utc": "2026-03-01T11:00:00+03:00"})
    assert PastFlight.of(early.model_copy(update={"log": log})).start == START - timedelta(hours=1)


def test_a_date_that_is_none_is_quoted_up_to_sixty_characters() -> None:
    for said, quoted in (("x" * 60, "x" * 60), ("y" * 61, "y" * 60)):
        flight = flown(verdict(), name="odd")
        log = flight.log.model_copy(update={"start_utc": said})
        with pytest.raises(MavhumsError) as refused:
            PastFlight.of(flight.model_copy(update={"log": log}))
        expected = f"odd.tlog: log.start_utc '{quoted}' and the duration give no time"
        assert refused.value.problem == expected


def test_a_log_judged_again_counts_once_as_judged_last(tmp_path: Path) -> None:
    old, new = flown(verdict(shown(0.2))), flown(verdict(shown(0.3)))
    (tmp_path / "z.json").write_text(old.to_json(), encoding="utf-8")
    (tmp_path / "a.json").write_text(new.to_json(), encoding="utf-8")
    os.utime(tmp_path / "z.json", (1e9, 1e9))
    read = read_history(tmp_path)
    assert [flight.assessment for flight in read.flights] == [new]
    assert "judged again" in read.notices[0]
    os.utime(tmp_path / "a.json", (1e8, 1e8))
    assert [flight.assessment for flight in read_history(tmp_path).flights] == [old]
    keep_assessment(flown(verdict(), airframe="other"), tmp_path)
    assert len(read_history(tmp_path).flights) == 2


def test_what_is_kept_is_read_back_and_never_shares_a_name(tmp_path: Path) -> None:
    first, second = flown(verdict(shown(0.2)), name="x/log"), flown(verdict(shown(0.3)), name="y/log", day=1)
    paths = {keep_assessment(each, tmp_path / "new") for each in (first, second, first)}
    assert len(paths) == 2
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(path.name for path in paths)
    assert [flight.assessment for flight in read_history(tmp_path / "new").flights] == [first, second]
    odd = flown(verdict(), name="../a\nb é*?")
    assert keep_assessment(odd, tmp_path).parent == tmp_path
    (tmp_path / "file").touch()
    with pytest.raises(MavhumsError, match="file"):
        keep_assessment(first, tmp_path / "file")


def test_an_interruption_leaves_no_half_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        keep_assessment(flown(verdict()), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_ours_is_left_alone(tmp_path: Path) -> None:
    keep_assessment(flown(verdict()), tmp_path)
    (tmp_path / "flight.tlog").write_bytes(b"\xfd")
    (tmp_path / "notes.txt").write_text("{", encoding="utf-8")
    (tmp_path / ".half.json").write_text("{", encoding="utf-8")
    keep_assessment(flown(verdict(), day=1), tmp_path / "other.json")
    for name, content in (("package", {"name": "x"}), ("list", [1]), ("other", {"schema": "else/1"})):
        (tmp_path / f"{name}_.json").write_text(json.dumps(content), encoding="utf-8")
    read = read_history(tmp_path)
    assert len(read.flights) == 1
    assert read.errors == ()
    assert len(read.notices) == 3
    assert all("is not an assessment" in notice for notice in read.notices)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text[: len(text) // 2], "not a complete JSON"),
        (lambda _: "", "not a complete JSON"),
        (lambda _: "\0" * 500, "not a complete JSON"),
        (lambda text: text.replace("0.2", "NaN"), "not a complete JSON"),
        (lambda _: "[" * 100_000, "not a complete JSON"),
        (lambda text: text.replace("assessment/2", "assessment/9"), "mavhums.assessment/9"),
        (
            lambda text: text.replace("assessment/2", "assessment/" + "9" * 43),
            f"the schema 'mavhums.assessment/{'9' * 41}', not",
        ),
        (lambda text: text.replace('"normal"', '"fine"'), "verdicts.0.condition"),
        (lambda text: text.replace('"estimate": 0.2', '"estimate": 1e300'), "outside the accepted range"),
        (
            lambda text: text.replace('"estimate": 0.2', f'"estimate": {"9" * 400}'),
            "verdicts.0.indicators.0.value",
        ),
        (lambda text: text.replace("2026-03-01T", "yesterday"), "start_utc"),
        (lambda text: text.replace("600.0", "1e300"), "no time"),
        (lambda text: text.replace('"windows": 10', '"windows": 0'), "windows"),
    ],
)
def test_a_broken_file_is_named_and_hides_no_other(tmp_path: Path, change: Any, said: str) -> None:
    keep_assessment(flown(verdict(), day=1), tmp_path)
    broken = tmp_path / "broken.json"
    broken.write_text(change(flown(verdict(shown(0.2))).to_json()), encoding="utf-8")
    read = read_history(tmp_path)
    assert len(read.flights) == 1
    (error,) = read.errors
    assert error.problem.startswith(f"{broken}: ")
    assert said in error.problem
    assert error.remedy


def test_one_broken_assessment_of_several_hides_no_other(tmp_path: Path) -> None:
    several = [json.loads(flown(verdict(), day=day).to_json()) for day in range(4)]
    del several[1]["log"]
    several[2]["log"]["start_utc"] = None
    (tmp_path / "all.json").write_text(json.dumps({"schema": SCHEMA, "assessments": several}))
    read = read_history(tmp_path)
    assert len(read.flights) == 2
    assert "assessments.1.log" in read.errors[0].problem
    assert "has no date" in read.notices[0]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_what_a_shell_made_of_the_encoding_is_undone(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "flight.json").write_text(flown(verdict()).to_json(), encoding=encoding)
    assert len(read_history(tmp_path).flights) == 1


def test_a_file_that_cannot_be_opened_is_an_error_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep_assessment(flown(verdict()), tmp_path)
    (tmp_path / "loop.json").symlink_to("loop.json")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.json")
    read = read_history(tmp_path)
    assert len(read.flights) == 1
    assert len(read.errors) == len(list(tmp_path.iterdir())) - 1
    with pytest.raises(MavhumsError, match="no such file") as missing:
        read_history(tmp_path / "missing")
    assert "--keep" in missing.value.remedy


def leaves(value: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(leaf for key, item in items for leaf in leaves(item, (*path, key)))][not path :]


WEAR = [flown(verdict(shown(0.2 + 0.01 * day, error=0.001 * (1 + day % 3))), day=day) for day in range(9)]
BASE = json.loads(WEAR[4].to_json())
NUMBERS = st.one_of(
    st.floats(),
    st.integers(),
    st.sampled_from([1e308, -1e308, 1e12, -1e12, 5e-324, 10**30, 10**400, 0, -0.0]),
)
ANYTHING = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, st.text(max_size=20)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """An assessment with some of its values replaced by anything, or its bytes cut or changed."""
    content = json.loads(json.dumps(BASE))
    for _ in range(draw(st.integers(1, 3))):
        *parents, last = draw(st.sampled_from(leaves(content)))
        inner = content
        for key in parents:
            inner = inner[key]
        number = isinstance(inner[last], float) and draw(st.booleans())
        inner[last] = draw(NUMBERS if number else ANYTHING)
    data = bytearray(json.dumps(content).encode())
    for _ in range(draw(st.sampled_from([0, 0, 0, 2]))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    return bytes(data[: draw(st.sampled_from([len(data), len(data), len(data) // 2]))])


@pytest.mark.slow
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(mutated(), st.binary(max_size=200)))
def test_no_file_stops_the_others(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    """Whatever one file holds, the other eight are read, it is accounted for, and the trend is shown."""
    folder = tmp_path_factory.mktemp("flights")
    for assessment in (*WEAR[:4], *WEAR[5:]):
        keep_assessment(assessment, folder)
    (folder / "hostile.json").write_bytes(data)
    read = read_history(folder)
    ours = sum(flight.file is not None and flight.file.name != "hostile.json" for flight in read.flights)
    assert ours + sum("judged again" in notice for notice in read.notices) >= 8
    assert len(read.flights) + len(read.errors) + len(read.notices) >= 9
    report = trend_report(read)
    assert json.loads(report.to_json())["schema"] == "mavhums.trend/1"
    assert len(to_frame(report.trends)) == sum(len(one.points) for one in report.trends)
    assert plain(trend_blocks(report))


def test_the_baseline_is_of_the_first_healthy_flights() -> None:
    values = np.linspace(0.2, 0.3, 40)
    flights = [flown(verdict(shown(value)), day=day) for day, value in enumerate(values)]
    sick = [
        flown(verdict(shown(0.9), condition="degraded"), day=3.1),
        flown(verdict(shown(0.9), condition="undecided"), day=3.2),
        flown(verdict(shown(0.9), suspect="friction"), day=3.3),
        flown(verdict(shown(0.9), actuator="rudder"), day=3.4),
        flown(verdict(shown(0.9), vehicle=2), day=3.5),
        flown(verdict(shown(0.9, fault="backlash")), day=30.6),
    ]
    found = history(*flights, *sick).baselines("paper", LATER)
    reference = [shown(value) for value in values[:REFERENCE_FLIGHTS]]
    assert found[KEY] == Baseline.of(reference)
    assert set(found) == {KEY}


def test_neither_the_flight_itself_nor_a_later_one_is_its_baseline() -> None:
    flights = [flown(verdict(shown(0.2 + 0.01 * day)), day=day) for day in range(16)]
    found = history(*flights).baselines("paper", START + timedelta(days=13))
    assert found[KEY] == Baseline.of([shown(0.2 + 0.01 * day) for day in range(13)])
    during = history(*flights).baselines("paper", START + timedelta(days=12, seconds=300))
    assert during[KEY].flights == 12
    assert history(*flights).baselines("paper", None) == {}


def test_flights_of_another_profile_are_no_baseline() -> None:
    for other in ("other", "zebra", "paper plane", None):
        flights = [flown(verdict(shown(0.2)), day=day, airframe=other) for day in range(10)]
        assert history(*flights).baselines("paper", LATER) == {}
    both = [flown(verdict(shown(0.2)), day=day, airframe="other, paper") for day in range(10)]
    assert history(*both).baselines("paper", LATER)[KEY].flights == 10


def test_after_a_repair_the_baseline_begins_anew() -> None:
    flights = [
        flown(verdict(shown(0.2 + 0.1 * (day > 4))), verdict(shown(0.2), actuator="rudder"), day=day)
        for day in range(18)
    ]
    found = history(*flights).baselines("paper", LATER, {"elevator": START + timedelta(days=5)})
    assert found[KEY].flights == 13
    assert found[KEY].mean == pytest.approx(0.3)
    assert found[1, "rudder", "friction"].flights == 18
    everyone = history(*flights).baselines("paper", LATER, {None: START + timedelta(days=8)})
    assert {baseline.flights for baseline in everyone.values()} == {10}


def test_of_an_axis_only_a_healthy_flight_is_kept_for_later_ones() -> None:
    own = (OwnRecord(equation="response", setup="-", rate_hz=10.0, duration_s=9.0, groups=((9.0,),)),)
    cases: tuple[tuple[str, Condition, str | None, bool], ...] = (
        ("actuator", "degraded", None, True),
        ("axis", "normal", None, True),
        ("axis", "degraded", None, False),
        ("axis", "normal", "loss", False),
        ("motor", "emergency", None, False),
    )
    for subject, condition, suspect, is_kept in cases:
        one = verdict(condition=condition, suspect=suspect).model_copy(
            update={"subject": subject, "own": own}
        )
        assert kept_records(one) == own * is_kept


def test_what_is_known_of_an_aircraft_has_its_first_and_its_last_flight() -> None:
    flights = [
        flown(verdict(), day=day, identities=[identity(board=board).model_copy(update={"aircraft": name})])
        for day, (board, name) in enumerate(
            (("0A", None), ("0B", None), ("0A", "D-A"), ("0A", None), ("0B", None))
        )
    ]
    owners = history(*flights).owners()
    assert [(one.board, one.aircraft, *((at - START).days for at in one.starts)) for one in owners] == [
        ("0A", None, 0, 3),
        ("0B", None, 1, 4),
        ("0A", "D-A", 2, 2),
    ]


def test_only_flights_of_one_profile_and_board_may_be_one_flight() -> None:
    def one(name: str, board: str | None = "0A", airframe: str | None = "paper") -> Assessment:
        return flown(verdict(), name=name, airframe=airframe, identities=[identity(board=board)])

    others = [
        one("a"),
        one("b", "0B"),
        one("c", None),
        one("d", airframe="other"),
        one("e", airframe="zebra"),
    ]
    found = history(*others, one("own")).near(PastFlight.of(one("own")))
    assert [flight.assessment.log.path for flight in found] == ["a.tlog"]


def test_a_flight_is_added_in_its_place() -> None:
    before = history(flown(verdict(), day=0), flown(verdict(), day=2))
    after = before.with_flight(flown(verdict(), day=1))
    assert [(flight.start - START).days for flight in after.flights] == [0, 1, 2]
    undated = flown(verdict())
    undated = undated.model_copy(update={"log": undated.log.model_copy(update={"start_utc": None})})
    assert after.with_flight(undated) is after


def test_progress_counts_files(tmp_path: Path) -> None:
    write_wear(tmp_path, flights=3)
    done: list[tuple[int, int]] = []
    read_history(tmp_path, progress=lambda *at: done.append(at))
    assert done == [(1, 3), (2, 3), (3, 3)]
