"""A browser at the page, and the page as a program of its own."""

from __future__ import annotations

import base64
import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from tests.show.chromium import Chromium, find

BROWSER = find()
_PATIENCE_S = 240.0  # a browser that draws without a GPU beside other work


class Served(NamedTuple):
    """A running ``mavhums serve``: its address, its output so far, its process."""

    url: str
    lines: list[str]
    process: subprocess.Popen[str]


@contextmanager
def served(*arguments: str | Path, lines: int = 2) -> Iterator[Served]:
    """Run ``mavhums serve`` on a free port until the end of the block."""
    command = [sys.executable, "-m", "mavhums", "serve", "--port", "0", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout
    try:
        printed = [process.stdout.readline().strip() for _ in range(lines)]
        found = re.search(r"https?://\S+", printed[0])
        assert found, printed
        yield Served(found[0].rstrip("/"), printed, process)
    finally:
        process.terminate()
        process.wait(timeout=30)
        process.stdout.close()


class Browser(Chromium):
    """A browser with the steps of a user."""

    def size(self, width: int, height: int = 900, *, scheme: str = "light") -> None:
        """Set the width of the page, and light or dark."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        colours = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", features=colours)

    def open(self, url: str) -> None:
        """Open a page, and wait until it is loaded."""
        self.call("Page.navigate", url=url)
        self.wait(f"document.readyState == 'complete' && location.href.startsWith({json.dumps(url)})")

    def js(self, expression: str) -> Any:
        """Return what an expression, or its promise, gives."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str, patience_s: float = _PATIENCE_S) -> Any:
        """Return the value of an expression as soon as it is true."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            try:
                found = self.js(condition)
            except AssertionError:  # between two pages
                found = None
            if found or found == {}:  # a node has no value
                return found
            time.sleep(0.05)
        raise AssertionError(f"never true: {condition}\n{self.js('document.body.innerText')}")

    def choose(self, files: Sequence[Path]) -> None:
        """Choose files, as with the dialogue."""
        self.wait("document.readyState == 'complete' && document.querySelector('#logs')")
        node = self.call("Runtime.evaluate", expression="document.querySelector('#logs')")["result"]
        self.call("DOM.setFileInputFiles", files=[str(file) for file in files], objectId=node["objectId"])

    def drop(self, files: Sequence[Path]) -> None:
        """Drag files from the desktop onto the page's place for them."""
        self.wait("document.readyState == 'complete' && document.querySelector('[data-drop]')")
        x, y = self.js(
            "(() => {const r = document.querySelector('[data-drop]').getBoundingClientRect();"
            " return [r.x + r.width / 2, r.y + r.height / 2]})()"
        )
        data = {"items": [], "files": [str(file) for file in files], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def press(self, text: str) -> None:
        """Press the first visible button with a text."""
        buttons = "[...document.querySelectorAll('button')]"
        found = f"{buttons}.find(b => b.offsetParent && b.innerText.includes({json.dumps(text)}))"
        self.wait(found)
        self.js(f"{found}.click()")

    def whole(self, most: int = 4000) -> bytes:
        """Return the whole page, or so many pixels of its height, as a PNG."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {
            "x": 0,
            "y": 0,
            "width": self.js("innerWidth"),
            "height": min(size["height"], most),
            "scale": 1,
        }
        answer = self.call("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)
        return base64.b64decode(answer["data"])

    def paper(self) -> bytes:
        """Return the page as a PDF."""
        return base64.b64decode(self.call("Page.printToPDF", printBackground=False)["data"])


def violations(browser: Browser) -> list[str]:
    """Return what axe finds serious or critical on the open page."""
    import axe_core_python

    script = Path(axe_core_python.__file__).with_name("axe.min.js").read_text(encoding="utf-8")
    browser.js(f"{script};1")
    found = browser.js("axe.run(document, {iframes: false})")["violations"]
    return [
        f"{one['id']}: {one['nodes'][0]['html'][:200]}"
        for one in found
        if one["impact"] in ("serious", "critical")
    ]
