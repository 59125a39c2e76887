"""The checkpoint of a folder answers as the whole folder does; one more flight reads one more file."""

from __future__ import annotations

import json
import os
from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mavhums.core.errors import MavhumsError
from mavhums.flights import flight_file as files
from mavhums.flights import folder
from mavhums.flights.folder import CHECKPOINT, FlightFolder, keep_assessment, read_history
from mavhums.flights.history import with_duplicate_flights
from mavhums.health.self_baseline.thresholds import REFERENCE_FLIGHTS
from mavhums.results.verdict import OwnRecord
from tests.flights import START, flown, identity, shown, verdict, write_wear

LATER = START + timedelta(days=10_000)


def own_records(value: float) -> tuple[OwnRecord, ...]:
    groups = ((3.0, value, 1 / 3), (2.0, -value, 1e-17))
    record = OwnRecord(equation="motor", setup="as it is", rate_hz=50.0, duration_s=value, groups=groups)
    return (record,) if value > 0.2 else ()


flights = st.builds(
    lambda day, value, fault, suspect, airframe, vehicle, boot_s: flown(
        verdict(
            shown(value, fault=fault), vehicle=vehicle, suspect="friction" if suspect else None
        ).model_copy(update={"own": own_records(value)}),
        verdict(shown(value * 2), actuator="rudder"),
        day=day,
        name=f"{day}-{value}",
        airframe=airframe,
        identities=[] if boot_s is None else [identity(boot_s=boot_s, day=day)],
    ),
    day=st.integers(0, 14).map(float),  # few days, so that several logs are of one flight
    value=st.floats(0.1, 0.4).map(lambda value: round(value, 3)),
    fault=st.sampled_from(["friction", "backlash"]),
    suspect=st.booleans(),
    airframe=st.sampled_from(["paper", "other", "other, paper", None]),
    vehicle=st.sampled_from([1, 2, None]),
    boot_s=st.sampled_from([None, -60.0, -50.0, -35.0, -10.0]),
)


@pytest.mark.slow
@given(
    several=st.lists(flights, max_size=35),
    before=st.integers(0, 20),
    since=st.dictionaries(st.sampled_from(["elevator", "rudder", None]), st.integers(0, 15)),
    again=st.integers(0, 35),
)
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_checkpoint_gives_the_same_as_the_whole_folder(
    tmp_path_factory: pytest.TempPathFactory,
    several: list[object],
    before: int,
    since: dict[str | None, int],
    again: int,
) -> None:
    folder = tmp_path_factory.mktemp("folder")
    dates = {name: START + timedelta(days=day) for name, day in since.items()}
    for number, flight in enumerate(several):
        path = keep_assessment(flight, folder / "one").rename(folder / f"{number}.json")  # type: ignore[arg-type]
        os.utime(path, ns=(number * 10**9, number * 10**9))
        if number == again:
            FlightFolder(folder)
    whole = read_history(folder)
    for airframe in ("paper", "other", None):
        for moment in (START + timedelta(days=before), LATER, None):
            followed = FlightFolder(folder)
            asked = airframe, moment, dates
            assert followed.baselines(*asked) == whole.baselines(*asked)
            assert followed.past(*asked) == whole.past(*asked)
    followed = FlightFolder(folder)
    assert sorted(map(str, followed.owners())) == sorted(map(str, whole.owners()))
    for flight in several:
        assert with_duplicate_flights(flight, followed) == with_duplicate_flights(flight, whole)  # type: ignore[arg-type]


def test_the_record_of_a_flight_lies_beside_its_public_assessment(tmp_path: Path) -> None:
    judged = verdict(shown(0.3)).model_copy(update={"own": own_records(0.3)})
    flight = flown(judged, verdict(shown(0.2), actuator="rudder"), day=1)
    kept = keep_assessment(flight, tmp_path)
    content = json.loads(kept.read_text(encoding="utf-8"))
    assert content["schema"] == "mavhums.flight/1"
    assert content["assessment"] == json.loads(flight.to_json())
    assert "own" not in content["assessment"]["verdicts"][0]
    [read] = read_history(tmp_path).flights
    assert read.assessment == flight


@pytest.mark.parametrize("public", [True, False], ids=["plain", "of the version before"])
def test_a_plain_assessment_is_read_with_what_it_has(tmp_path: Path, public: bool) -> None:
    judged = verdict(shown(0.3)).model_copy(update={"own": own_records(0.3)})
    flight = flown(judged, day=1)
    text = flight.to_json() if public else flight.model_dump_json(by_alias=True)
    (tmp_path / "flight.json").write_text(text, encoding="utf-8")
    [read] = read_history(tmp_path).flights
    assert read.assessment.verdicts[0].own == (() if public else judged.own)
    assert read.assessment.to_json() == flight.to_json()


def test_a_later_schema_is_refused_with_a_remedy(tmp_path: Path) -> None:
    kept = keep_assessment(flown(verdict(shown(0.3))), tmp_path)
    kept.write_text(kept.read_text(encoding="utf-8").replace("mavhums.flight/1", "mavhums.flight/2"))
    [error] = read_history(tmp_path).errors
    assert "'mavhums.flight/2', not mavhums.flight/1" in error.problem
    assert error.remedy.startswith("update mavhums")


def test_a_file_that_changed_or_vanished_counts_as_it_is_now(tmp_path: Path) -> None:
    write_wear(tmp_path, flights=12)
    before = FlightFolder(tmp_path).baselines("paper", LATER)
    oldest = min(tmp_path.glob("*.json"))
    oldest.unlink()
    fewer = FlightFolder(tmp_path).baselines("paper", LATER)
    assert fewer == read_history(tmp_path).baselines("paper", LATER) != before
    oldest.write_text(flown(verdict(shown(0.31)), day=0).to_json(), encoding="utf-8")
    assert FlightFolder(tmp_path).baselines("paper", LATER) == read_history(tmp_path).baselines(
        "paper", LATER
    )


def test_what_cannot_be_read_is_told_each_time(tmp_path: Path) -> None:
    write_wear(tmp_path, flights=3)
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    (tmp_path / "foreign.json").write_text("[1]", encoding="utf-8")
    whole = read_history(tmp_path)
    for _ in range(2):
        followed = FlightFolder(tmp_path)
        assert [error.problem for error in followed.errors] == [error.problem for error in whole.errors]
        assert followed.notices == whole.notices


@pytest.mark.parametrize("damage", [b"no checkpoint", b"", b"{}\n", None])
def test_a_damaged_checkpoint_is_made_anew(tmp_path: Path, damage: bytes | None) -> None:
    write_wear(tmp_path, flights=5)
    whole = read_history(tmp_path).baselines("paper", LATER)
    FlightFolder(tmp_path)
    stored = (tmp_path / CHECKPOINT).read_bytes()
    (tmp_path / CHECKPOINT).write_bytes(stored[:-50] if damage is None else damage)
    assert FlightFolder(tmp_path).baselines("paper", LATER) == whole
    assert FlightFolder(tmp_path).baselines("paper", LATER) == whole


def test_another_versions_checkpoint_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_wear(tmp_path, flights=5)
    monkeypatch.setattr(folder, "_VERSION", "another")
    FlightFolder(tmp_path)
    monkeypatch.undo()
    assert FlightFolder(tmp_path).baselines("paper", LATER) == read_history(tmp_path).baselines(
        "paper", LATER
    )


def test_without_a_folder_the_remedy_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(MavhumsError, match="no such") as told:
        FlightFolder(tmp_path / "none")
    assert "--keep" in told.value.remedy


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    opened: list[Path] = []
    original = files._items

    def counted(path: Path) -> object:
        opened.append(path)
        return original(path)

    monkeypatch.setattr(files, "_items", counted)
    return opened


def test_a_landing_reads_its_own_file_only(tmp_path: Path, reads: list[Path]) -> None:
    write_wear(tmp_path, flights=30)
    folder = FlightFolder(tmp_path)
    kept = keep_assessment(flown(verdict(shown(0.2)), day=5000), tmp_path)
    reads.clear()
    assert folder.with_flight(flown(verdict(shown(0.2)))).baselines("paper", LATER)
    assert FlightFolder(tmp_path).baselines("paper", LATER)
    assert reads == [kept]
    latest = keep_assessment(flown(verdict(shown(0.2)), day=5001), tmp_path)
    reads.clear()
    assert FlightFolder(tmp_path).baselines("paper", LATER)
    assert reads == [latest], "by a command of its own, too"


def test_a_landing_tells_the_same_as_the_whole_folder(tmp_path: Path) -> None:
    write_wear(tmp_path, flights=REFERENCE_FLIGHTS + 2)
    FlightFolder(tmp_path)
    for day in (1000, -1000):  # the second is late: the first flight of the baseline
        keep_assessment(flown(verdict(shown(0.1)), day=day, identities=[identity(day=day)]), tmp_path)
        followed, whole = FlightFolder(tmp_path), read_history(tmp_path)
        assert followed.baselines("paper", LATER) == whole.baselines("paper", LATER)
        assert followed.owners() == whole.owners()


def test_the_last_flight_judged_again_into_another_file_counts_once(tmp_path: Path) -> None:
    write_wear(tmp_path, flights=12)
    before = FlightFolder(tmp_path).baselines("paper", LATER)
    (tmp_path / "again.json").write_text(flown(verdict(shown(0.1)), day=11).to_json(), encoding="utf-8")
    after = FlightFolder(tmp_path).baselines("paper", LATER)
    assert before != after == read_history(tmp_path).baselines("paper", LATER)


@pytest.mark.parametrize("content", ["{", "[1]"], ids=["broken", "foreign"])
def test_what_cannot_be_read_is_told_in_the_order_of_the_files(tmp_path: Path, content: str) -> None:
    write_wear(tmp_path, flights=3)
    for name in ("b", "a"):
        (tmp_path / f"{name}.json").write_text(content, encoding="utf-8")
        followed, whole = FlightFolder(tmp_path), read_history(tmp_path)
        assert [str(error) for error in followed.errors] == [str(error) for error in whole.errors]
        assert followed.notices == whole.notices


def test_late_flights_in_one_run_read_each_file_once(tmp_path: Path, reads: list[Path]) -> None:
    write_wear(tmp_path, flights=12)
    folder = FlightFolder(tmp_path)
    for day in (-1, -2, -3):
        late = flown(verdict(shown(0.2)), day=day, name=f"{day}")
        keep_assessment(late, tmp_path)
        folder = folder.with_flight(late)
    assert sorted(reads) == sorted(tmp_path.glob("*.json"))
    assert folder.baselines("paper", LATER) == read_history(tmp_path).baselines("paper", LATER)


def test_the_recent_flights_are_those_of_the_files_written_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder, "_RECENT_FILES", 2)
    for day, written_s in ((0, 40), (1, 30), (2, 20), (3, 30), (4, 10)):
        path = keep_assessment(flown(verdict(shown(0.2)), day=day), tmp_path)
        os.utime(path, (written_s, written_s))
    starts = [flight.start for flight in FlightFolder(tmp_path).recent()]
    assert starts == [START, START + timedelta(days=3)]


def test_what_cannot_be_a_folder_is_told_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MavhumsError, match=r"file/below: cannot be used as a folder of flights") as error:
        keep_assessment(flown(verdict()), tmp_path / "file" / "below")
    assert error.value.remedy == "name another with --history"
