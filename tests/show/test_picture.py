"""The recording as a person sees it: the viewer draws it without a screen, and the colours are counted."""

from __future__ import annotations

import io
import socket
import sys
import sysconfig
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from mavhums.assessment import Assessment
from mavhums.show import Recorder

if TYPE_CHECKING:
    from tests.show.conftest import Flight

pytest.importorskip("rerun", reason="pictures need the extra 'viewer'")

DRIVERS = [
    file
    for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")
    for file in Path(folder).glob("*.json")
]
VIEWER = Path(sysconfig.get_path("scripts")) / "rerun"

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="the viewer draws without a screen on Linux"),
    pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver; Debian has one in mesa-vulkan-drivers"),
    pytest.mark.skipif(not VIEWER.exists(), reason=f"no viewer at {VIEWER}"),
]


def picture(recording: Path, patience_s: float = 40.0) -> NDArray[np.int16]:
    """Open a recording in a viewer of its own and return what it draws once two pictures agree."""
    from PIL import Image
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = {"port": port, "executable_path": str(VIEWER), "memory_limit": "1GB"}
    with ViewerClient.spawn(headless=True, hide_welcome_screen=True, **options) as viewer:
        viewer.open(str(recording))
        deadline = time.monotonic() + patience_s
        before, drawn = b"", viewer.take_screenshot()
        while before != drawn or viewer.get_state().loading or not viewer.get_state().recordings:
            assert time.monotonic() < deadline, "the viewer does not settle"
            time.sleep(0.3)
            before, drawn = drawn, viewer.take_screenshot()
        reports = [report for view in viewer.get_state().views for report in view.reports]
        assert reports == []
    with Image.open(io.BytesIO(drawn)) as image:
        return np.asarray(image.convert("RGB")).astype(np.int16)


def count(pixels: NDArray[np.int16], colour: tuple[int, int, int], tolerance: int = 60) -> int:
    return int((np.abs(pixels - np.array(colour)).sum(axis=-1) <= tolerance).sum())


def test_a_person_sees_the_conditions_and_every_series(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    path = tmp_path / "flight.rrd"
    with Recorder(path, recording_id="flight") as recorder:
        recorder.consume(flight.events())
        recorder.close(assessment)
    pixels = picture(path)
    height, width, _ = pixels.shape
    lanes = pixels[: height // 4, : width * 2 // 3]
    # The viewer dims the colours of states.
    for name, colour in {
        "normal": (0, 126, 92),
        "degraded": (184, 127, 0),
        "emergency": (170, 75, 0),
        "undecided": (122, 122, 122),
    }.items():
        assert count(lanes, colour) > 500, f"{name} is not on the timeline"
    plots = pixels[height // 4 :, : width * 2 // 3]
    for name, colour in {
        "friction and V1": (86, 180, 233),
        "normal limit": (230, 159, 0),
        "emergency limit": (213, 94, 0),
        "V3 and V9": (240, 228, 66),
        "V12": (204, 121, 167),
    }.items():
        assert count(plots, colour) > 300, f"{name} is in the legend at most"
    report = pixels[:, width * 2 // 3 :]
    assert (report.min(axis=-1) > 150).sum() > 5000, "the report is not drawn"
