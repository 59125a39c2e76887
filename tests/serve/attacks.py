"""What clients that stall can do to ``mavhums serve``, and how soon another user of this computer is served.

    python -m tests.serve.attacks [NAME …]

starts ``mavhums serve`` for each attack. While the attack goes on for at most 60 s, a user opens the page,
drops a log of half a megabyte and waits for its verdict, in a headless Chromium. Printed are the seconds.
A client that drips and loses its place takes the next one within 6 s.
"""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tests.serve.browser import BROWSER, Browser, served

LOG: Final = Path(__file__).parents[1] / "data" / "healthy.tlog"
HERE: Final = "127.0.0.1"
_LASTS_S: Final = 60.0
_HEAD: Final = f"HTTP/1.1\r\nHost: {HERE}\r\n"
Client = Callable[[socket.socket], None]


def reads_nothing(link: socket.socket) -> None:
    """Ask for the 43 MB of the viewer, and never read."""
    link.sendall(f"GET /viewer/re_viewer_bg.wasm {_HEAD}\r\n".encode())


def drips(link: socket.socket) -> None:
    """Begin an upload, of which more comes with :func:`_again`."""
    link.sendall(f"POST /logs?name=a.tlog {_HEAD}Content-Length: 1000000\r\n\r\n".encode())


def uploads(link: socket.socket) -> None:
    """Upload a log without a cookie."""
    content = LOG.read_bytes()
    link.sendall(f"POST /logs?name=a.tlog {_HEAD}Content-Length: {len(content)}\r\n\r\n".encode() + content)


def half_header(link: socket.socket) -> None:
    """Send half a header."""
    link.sendall(f"GET / {_HEAD}X-".encode())


ATTACKS: Final[dict[str, tuple[int, Client, bytes]]] = {
    "nobody": (0, half_header, b""),
    "66 readers of 43 MB that read nothing": (66, reads_nothing, b""),
    "70 uploads that drip a byte in 5 s": (70, drips, b"x"),
    "100 uploads without a cookie": (100, uploads, b""),
    "210 half headers": (210, half_header, b"x"),
}


def _attack(port: int, begin: Client, more: bytes, over: threading.Event) -> None:
    """Hold a place as long as possible, and take the next one if it is lost."""
    while not over.is_set():
        with contextlib.suppress(OSError), socket.socket() as link:
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            link.settimeout(30.0)
            link.connect((HERE, port))
            begin(link)
            while not over.wait(5.0):
                if more:
                    link.sendall(more)
        over.wait(1.0)


def user(browser: Browser, url: str) -> str:
    """Return how soon a user opens the page, and how soon there is a verdict on a dropped log."""
    browser.call("Network.clearBrowserCookies")
    begin, told = time.monotonic(), list[str]()
    browser.call("Page.navigate", url="data:text/html,")
    while time.monotonic() - begin < _LASTS_S:
        browser.call("Page.navigate", url=url)
        with contextlib.suppress(AssertionError):
            browser.wait("document.querySelector('#logs')", 5.0)
            break
    else:
        return f"page: never in {_LASTS_S:.0f} s"
    told.append(f"page after {time.monotonic() - begin:.1f} s")
    time.sleep(1.0)  # until its script listens
    browser.choose([LOG])
    try:
        browser.wait("document.querySelector('.headline')", _LASTS_S)
    except AssertionError:
        return f"{told[0]}, verdict: never in {_LASTS_S:.0f} s"
    return f"{told[0]}, verdict after {time.monotonic() - begin:.1f} s"


def cost(count: int, begin: Client, more: bytes) -> str:
    """Return what a user sees of a page under an attack."""
    assert BROWSER, "needs Chromium"
    with served() as page, Browser(BROWSER) as browser:
        port = int(page.url.rpartition(":")[2])
        user(browser, page.url)  # the judging processes are ready
        with urllib.request.urlopen(f"{page.url}/viewer/re_viewer.js", timeout=120) as answer:
            answer.read()
        over = threading.Event()
        several = [threading.Thread(target=_attack, args=(port, begin, more, over)) for _ in range(count)]
        for one in several:
            one.start()
        time.sleep(3.0)
        try:
            return user(browser, page.url)
        finally:
            over.set()
            for one in several:
                one.join()


if __name__ == "__main__":
    for name, attack in ATTACKS.items():
        if not sys.argv[1:] or any(word in name for word in sys.argv[1:]):
            print(f"{name}: {cost(*attack)}", flush=True)
