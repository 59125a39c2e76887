"""Rerun's viewer as a program of its own, and the files of its web viewer."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Final
from urllib.error import URLError

from mavhums.core.errors import MavhumsError, MissingExtraError

__all__ = ["WEB_FILES", "free_port", "save_web_viewer", "viewer_command", "viewer_program"]

WEB_FILES: Final = ("index.html", "re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
"""The files that a browser needs to show a recording."""

_HERE: Final = "127.0.0.1"
_START_S: Final = 30.0


def viewer_program() -> Path:
    """Return the viewer itself; the ``rerun`` command is a wrapper that would leave it running.

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
    return program


def viewer_command() -> str:
    """Return what a user types to start the viewer: the command on the PATH, else that beside Python."""
    beside = Path(sys.executable).with_name("rerun")
    return "rerun" if shutil.which("rerun") or not beside.exists() else os.path.relpath(beside)


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
    command = [str(viewer_program()), "--serve-web", "--bind", _HERE]
    command += ["--web-viewer-port", str(web), "--port", str(data)]
    none = subprocess.DEVNULL
    process = subprocess.Popen(command, stdin=none, stdout=none, stderr=none)
    try:
        for name in WEB_FILES:
            content = _fetched(f"http://{_HERE}:{web}/{'' if name == 'index.html' else name}")
            (folder / name).write_bytes(content)
    finally:
        process.kill()
        process.wait()


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
