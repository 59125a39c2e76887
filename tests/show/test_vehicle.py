"""The airframe, the flight mode, the position, silence, and what is left of a long flight."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mavhums.actuator.mapping import Samples
from mavhums.core.quantities import KEYS
from mavhums.engine.events import Event
from mavhums.health.decision.events import ConditionChanged, Indication
from mavhums.results.assessment import Assessment
from mavhums.vehicle.states import Attitude, FlightMode, Position
from tests.show.conftest import Flight, new_assessment, samples_of

pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")

import rerun as rr

from mavhums.results.sections import FlightEvent
from mavhums.show._scene import Scene
from mavhums.show._signals import open_stream
from mavhums.show.blueprint import Lane, layout
from mavhums.show.outline import places as placed
from mavhums.show.recorder import Recorder
from mavhums.show.words import COLOURS
from tests.show.test_blueprint import names
from tests.show.test_recording import entities, rows, scalars, static, write

SURFACE = "/airframe/vehicle_1/body/at/elevator/part"


@pytest.fixture(autouse=True, scope="module")
def _strict() -> Iterator[None]:
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def rgba(colour: tuple[int, int, int]) -> int:
    return (colour[0] << 24) + (colour[1] << 16) + (colour[2] << 8) + 255


def block(start: float, count: int, rate: float = 100.0, value: float = 1.0) -> Samples:
    return samples_of("elevator", start + np.arange(count) / rate, np.full((count, 12), value))


def test_surfaces_move_and_carry_their_conditions_colour(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    path = write(tmp_path / "flight.rrd", flight.events(), assessment)
    time, turns = rows(path, SURFACE, "Transform3D:rotation_axis_angle")
    assert 24 <= time.size / 100 <= 26
    samples = flight.samples("elevator", 0, 100)
    angles = -np.radians(samples.values[:, KEYS.index("V3")][np.searchsorted(samples.time_s, time - 1e-6)])
    assert [turn[0]["angle"] for turn in turns] == pytest.approx(angles.tolist(), abs=1e-5)
    assert turns[0][0]["axis"] == [0, 1, 0]
    changed, colours = rows(path, SURFACE, "Boxes3D:colors")
    expected = [rgba(COLOURS[condition]) for condition in ("normal", "degraded", "emergency")]
    assert [colour for (colour,) in colours[1:]] == expected, "grey before"
    lane, _ = rows(path, "/vehicle_1/elevator", "StateChange:state")
    np.testing.assert_array_equal(changed[1:], lane)


def test_without_v3_the_command_moves_the_surface_and_without_both_it_rests(
    tmp_path: Path, assessment: Assessment
) -> None:
    events = Flight(absent=("V3",), duration=12).events()
    _, turns = rows(write(tmp_path / "a.rrd", events, assessment), SURFACE, "Transform3D:rotation_axis_angle")
    commands = Flight(duration=12).samples("elevator", 0, 12).values[:, 0]
    assert turns[0][0]["angle"] == pytest.approx(-math.radians(commands[0]), abs=1e-6)
    events = Flight(absent=("V1", "V3"), duration=12).events()
    path = write(tmp_path / "b.rrd", events, assessment)
    assert rows(path, SURFACE, "Transform3D:rotation_axis_angle")[1] == []


@pytest.mark.slow
def test_nose_up_is_up_and_right_wing_down_lifts_the_left(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    roll, pitch, yaw = 0.4, 0.3, 0.7
    angles = [[0.0, pitch, yaw], [roll, 0.0, yaw], [roll, pitch, yaw]]
    attitude = Attitude(1, np.array([1.0, 2.0, 3.0]), np.array(angles))
    path = write(tmp_path / "a.rrd", [*flight.events(), attitude], assessment)
    _, quaternions = rows(path, "/airframe/vehicle_1/body", "Transform3D:quaternion")
    up, banked, both = (Rotation.from_quat(q) for (q,) in quaternions)
    for turned in (up, both):
        np.testing.assert_allclose(turned.apply((1, 0, 0)), (math.cos(pitch), 0, math.sin(pitch)), atol=1e-6)
    np.testing.assert_allclose(banked.apply((0, 1, 0)), (0, math.cos(roll), math.sin(roll)), atol=1e-6)
    _, headings = rows(path, "/airframe/vehicle_1", "Transform3D:rotation_axis_angle")
    assert [heading["angle"] for (heading,) in headings] == pytest.approx([-yaw] * 3)


def test_every_kind_of_surface_has_a_place_of_its_own() -> None:
    ailerons = [f"aileron_{side}_{k}" for side in ("left", "right") for k in range(8)]
    names = ["aileron_left", "aileron_right", "aileron", "aileron_b", "elevator", "rudder", "canard", "gear"]
    names += ["camera", "spoiler", "flap_l", "flap_r", "ruddervator_left", "ruddervator_right", *ailerons]
    places = placed(names)
    assert len({(place.x, place.span, place.roll) for place in places}) == len(names)
    by_name = dict(zip(names, places, strict=True))
    assert min(by_name["aileron_left"].span) > 0 > max(by_name["aileron_right"].span)
    assert min(by_name["flap_l"].span) > 0 > max(by_name["flap_r"].span)
    assert all(by_name[name].mirrored for name in ("aileron", "aileron_b")), "no name says which is left"
    assert not by_name["aileron_left"].mirrored
    assert sum(by_name["elevator"].span) == 0
    assert by_name["rudder"].roll == 90
    assert by_name["ruddervator_left"].roll == -by_name["ruddervator_right"].roll


def test_flight_modes_have_a_lane_and_are_named(tmp_path: Path) -> None:
    modes = [FlightMode(1, 0.0, "MANUAL"), FlightMode(1, 5.0, "AUTO"), FlightMode(1, 9.0, "MANUAL")]
    path = write(tmp_path / "modes.rrd", modes, new_assessment())
    time, states = rows(path, "/flight_mode/vehicle_1", "StateChange:state")
    assert (time.tolist(), states) == ([0, 5, 9], [["MANUAL"], ["AUTO"], ["MANUAL"]])
    assert static(path, "/flight_mode/vehicle_1")["StateConfiguration:values"] == ["MANUAL", "AUTO"]
    assert rows(path, "/events", "TextLog:text")[1][1] == ["vehicle 1: flight mode AUTO"]


def test_the_events_of_the_flight_are_recorded(tmp_path: Path) -> None:
    happened = (
        FlightEvent(kind="mode", vehicle=1, time_s=1.0, said="AUTO"),  # recorded as it comes
        FlightEvent(kind="crash", vehicle=1, time_s=7.0, said="Crash: Disarming"),  # as its text
        FlightEvent(kind="landing", vehicle=1, time_s=7.0),
    )
    assessment = new_assessment(events=happened)
    time, texts = rows(write(tmp_path / "events.rrd", [], assessment), "/events", "TextLog:text")
    assert (time.tolist(), texts) == ([7.0], [["vehicle 1: landing"]])


@pytest.mark.parametrize("wanted", [True, False])
def test_the_position_is_left_out_on_request(wanted: bool, tmp_path: Path) -> None:
    time = np.arange(100.0)
    degrees = np.stack([51 + time / 1e4, time / 1e4], axis=1)
    with Recorder(tmp_path / "map.rrd", recording_id="flight", position=wanted) as recorder:
        recorder.consume([Position(1, time, degrees, time)])
        recorder.close(new_assessment())
    found = entities(tmp_path / "map.rrd")
    assert ("/position/vehicle_1" in found) == wanted
    assert b"/position" in (tmp_path / "map.rrd").read_bytes() or not wanted
    if wanted:
        _, points = rows(tmp_path / "map.rrd", "/position/vehicle_1", "GeoPoints:positions")
        np.testing.assert_array_equal([point[0] for point in points], degrees)
        (line,) = static(tmp_path / "map.rrd", "/position/vehicle_1/path")["GeoLineStrings:line_strings"]
        np.testing.assert_array_equal(line, degrees)


def test_silence_is_stale_and_never_normal(tmp_path: Path) -> None:
    change = ConditionChanged(1, "elevator", 1.0, 0.0, "undecided", "normal", "r")
    path = write(tmp_path / "gap.rrd", [block(0, 500), change, block(20, 500)], new_assessment())
    time, states = rows(path, "/vehicle_1/elevator", "StateChange:state")
    assert [state for (state,) in states] == ["normal", "stale", "normal", "stale"]
    assert time.tolist() == pytest.approx([0.0, 4.99, 20.0, 24.99])


def test_silence_is_noticed_while_others_speak(tmp_path: Path) -> None:
    other = block(0, 1200)
    rudder = samples_of("rudder", other.time_s, other.values)
    whole = new_assessment(log=new_assessment().log.model_copy(update={"duration_s": 12.0}))
    path = write(tmp_path / "one.rrd", [block(0, 100), rudder], whole)
    assert rows(path, "/vehicle_1/elevator", "StateChange:state")[1] == [["undecided"], ["stale"]]
    assert rows(path, "/vehicle_1/rudder", "StateChange:state")[1] == [["undecided"]]


def test_a_long_flight_is_thinned_to_its_extremes(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(400_000) / 100
    values = rng.normal(size=(time.size, 12))
    values[123_456, 4] = 99.0
    parts = zip(np.split(time, 400), np.split(values, 400), strict=True)
    events: list[Event] = [samples_of("elevator", *part) for part in parts]
    path = write(tmp_path / "long.rrd", events, new_assessment())
    found_time, found = scalars(path, "/vehicle_1/elevator/quantities", "mavhums:V5")
    assert 16_000 < found_time.size < 40_000
    assert (np.diff(found_time) >= 0).all()
    assert (found.max(), found.min()) == (99.0, values[:, 4].min())
    assert path.stat().st_size < 5e6


def test_what_shows_another_fault_is_drawn_with_its_interval(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    time = np.array([20.0, 21.0])
    seen = Indication(1, "elevator", "backlash", time, time / 100, time / 200, time / 50)
    same = Indication(1, "elevator", "friction", time, time, time, time)
    either = Indication(1, "elevator", "sensor_bias", time, -time / 100, -time / 50, time / 50)
    path = write(tmp_path / "backlash.rrd", [*flight.events(), seen, same, either], assessment)
    found_time, found = scalars(path, "/vehicle_1/elevator/faults/backlash")
    assert found_time.tolist() == [15.0, 16.0]
    assert found.tolist() == [[0.2, 0.1, 0.4, 0.15], [0.21, 0.105, 0.42, 0.15]]
    assert "/vehicle_1/elevator/faults/friction" not in entities(path)
    _, biased = scalars(path, "/vehicle_1/elevator/faults/sensor_bias")
    assert biased[:, 3:].tolist() == [[0.25, -0.25]] * 2


def test_the_fault_in_question_lies_in_front() -> None:
    """A maintainer who reads of backlash wants to see it, not that the friction is as it should be."""
    friction = "Friction, N·m"
    shown = {"sensor_bias": "Sensor bias, °", "supply_sag": "Supply sag, V", "friction": friction}
    faults = {fault: (title, f"/x/{fault}") for fault, title in shown.items()}
    lane = Lane("/vehicle_1/a", "a", "degraded", "degraded", frozenset(), faults)
    for cause, order in (
        ("supply_sag", ["Supply sag, V", friction, "Sensor bias, °"]),
        ("friction", [friction, "Sensor bias, °", "Supply sag, V"]),
    ):
        found = names(layout([lane._replace(cause=cause)]).root_container)
        assert [name for name in found if name in shown.values()] == order


def test_the_cause_is_what_made_the_condition_the_worst_it_was() -> None:
    scene = Scene(open_stream("cause"), live=True, position=False)
    scene.consume(Flight(duration=12).events())
    changes = [
        ("undecided", "normal", "friction", "friction"),
        ("normal", "degraded", "backlash", "backlash"),
        ("degraded", "emergency", "jam", "jam"),
        ("emergency", "degraded", "friction", "jam"),
        ("degraded", "normal", "friction", "jam"),
    ]
    for k, (before, after, fault, cause) in enumerate(changes):
        scene.consume([ConditionChanged(1, "rudder", 20.0 + k, 15.0 + k, before, after, "r", fault)])  # type: ignore[arg-type]
        rudder = next(track for track in scene.tracks if track.actuator == "rudder")
        assert rudder.cause == cause
