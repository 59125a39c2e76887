"""Recordings as a person sees them: viewers draw them without a screen, and the colours are counted."""

from __future__ import annotations

import io
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from examples.picture import draw
from mavhums.engine.events import Event
from mavhums.results.assessment import Assessment
from mavhums.show.recorder import Recorder
from mavhums.show.viewer import LiveViewer
from mavhums.vehicle.states import Attitude, FlightMode, Position
from tests.show.chromium import Chromium, find
from tests.show.conftest import Flight

pytest.importorskip("rerun", reason="pictures need the extra 'viewer'")

FOLDERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")
DRIVERS = [file for folder in FOLDERS for file in Path(folder).glob("*.json")]
BROWSER = find()
needs_vulkan = pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver; see mesa-vulkan-drivers")

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="viewers draw without a screen on Linux")

Pixels = NDArray[np.int16]

# The viewer dims the colours of states in the dark theme.
LANES = {"normal": (0, 126, 92), "degraded": (184, 127, 0)}
LANES |= {"emergency": (170, 75, 0), "undecided": (122, 122, 122)}
BLUE, YELLOW, AMBER, VERMILION = (86, 180, 233), (240, 228, 66), (230, 159, 0), (213, 94, 0)
GREEN = (0, 158, 115)


def pixels(png: bytes) -> Pixels:
    """Return a picture as an array, shape (height, width, 3)."""
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB")).astype(np.int16)


def count(part: Pixels, colour: tuple[int, int, int], tolerance: int = 60) -> int:
    return int((np.abs(part - np.array(colour)).sum(axis=-1) <= tolerance).sum())


def hue(part: Pixels, colour: tuple[int, int, int]) -> int:
    """Count what has a colour's hue, in light or in shade."""
    shade = part / np.maximum(part.max(axis=-1, keepdims=True), 1)
    wanted = np.array(colour) / max(colour)
    bright = part.max(axis=-1) > 60
    return int((bright & (np.abs(shade - wanted).sum(axis=-1) < 0.35)).sum())


def surroundings() -> list[Event]:
    """A vehicle that turns, flies a line, and changes its mode."""
    time_s = np.arange(0, 100, 0.2)
    angles = np.stack([0.3 * np.sin(time_s / 5), 0 * time_s, time_s / 30], axis=1)
    degrees = np.stack([51 + time_s / 1e4, time_s / 1e4], axis=1)
    modes = [FlightMode(1, 0.0, "TAKEOFF"), FlightMode(1, 30.0, "AUTO")]
    return [*modes, Attitude(1, time_s, angles), Position(1, time_s, degrees, time_s)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory, flight: Flight, assessment: Assessment) -> Path:
    path = tmp_path_factory.mktemp("picture") / "flight.rrd"
    with Recorder(path, recording_id="flight") as recorder:
        recorder.consume([*surroundings(), *flight.events()])
        recorder.close(assessment)
    return path


def check(drawn: Pixels) -> None:
    """Hold every view of the flight against what it must show."""
    height, width, _ = drawn.shape
    lanes = drawn[: height // 3, : width * 3 // 4]
    for name, colour in LANES.items():
        assert count(lanes, colour) > 500, f"{name} is not on the timeline"
    plots = drawn[height // 3 :, : width * 15 // 32]
    curves = {"friction, V1": BLUE, "normal limit": AMBER, "emergency limit": VERMILION, "V3, V9": YELLOW}
    for name, colour in curves.items():
        assert count(plots, colour) > 200, f"{name} is in the legend at most"
    middle = drawn[height // 3 :, width * 15 // 32 : width * 3 // 4]
    for name, colour in {"the healthy surfaces": GREEN, "the elevator": VERMILION}.items():
        assert hue(middle, colour) > 200, f"{name} of the airframe"
    assert count(middle, BLUE) > 30, "the line on the map"
    report = drawn[:, width * 3 // 4 :]
    assert (report.min(axis=-1) > 150).sum() > 3000, "the report is not drawn"


@pytest.mark.slow
@needs_vulkan
def test_a_person_sees_every_view_with_its_data(recording: Path) -> None:
    check(pixels(draw(recording)))


@pytest.mark.skipif(BROWSER is None, reason="no browser; Debian has one in the package chromium")
@pytest.mark.slow
def test_the_browser_shows_the_same(recording: Path, flight: Flight, assessment: Assessment) -> None:
    with LiveViewer("web", recording_id="flight") as viewer, Chromium(str(BROWSER)) as browser:
        viewer.consume([*surroundings(), *flight.events()])
        viewer.close(assessment)
        browser.call("Page.navigate", url=f"{viewer.url}&renderer=webgl&hide_welcome_screen=1")
        end = time.monotonic() + 120
        while True:
            time.sleep(2)
            try:
                check(pixels(browser.picture()))
                break
            except AssertionError:
                if time.monotonic() > end:
                    raise
    assert not [error for error in browser.errors if "panicked" in error]
