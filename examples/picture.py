"""Render a recording to a picture, without a screen: for a report, a web page, or a test.

    python examples/picture.py flight.rrd flight.png

It needs the extra ``viewer`` and a Vulkan driver (on Debian the package mesa-vulkan-drivers).
"""

from __future__ import annotations

import io
import socket
import sys
import time
from pathlib import Path


def draw(source: str | Path, *, settle_s: float = 0.0, patience_s: float = 120.0) -> bytes:
    """Return what the viewer shows on opening a recording, as a PNG of 1920 × 1080.

    Parameters
    ----------
    source
        A recording, or the URL of a live flight.
    settle_s
        Minimum display time: the viewer shows start messages for six seconds.
    patience_s
        Maximum time until two consecutive pictures are equal, that is, until rendering is complete.

    Raises
    ------
    RuntimeError
        If a view reports an error.
    TimeoutError
        If the picture does not become stable.
    """
    import rerun_cli
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    # The program itself, for the `rerun` command is a wrapper that would leave it running.
    viewer = str(Path(rerun_cli.__file__).with_name("rerun"))
    with ViewerClient.spawn(
        headless=True, hide_welcome_screen=True, port=port, executable_path=viewer, memory_limit="1GB"
    ) as client:
        client.open(str(source))
        start = time.monotonic()
        before, drawn = b"", client.take_screenshot()
        while (
            not alike(before, drawn)
            or time.monotonic() < start + settle_s
            or client.get_state().loading
            or not client.get_state().recordings
        ):
            if time.monotonic() > start + patience_s:
                raise TimeoutError(f"{source}: the viewer does not come to rest")
            time.sleep(0.3)
            before, drawn = drawn, client.take_screenshot()
        reports = [f"{view.name}: {report}" for view in client.get_state().views for report in view.reports]
    if reports:
        raise RuntimeError(f"{source}: {reports[0]}")
    return drawn


def alike(one: bytes, other: bytes) -> bool:
    """Return whether two pictures are equal except for flicker in less than a fiftieth of the pixels."""
    import numpy as np
    from PIL import Image

    if not one or not other:
        return False
    with Image.open(io.BytesIO(one)) as left, Image.open(io.BytesIO(other)) as right:
        differing = (np.asarray(left) != np.asarray(right)).any(axis=-1)
    return bool(differing.mean() < 0.02)


def save(source: str | Path, picture: Path) -> None:
    """Draw ``source`` and write it to ``picture`` in 256 colours, which is enough and small."""
    from PIL import Image

    with Image.open(io.BytesIO(draw(source, settle_s=8.0))) as image:
        few = image.convert("RGB").quantize(
            256, Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE
        )  # other methods lose the colour of a line that covers few pixels
        few.save(picture, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: picture.py RECORDING.rrd PICTURE.png")
    try:
        save(sys.argv[1], Path(sys.argv[2]))
    except ImportError as error:
        sys.exit(f"{error}: pip install 'mavhums[viewer]' pillow")
