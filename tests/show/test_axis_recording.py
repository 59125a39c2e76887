"""What a recording shows of an axis whose servos report nothing back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rerun", reason="recordings need the extra 'viewer'")

from mavhums import analyse
from mavhums.app.settings import Options
from mavhums.health.decision.events import Trace
from mavhums.show._craft import CraftModel
from mavhums.show._scene import Scene
from mavhums.show._signals import RowWriter, open_stream
from mavhums.show._tracks import Track
from tests.engine.test_axes import flown
from tests.present import present
from tests.show.conftest import new_assessment, new_verdict, samples_of
from tests.show.test_recording import entities, rows, scalars, static

PROFILE = """
name = "own"
[axes]
effectiveness_degraded = 0.85
effectiveness_emergency = 0.7
[[actuators]]
name = "left aileron"
servo = 1
pwm_us = [1100, 1500, 1900]
[[actuators]]
name = "elevator"
servo = 2
pwm_us = [1100, 1500, 1900]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    folder = tmp_path_factory.mktemp("axis")
    log, profile, recording = folder / "flight.tlog", folder / "own.toml", folder / "flight.rrd"
    log.write_bytes(flown())
    profile.write_text(PROFILE)
    return recording, analyse(log, Options(airframe=profile), recording=recording)


def test_the_lane_of_an_axis_begins_with_the_flight(recorded: tuple[Path, Any]) -> None:
    times, states = rows(recorded[0], "/vehicle_1/roll", "StateChange:state")
    assert times[0] == 0.0
    conditions = [state[0] for state in states]
    assert (conditions[0], conditions[-1]) == ("undecided", "emergency")
    _, lone = rows(recorded[0], "/vehicle_1/elevator", "StateChange:state")
    assert [state[0] for state in lone] == ["unmonitored"]


def test_effectiveness_is_drawn_against_reference_and_limit(recorded: tuple[Path, Any]) -> None:
    root = "/vehicle_1/roll/faults/effectiveness"
    times, values = scalars(recorded[0], root)
    assert values[times < 80, 0].mean() == pytest.approx(1.0, abs=0.1)
    assert values[-5:, 0].max() < 0.65
    assert values[0, 3:].tolist() == [1.0, 0.85, 0.7]
    names = ["reference 1", "degraded below 0.85", "emergency up to 0.7"]
    assert static(recorded[0], root)["SeriesLines:names"][3:] == names


def test_the_demanded_and_the_flown_angle_are_drawn(recorded: tuple[Path, Any]) -> None:
    times, angles = scalars(recorded[0], "/vehicle_1/roll/roll_angle")
    assert static(recorded[0], "/vehicle_1/roll/roll_angle")["SeriesLines:names"] == ["demanded", "flown"]
    assert np.diff(times).max() == pytest.approx(0.25, abs=1e-6)
    assert angles.shape[1] == 2
    assert np.nanmax(np.abs(angles[:, 1])) < 1e-3, "level, as the log says"


def test_surfaces_without_telemetry_have_the_colour_of_their_axis(recorded: tuple[Path, Any]) -> None:
    paths = {path for path in entities(recorded[0]) if path.endswith("part")}
    [aileron] = [path for path in paths if "aileron" in path]
    [elevator] = [path for path in paths if "elevator" in path]
    assert len(rows(recorded[0], aileron, "Boxes3D:colors")[0]) > 2
    assert len(rows(recorded[0], elevator, "Boxes3D:colors")[0]) <= 2


def test_the_viewer_lists_what_matters_first_and_nothing_that_nothing_reports_on(
    recorded: tuple[Path, Any],
) -> None:
    """The viewer sorts lanes by their paths: the worst, and axes before servos, must come first in it."""
    lanes = sorted(path for path in entities(recorded[0]) if path.startswith("/condition/"))
    ranked = [verdict.actuator for verdict in recorded[1].ranked() if verdict.condition != "unmonitored"]
    assert ranked[0] == "roll"
    assert lanes == [f"/condition/{rank}_{name}_control" for rank, name in enumerate(ranked, 1)]
    assert "/vehicle_1/left_aileron" in entities(recorded[0])  # escaped names show with backslashes
    drawn, own = (rows(recorded[0], path, "StateChange:state") for path in (lanes[0], "/vehicle_1/roll"))
    assert (drawn[0].tolist(), drawn[1]) == (own[0].tolist(), own[1])


def test_the_lane_turns_when_the_verdict_says(recorded: tuple[Path, Any]) -> None:
    [roll] = [verdict for verdict in recorded[1].verdicts if verdict.actuator == "roll"]
    since_s = present(roll.since).flight_time_s
    assert since_s == min(item.start_s for item in roll.evidence)
    times, _ = rows(recorded[0], "/condition/1_roll_control", "StateChange:state")
    assert times[-1] == pytest.approx(since_s, abs=1e-5)


def test_where_nothing_is_wrong_what_was_judged_has_the_first_lane(tmp_path: Path) -> None:
    analyse(Path(__file__).parents[1] / "data" / "healthy.tlog", recording=tmp_path / "flight.rrd")
    lanes = [path for path in entities(tmp_path / "flight.rrd") if path.startswith("/condition/")]
    assert sorted(lanes) == [f"/condition/{lane}_control" for lane in ("1_roll", "2_pitch", "3_yaw")]


def test_names_that_differ_in_signs_alone_have_lanes_of_their_own() -> None:
    writer = RowWriter(open_stream("x"), live=False)
    first = Track(writer, 1, "left aileron", CraftModel(writer, 1))
    other = Track(writer, 1, "left-aileron", CraftModel(writer, 1), {first.root})
    assert (first.root, other.root) == ("/vehicle_1/left_aileron", "/vehicle_1/left_aileron_")


def test_what_the_report_does_not_judge_has_no_lane() -> None:
    """Telemetry of the servos may take the place of axes that were followed in vain; motors stay."""
    time, values = np.arange(2.0), np.zeros((2, 2))
    scene = Scene(open_stream("x"), live=False, position=False)
    scene.consume([Trace(1, "roll", "roll_angle", time, values), Trace(1, "motor 1", "thrust", time, values)])
    scene.consume([samples_of("rudder", time, np.zeros((2, 12)))])
    lanes = scene._lanes(new_assessment(new_verdict("rudder", "normal", 0.2, None)))
    assert [lane.title for lane in lanes] == ["rudder", "motor 1"]
