"""Live display of a flight in the Rerun viewer."""

from __future__ import annotations

import os
import subprocess
import time
import webbrowser
from collections.abc import Iterable
from contextlib import ExitStack
from typing import Final, Self

from mavhums.core.errors import MavhumsError
from mavhums.engine.events import Event
from mavhums.results.assessment import Assessment
from mavhums.show.recording import Recorder, draw, end
from mavhums.show.viewer_program import free_port, viewer_program

__all__ = ["LiveViewer"]

_HERE: Final = "127.0.0.1"
_PORT, _WEB_PORT = 9876, 9090
_EVERY_S: Final = 0.25
_SERVER_MEMORY: Final = "256MiB"


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
    recording
        Path of an additional recording; as with :class:`Recorder`, it appears when it is closed.
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
        recording: str | os.PathLike[str] | None = None,
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
        self._recorder = (
            None if recording is None else Recorder(recording, recording_id=recording_id, position=position)
        )
        self._process: subprocess.Popen[bytes] | None = None
        self._exits = ExitStack()
        self._flushed_s = 0.0
        self._laid_out: object = None

    def __enter__(self) -> Self:
        with self._exits as exits:
            if self._recorder:
                exits.enter_context(self._recorder)
            exits.callback(self._stream.disconnect)
            self._open()
            self._exits = exits.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._exits.close()

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
        events = list(events)
        if self._recorder:
            self._recorder.consume(events)
        self._scene.consume(events)
        now = time.monotonic()
        if now - self._flushed_s >= _EVERY_S:
            self._flushed_s = now
            self._draw()

    def close(self, assessment: Assessment) -> None:
        """Draw the end of the flight and its report, and publish the recording."""
        end(self._stream, self._scene, assessment, "live")
        self._stream.flush(timeout_sec=2.0)
        if self._recorder:
            self._recorder.close(assessment)

    def _draw(self) -> None:
        if not self._scene.tracks:
            return
        self._scene.flush()
        self._scene.live_report()
        shape = self._scene.shape()
        if shape != self._laid_out:
            self._laid_out = shape
            self._stream.send_blueprint(self._scene.live_layout(), make_active=True, make_default=True)

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
            self._start("--connect", data, *limit, "--hide-welcome-screen", own_group=True)
        elif self._viewer in ("browser", "web"):
            web = str(free_port(_WEB_PORT))
            self._start("--serve-web", "--bind", _HERE, "--web-viewer-port", web, data)
            self._exits.callback(self._stop)
            self.url = f"http://{_HERE}:{web}?url={data.replace('+', '%2B').replace(':', '%3A')}"
            if self._viewer == "browser":
                webbrowser.open(self.url)

    def _start(self, *arguments: str, own_group: bool = False) -> None:
        """Start the viewer itself, because the ``rerun`` command is a wrapper that would leave it running.

        A window outlives this process and its Ctrl-C, so that the user can examine the flight afterwards.
        """
        none = subprocess.DEVNULL
        self._process = subprocess.Popen(
            [str(viewer_program()), *arguments],
            stdin=none,
            stdout=none,
            stderr=none,
            start_new_session=own_group,
        )

    def _stop(self) -> None:
        if self._process:
            self._process.terminate()
            self._process.wait()
