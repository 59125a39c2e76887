from __future__ import annotations

import math
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums import analyse
from mavhums.actuator.mapping import AirframeNamed, Samples
from mavhums.actuator.profile import Limits, load_airframe
from mavhums.app.settings import Options
from mavhums.core.about import NOTICE
from mavhums.core.errors import MavhumsError
from mavhums.core.quantities import KEYS
from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import ConditionChanged, Window
from mavhums.results.assessment import Assessment
from mavhums.results.verdict import Interval
from mavhums.show.markdown_report import markdown
from mavhums.show.recorder import Recorder
from mavhums.show.words import COLOURS
from tests.conftest import real_logs
from tests.show.conftest import EMERGENCY, NORMAL, Flight, new_assessment, new_verdict, samples_of

rr = pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")
chunk = pytest.importorskip("rerun.chunk")

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True, scope="module")
def _strict() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def write(path: Path, events: Iterable[Event], assessment: Assessment) -> Path:
    with Recorder(path, recording_id="flight") as recorder:
        recorder.consume(events)
        recorder.close(assessment)
    return path


def rows(path: Path, entity: str, component: str) -> tuple[Floats, list[Any]]:
    """Flight times in seconds and the component's values, in the order of time."""
    time: list[float] = []
    values: list[Any] = []
    for part in chunk.RrdReader(path).stream().filter(content=entity, is_static=False):
        batch = part.to_record_batch()
        if component in batch.schema.names:
            time += [duration.value / 1e9 for duration in batch.column("flight_time")]
            values += batch.column(component).to_pylist()
    order = np.argsort(time, kind="stable")
    return np.array(time)[order], [values[place] for place in order]


def scalars(path: Path, entity: str, component: str = "Scalars:scalars") -> tuple[Floats, Floats]:
    time, values = rows(path, entity, component)
    return time, np.array(values, dtype=np.float64)


def static(path: Path, entity: str) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for part in chunk.RrdReader(path).stream().filter(content=entity, is_static=True):
        batch = part.to_record_batch()
        for name in batch.schema.names:
            found[name] = batch.column(name).to_pylist()[-1]
    return found


def entities(path: Path) -> set[str]:
    return {part.entity_path for part in chunk.RrdReader(path).stream()}


def verify(path: Path) -> None:
    command = Path(sysconfig.get_path("scripts")) / "rerun"
    subprocess.run([command, "rrd", "verify", path], check=True, capture_output=True)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, flight: Flight, assessment: Assessment) -> Path:
    return write(tmp_path_factory.mktemp("show") / "flight.rrd", flight.events(), assessment)


def test_friction_lies_at_the_middle_of_its_window_with_gaps_where_nothing_was_estimated(
    recording: Path, flight: Flight
) -> None:
    time, found = scalars(recording, "/vehicle_1/aileron_right/friction")
    windows = [flight.window("aileron_right", end) for end in range(10, 101)]
    np.testing.assert_array_equal(time, [window.end_s - 5.0 for window in windows])
    intervals = [window.friction_nm for window in windows]
    expected = [(one.estimate, one.low, one.high) if one else [math.nan] * 3 for one in intervals]
    np.testing.assert_array_equal(found[:, :3], expected)
    np.testing.assert_array_equal(found[:, 3:], [[NORMAL, EMERGENCY]] * len(windows))
    assert np.isnan(found).any()
    _, votes = scalars(recording, "/vehicle_1/elevator/network")
    assert votes[:, 0].tolist() == [flight.window("elevator", end).p_fault for end in range(10, 101)]


def test_conditions_change_where_they_did_and_not_where_it_was_certain(
    recording: Path, flight: Flight
) -> None:
    changes = [event for event in flight.events() if isinstance(event, ConditionChanged)]
    time, states = rows(recording, "/vehicle_1/elevator", "StateChange:state")
    assert states == [["normal"], ["degraded"], ["emergency"]]
    expected = [event.since_s for event in changes if event.actuator == "elevator"]
    np.testing.assert_allclose(time, expected)
    still, undecided = rows(recording, "/vehicle_1/rudder", "StateChange:state")
    assert (still.tolist(), undecided) == ([0.0], [["undecided"]])
    style = static(recording, "/vehicle_1/elevator")
    assert style["StateConfiguration:values"] == [*COLOURS, "stale"]
    assert len(set(style["StateConfiguration:colors"])) == len(COLOURS) + 1


def test_what_happened_is_shown(recording: Path) -> None:
    _, texts = rows(recording, "/events", "TextLog:text")
    _, levels = rows(recording, "/events", "TextLog:level")
    lines = [text for (text,) in texts]
    assert lines[:2] == ["vehicle 1: ArduPlane V4.6.0", "judged by the airframe profile paper"]
    assert lines[-1].startswith("elevator: emergency since 1m")
    assert levels[-1] == ["ERROR"]
    assert ["WARN"] in levels


def test_the_report_and_the_properties_travel_along(recording: Path, assessment: Assessment) -> None:
    report = static(recording, "/report")
    assert report["TextDocument:text"] == [markdown(assessment)]
    assert report["TextDocument:media_type"] == ["text/markdown"]
    mine = static(recording, "/__properties/mavhums")
    assert mine["worst_actuator"] == ["elevator"]
    assert mine["condition"] == ["emergency"]
    assert mine["vehicle"] == [1]
    assert mine["airframe"] == ["paper"]
    assert mine["notice"] == [NOTICE]
    info = static(recording, "/__properties")
    assert info["RecordingInfo:name"] == ["2025-06-01.tlog"]
    start = info["RecordingInfo:start_time"][0]
    assert start == 1_748_772_000_000_000_000


def test_it_is_small_in_few_chunks_and_verifies(recording: Path) -> None:
    assert recording.stat().st_size < 10e6
    assert len(list(chunk.RrdReader(recording).stream())) < 100
    verify(recording)


def test_absent_quantities_are_absent(tmp_path: Path, assessment: Assessment) -> None:
    absent = tuple(key for key in KEYS if key not in ("V1", "V5"))
    events = Flight(absent=absent, duration=12).events()
    path = write(tmp_path / "sparse.rrd", events, assessment)
    for part in chunk.RrdReader(path).stream().filter(content="/vehicle_1/elevator/quantities"):
        names = set(part.to_record_batch().schema.names)
        assert {name for name in names if name.startswith("mavhums:")} == {"mavhums:V1", "mavhums:V5"}
    events = Flight(absent=KEYS, duration=12).events()
    assert "/vehicle_1/elevator/quantities" not in entities(write(path, events, assessment))


def test_what_falls_silent_leaves_a_gap_and_not_a_straight_line(tmp_path: Path) -> None:
    def block(start: int, value: float) -> Samples:
        values = np.full((4096, 12), np.nan)
        values[:, 0], values[:, 4] = 1.0, value
        return samples_of("elevator", start + np.arange(4096) / 100, values)

    blocks = [block(0, math.nan), block(100, 0.5), block(200, math.nan), block(300, 0.7)]
    window = Window(1, "elevator", 0.0, 10.0, 0.5, None, "normal", "normal", 0.5, 0.5)
    path = write(tmp_path / "gap.rrd", [*blocks, window], new_assessment())
    time, found = scalars(path, "/vehicle_1/elevator/quantities", "mavhums:V5")
    given = time[np.isfinite(found[:, 0])]
    assert (given[0], given[-1]) == (100.0, pytest.approx(340.95))
    assert np.isnan(found[(time >= 200) & (time < 300)]).all()
    time, found = scalars(path, "/vehicle_1/elevator/quantities", "mavhums:V1")
    assert time[np.isnan(found[:, 0])] == pytest.approx([40.951, 140.951, 240.951])
    assert "/vehicle_1/elevator/network" in entities(path)
    assert "/vehicle_1/elevator/friction" not in entities(path)


def test_every_sample_is_there_wherever_blocks_are_cut(tmp_path: Path, flight: Flight) -> None:
    whole = flight.samples("elevator", 0, 100)
    rng = np.random.default_rng(5)
    cuts = [0, 0, *np.sort(rng.integers(0, whole.time_s.size, 40)), whole.time_s.size]
    parts = [samples_of("elevator", whole.time_s[a:b], whole.values[a:b]) for a, b in pairwise(cuts)]
    path = write(tmp_path / "cut.rrd", parts, new_assessment())
    for place, key in enumerate(KEYS):
        time, found = scalars(path, "/vehicle_1/elevator/quantities", f"mavhums:{key}")
        np.testing.assert_array_equal(found[:, 0], whole.values[:, place])
        np.testing.assert_allclose(time, whole.time_s, atol=1e-9)


def test_long_flights_are_written_as_they_come(tmp_path: Path) -> None:
    interval = Interval(estimate=0.2, low=0.1, high=0.3)

    def events() -> Iterator[Event]:
        for end in map(float, range(5000)):
            yield Window(1, "rudder", end - 10, end, 1.0, interval, "normal", "normal", 0.9, 0.1)
            yield ConditionChanged(1, "rudder", end, end, "normal", "degraded", "r")
            yield Notice(end, None, "x")

    path = write(tmp_path / "long.rrd", events(), new_assessment())
    for entity, component in (
        ("/vehicle_1/rudder/friction", "Scalars:scalars"),
        ("/vehicle_1/rudder", "StateChange:state"),
        ("/events", "TextLog:text"),
    ):
        time, _ = rows(path, entity, component)
        assert 5000 <= time.size <= 10001


def test_a_state_found_late_never_hides_below_an_earlier_one(tmp_path: Path) -> None:
    empty = samples_of("rudder", np.zeros(0), np.zeros((0, 12)))
    window = Window(1, "rudder", 2.0, 12.0, 1.0, None, "undecided")
    changes = [
        ConditionChanged(1, "rudder", 20.0, 15.0, "undecided", "degraded", "r"),
        ConditionChanged(1, "rudder", 21.0, 14.0, "degraded", "emergency", "r"),
    ]
    path = write(tmp_path / "late.rrd", [empty, window, *changes], new_assessment())
    time, states = rows(path, "/vehicle_1/rudder", "StateChange:state")
    assert states == [["undecided"], ["degraded"], ["emergency"]]
    assert time.tolist() == [2.0, 15.0, pytest.approx(15.000001)]


def test_an_actuator_without_telemetry_is_shown_as_undecided(tmp_path: Path) -> None:
    silent = new_verdict("rudder", "undecided", 0.0, None, vehicle=None)
    path = write(tmp_path / "silent.rrd", [], new_assessment(silent))
    assert rows(path, "/no_vehicle/rudder", "StateChange:state")[1] == [["undecided"]]
    assert "vehicle" not in static(path, "/__properties/mavhums")


@pytest.mark.parametrize("vehicle", [None, 1])
def test_the_profile_of_a_vehicle_draws_its_limits(
    vehicle: int | None, tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    paper = load_airframe("paper")
    limits = Limits(normal=0.1, emergency=0.2)
    tight = paper.actuators[2].model_copy(update={"limits": limits})
    mine = paper.model_copy(update={"actuators": (tight,)})
    events: list[Event] = [AirframeNamed(0.0, vehicle, mine), AirframeNamed(0.0, 2, paper)]
    events += [flight.window("elevator", 10)]
    path = write(tmp_path / "own.rrd", events, assessment)
    _, [found] = scalars(path, "/vehicle_1/elevator/friction")
    assert found[3:].tolist() == [0.1, 0.2]
    names = static(path, "/vehicle_1/elevator/friction")["SeriesLines:names"]
    assert names[3:] == ["degraded above 0.1", "emergency from 0.2"]


@pytest.mark.parametrize("start", [None, "2025-06-01T10:00:00", "2025-06-01T12:00:00+02:00"])
def test_name_and_start_of_a_recording(start: str | None, tmp_path: Path) -> None:
    empty = new_assessment()
    log = empty.log.model_copy(update={"path": None, "start_utc": start})
    bare = empty.model_copy(update={"log": log, "airframe": None})
    path = write(tmp_path / "link.rrd", [Notice(0.0, None, "the clock rewound")], bare)
    info = static(path, "/__properties")
    assert info["RecordingInfo:name"] == ["link"]
    assert info.get("RecordingInfo:start_time") == (None if start is None else [1_748_772_000_000_000_000])
    assert "airframe" not in static(path, "/__properties/mavhums")
    assert rows(path, "/events", "TextLog:text")[1] == [["log: the clock rewound"]]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_leaves_neither_half_a_recording_nor_a_temporary_file(
    error: type[BaseException], tmp_path: Path, flight: Flight
) -> None:
    path = tmp_path / "flight.rrd"
    path.write_bytes(b"the older one")
    seen: list[Path] = []

    def events() -> Iterator[Event]:
        yield flight.samples("elevator", 0, 50)
        seen.extend(tmp_path.iterdir())
        raise error

    with pytest.raises(error), Recorder(path, recording_id="flight") as recorder:
        recorder.consume(events())
    assert len(seen) == 2
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"the older one"


def test_a_place_that_cannot_be_written_is_an_error_that_names_it(
    tmp_path: Path, assessment: Assessment
) -> None:
    with pytest.raises(MavhumsError, match=r"cannot write .*nowhere"):
        write(tmp_path / "nowhere" / "flight.rrd", [], assessment)
    folder = tmp_path / "folder.rrd"
    folder.mkdir()
    with pytest.raises(MavhumsError, match="cannot write"):
        write(folder, [], assessment)
    assert list(tmp_path.iterdir()) == [folder]


def test_a_recording_without_its_end_is_not_published(
    tmp_path: Path, assessment: Assessment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mavhums.show.recorder._FOOTER", b"no such end")
    with pytest.raises(MavhumsError, match="its end is missing: is the disk full"):
        write(tmp_path / "flight.rrd", [], assessment)
    assert not list(tmp_path.iterdir())


ON_A_FULL_DISK = """
import sys
from pathlib import Path
from tests.conftest import files_up_to
from tests.show.conftest import Flight, new_assessment
from tests.show.test_recording import MavhumsError, write
try:
    with files_up_to(100_000):
        write(Path(sys.argv[1]), [Flight().samples("elevator", 0, 100)], new_assessment())
except MavhumsError as error:
    print(error)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
def test_a_full_disk_is_an_error(tmp_path: Path) -> None:
    command = [sys.executable, "-c", ON_A_FULL_DISK, str(tmp_path / "flight.rrd")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=180, cwd=ROOT)
    assert "is the disk full?" in done.stdout
    assert not list(tmp_path.iterdir())


REAL = ("EAICS__flight.tlog", "Jordinaa-supervisor__mav.tlog", "ardusub_log_tools__pymavlink_bug.tlog")


@pytest.mark.parametrize("log", [p for p in real_logs() if p.name in REAL], ids=lambda path: path.name)
def test_recordings_of_real_logs_verify(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "real.rrd"
    assessment = analyse(log, Options(airframe="paper"), recording=path)
    verify(path)
    assert {f"/vehicle_{v.vehicle}/{v.actuator}" for v in assessment.verdicts} <= entities(path)
    assert any(entity.startswith("/flight_mode/") for entity in entities(path))
