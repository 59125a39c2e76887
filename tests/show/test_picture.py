"""The recording as a person sees it: the viewer draws it without a screen, and the colours are counted."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from examples.picture import draw
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

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="the viewer draws without a screen on Linux"),
    pytest.mark.skipif(not DRIVERS, reason="no Vulkan driver; Debian has one in mesa-vulkan-drivers"),
]


def picture(recording: Path) -> NDArray[np.int16]:
    """Return what a viewer of its own draws of a recording, shape (height, width, 3)."""
    from PIL import Image

    with Image.open(io.BytesIO(draw(recording))) as image:
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
