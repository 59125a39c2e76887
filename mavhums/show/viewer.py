"""The viewer of Rerun: its program, its web files, and a flight shown live in it."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
import webbrowser
from collections.abc import Iterable
from pathlib import Path
from typing import Final, Self
from urllib.error import URLError

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.engine.events import Event
from mavhums.results.assessment import Assessment
from mavhums.show.recorder import draw, end

WEB_FILES: Final = ("index.html", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""The files that a browser needs to show a recording."""

_HERE: Final = "127.0.0.1"
_BIND: Final = ("--bind", _HERE)
_START_S: Final = 30.0


def viewer_call(*arguments: str) -> list[str]:
    """Return the call of the viewer itself; the ``rerun`` command is a wrapper that would leave it running.

    By itself a viewer listens on all interfaces, and shows whatever is sent to it, even one that only opens a
    file; this one listens on the loopback address.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import rerun_cli
    except ImportError as error:
        raise MissingExtraError("the 3-D viewer", "viewer") from error
    folder = Path(rerun_cli.__file__).parent
    program = next((path for name in ("rerun", "rerun.exe") if (path := folder / name).exists()), None)
    if program is None:
        raise MissingExtraError("the 3-D viewer", "viewer")
    return [str(program), *_BIND, *arguments]


def viewer_command() -> str:
    """Return what a user types to start the viewer: the command on the PATH, else that beside Python."""
    beside = Path(sys.executable).with_name("rerun")
    program = "rerun" if shutil.which("rerun") or not beside.exists() else os.path.relpath(beside)
    return " ".join((program, *_BIND))


def save_web_viewer(folder: Path) -> None:
    """Write the files of the web viewer, which the program carries in itself, into a folder.

    Parameters
    ----------
    folder
        An existing folder.

    Raises
    ------
    MissingExtraError
        If the viewer is not installed.
    MavhumsError
        If it does not give its files.
    """
    web, data = free_port(0), free_port(0)
    process = _started("--serve-web", "--web-viewer-port", str(web), "--port", str(data))
    try:
        for name in WEB_FILES:
            content = _fetched(f"http://{_HERE}:{web}/{'' if name == 'index.html' else name}")
            (folder / name).write_bytes(content)
    finally:
        process.kill()
        process.wait()


def _started(*arguments: str, own_group: bool = False) -> subprocess.Popen[bytes]:
    """Start the viewer; in a group of its own a window outlives this process and its Ctrl-C.

    So the user can examine the flight afterwards.
    """
    none = subprocess.DEVNULL
    call = viewer_call(*arguments)
    return subprocess.Popen(call, stdin=none, stdout=none, stderr=none, start_new_session=own_group)


def _fetched(address: str) -> bytes:
    """Return what the viewer serves, waiting until it has started."""
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    end_s = time.monotonic() + _START_S
    while True:
        try:
            with direct.open(address, timeout=_START_S) as answer:
                content: bytes = answer.read()
                return content
        except (URLError, OSError) as error:
            if time.monotonic() > end_s:
                raise MavhumsError("the 3-D viewer does not start", "try: rerun --serve-web") from error
            time.sleep(0.05)


def free_port(wanted: int) -> int:
    """Return ``wanted`` if this port is free on the loopback address, else any free port."""
    for port in (wanted, 0):
        with socket.socket() as probe:
            try:
                probe.bind((_HERE, port))
            except OSError:
                continue
            free: int = probe.getsockname()[1]
            return free
    raise MavhumsError("no port is free to serve the viewer", "close other programs")


_PORT, _WEB_PORT = 9876, 9090
_EVERY_S: Final = 0.25
_SERVER_MEMORY: Final = "64MiB"


class LiveViewer:
    """Draws the engine's events in a viewer during the flight, in bounded memory.

    The data are served only on the loopback address; viewers may connect and disconnect at any time.

    Parameters
    ----------
    viewer
        ``"window"`` opens the viewer's window; ``"browser"`` opens it in the browser; ``"web"`` serves
        the web viewer without opening it; ``"serve"`` only serves the data, for ``rerun --connect URL``;
        a ``rerun+http://…/proxy`` URL sends to a running viewer.
    recording_id
        Unique identifier of the flight.
    position
        Whether to show the aircraft's position.
    memory_limit
        Memory limit of the viewer's window, such as ``"2GB"``: the oldest data beyond it are dropped. A
        browser has its own limit.

    Attributes
    ----------
    url
        Address of the display: an http address for a web viewer, else one for ``rerun --connect``.

    Raises
    ------
    MissingExtraError
        If rerun is not installed.
    MavhumsError
        If the viewer cannot be started, or the URL is none.

    Examples
    --------
    >>> with LiveViewer("serve", recording_id="6f1c") as viewer:  # doctest: +SKIP
    ...     print(f"rerun --connect {viewer.url}")
    ...     viewer.consume(engine.feed(datagram))
    ...     viewer.close(engine.assessment())
    """

    def __init__(
        self,
        viewer: str = "window",
        *,
        recording_id: str,
        position: bool = True,
        memory_limit: str = "2GB",
    ) -> None:
        if viewer not in ("window", "browser", "web", "serve") and "://" not in viewer:
            remedy = "one of window, browser, web, serve, or a rerun+http:// URL"
            raise MavhumsError(f"no viewer {viewer!r}", remedy)
        self.url = ""
        self._viewer = viewer
        self._memory_limit = memory_limit
        self._stream, self._scene = draw(recording_id, live=True, position=position)
        self._process: subprocess.Popen[bytes] | None = None
        self._flushed_s = 0.0
        self._laid_out: object = None

    def __enter__(self) -> Self:
        try:
            self._open()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.disconnect()
        if self._process and self._viewer != "window":
            self._process.terminate()
            self._process.wait()

    @property
    def trouble(self) -> str | None:
        """Reason why the viewer could not run; None if it runs."""
        code = self._process.poll() if self._process else None
        if not code:
            return None
        return (
            f"the viewer ended with code {code}; without a screen, serve it: --viewer web or --viewer serve"
        )

    def consume(self, events: Iterable[Event]) -> None:
        """Process the engine's events, in order; they are drawn four times a second."""
        self._scene.consume(events)
        now = time.monotonic()
        if now - self._flushed_s >= _EVERY_S:
            self._flushed_s = now
            self._draw()

    def close(self, assessment: Assessment) -> None:
        """Draw the end of the flight and its report."""
        end(self._stream, self._scene, assessment, "live")
        self._stream.flush(timeout_sec=2.0)

    def _draw(self) -> None:
        if not self._scene.tracks:
            return
        self._scene.flush()
        shape = self._scene.live_shape()
        if shape != self._laid_out:
            from mavhums.show.blueprint import layout

            self._laid_out = shape
            self._stream.send_blueprint(layout(*shape, live=True), make_active=True, make_default=True)
        # Rerun queues hundreds of megabytes for a viewer that hangs; who waits here drops and counts them.
        self._stream.flush()

    def _open(self) -> None:
        import rerun as rr

        if "://" in self._viewer:
            self.url = self._viewer
            try:
                self._stream.connect_grpc(self.url)
            except Exception as error:
                raise MavhumsError(f"{self.url}: {error}", "start the viewer first: rerun") from error
            return
        port = free_port(_PORT)
        self._stream.set_sinks(rr.GrpcServerSink(_HERE, port, server_memory_limit=_SERVER_MEMORY))
        self.url = data = f"rerun+http://{_HERE}:{port}/proxy"
        if self._viewer == "window":
            limit = ["--memory-limit", self._memory_limit]
            self._process = _started("--connect", data, *limit, "--hide-welcome-screen", own_group=True)
        elif self._viewer in ("browser", "web"):
            web = str(free_port(_WEB_PORT))
            self._process = _started("--serve-web", "--web-viewer-port", web, data)
            self.url = f"http://{_HERE}:{web}?url={data.replace('+', '%2B').replace(':', '%3A')}"
            if self._viewer == "browser":
                webbrowser.open(self.url)
