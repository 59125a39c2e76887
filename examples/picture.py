"""Draw a recording into a picture, without a screen: for a report, a web page, or a test.

    python examples/picture.py flight.rrd flight.png

It needs the extra ``viewer`` and a Vulkan driver (on Debian the package mesa-vulkan-drivers).
"""

from __future__ import annotations

import io
import socket
import sys
import time
from pathlib import Path

__all__ = ["draw"]


def draw(recording: Path, *, patience_s: float = 60.0) -> bytes:
    """Return the recording as the viewer shows it on opening, as a PNG of 1920 × 1080.

    Raises
    ------
    RuntimeError
        If a view reports an error.
    TimeoutError
        If the picture does not come to rest.
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
        client.open(str(recording))
        deadline = time.monotonic() + patience_s
        before, drawn = b"", client.take_screenshot()
        while before != drawn or client.get_state().loading or not client.get_state().recordings:
            if time.monotonic() > deadline:
                raise TimeoutError(f"{recording}: the viewer does not come to rest")
            time.sleep(0.3)
            before, drawn = drawn, client.take_screenshot()
        reports = [f"{view.name}: {report}" for view in client.get_state().views for report in view.reports]
    if reports:
        raise RuntimeError(f"{recording}: {reports[0]}")
    return drawn


def main(recording: Path, picture: Path) -> None:
    """Draw ``recording`` and write it to ``picture`` in 256 colours, which is enough and small."""
    from PIL import Image

    with Image.open(io.BytesIO(draw(recording))) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
