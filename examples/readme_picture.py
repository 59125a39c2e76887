"""Render the two views of a recording with the result, legible at the width of a page.

    python examples/readme_picture.py flight.rrd picture.png

The conditions of every actuator are above the worst one's friction against its limits. It needs what
``examples/picture.py`` needs, and a POSIX shell.
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL import Image
    from rerun.experimental import ViewerClient

WIDTH = 900
VIEWS = (
    ("Condition of every axis and actuator", "1200x1000"),
    ("Friction, N·m", "2890x1500"),
)
"""Views by title, and the window in which each is about as wide as the picture."""


def view(recording: Path, title: str, window: str, patience_s: float = 60.0) -> Image.Image:
    """Return the largest view of this title, drawn in a window of this size.

    Raises
    ------
    LookupError
        If no view has this title.
    """
    import rerun_cli
    from rerun.experimental import ViewerClient

    program = Path(rerun_cli.__file__).with_name("rerun")
    with tempfile.TemporaryDirectory() as folder:
        sized = Path(folder) / "rerun"
        sized.write_text(f'#!/bin/sh\nexec "{program}" --window-size {window} "$@"\n', encoding="utf-8")
        sized.chmod(0o755)
        with ViewerClient.spawn(
            headless=True, hide_welcome_screen=True, port=9917, executable_path=str(sized), memory_limit="1GB"
        ) as client:
            client.open(str(recording))
            end = time.monotonic() + patience_s
            while client.get_state().loading or not client.get_state().recordings:
                if time.monotonic() > end:
                    raise TimeoutError(f"{recording}: the viewer does not come to rest")
                time.sleep(0.3)
            time.sleep(8.0)
            shots = list(_shots(client, title))
    if not shots:
        raise LookupError(f"{recording}: no view {title!r}")
    return max(shots, key=lambda shot: shot.width * shot.height).convert("RGB")


def _shots(client: ViewerClient, title: str) -> Iterator[Image.Image]:
    """Yield every visible view of this title; hidden tabs are not visible."""
    from PIL import Image

    for one in client.get_state().views:
        if one.name == title:
            with suppress(ConnectionError):
                yield Image.open(io.BytesIO(client.take_screenshot(one.view_id)))


def main(recording: Path, picture: Path) -> None:
    """Draw the picture, in 256 colours."""
    from PIL import Image

    shots = [view(recording, title, window) for title, window in VIEWS]
    shots = [shot.resize((WIDTH, round(shot.height * WIDTH / shot.width))) for shot in shots]
    whole = Image.new("RGB", (WIDTH, sum(shot.height for shot in shots)))
    top = 0
    for shot in shots:
        whole.paste(shot, (0, top))
        top += shot.height
    few = whole.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    few.save(picture, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: readme_picture.py RECORDING.rrd PICTURE.png")
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    except ImportError as error:
        sys.exit(f"{error}: pip install 'mavhums[viewer]' pillow")
