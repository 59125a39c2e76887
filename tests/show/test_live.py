from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mavhums.core.errors import MavhumsError
from mavhums.results.assessment import Assessment
from mavhums.show.viewer import LiveViewer, free_port, viewer_call

if TYPE_CHECKING:
    from tests.show.conftest import Flight

pytest.importorskip("rerun", reason="the viewer needs the extra 'viewer'")

from tests.show.test_recording import entities, scalars, static, write


def follow(url: str, path: Path) -> subprocess.Popen[bytes]:
    """Write what a viewer that connects to ``url`` would be sent."""
    command = viewer_call(url, "--port", "auto", "--save", str(path))
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def finished(process: subprocess.Popen[bytes], path: Path) -> None:
    """End the follower when what it writes has come to rest."""
    end, size = time.monotonic() + 60, -1
    while not path.exists() or path.stat().st_size != size:
        assert time.monotonic() < end, "nothing came"
        size = path.stat().st_size if path.exists() else -1
        time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    process.wait(60)
    whole = path.with_suffix(".whole")
    program, *_ = viewer_call()
    subprocess.run([program, "rrd", "optimize", path, "-o", whole], check=True, capture_output=True)
    whole.replace(path)


@pytest.mark.slow
def test_who_follows_sees_what_a_recording_has(
    tmp_path: Path, flight: Flight, assessment: Assessment
) -> None:
    seen = tmp_path / "seen.rrd"
    with LiveViewer("serve", recording_id="flight") as viewer:
        assert viewer.url.startswith("rerun+http://127.0.0.1:")
        follower = follow(viewer.url, seen)
        for event in flight.events():
            viewer.consume([event])
        assert viewer.trouble is None
        viewer.close(assessment)
        finished(follower, seen)
    whole = np.concatenate([flight.samples("elevator", k, k + 1).values for k in range(100)])
    kept = write(tmp_path / "kept.rrd", flight.events(), assessment)
    for path in (seen, kept):
        _, found = scalars(path, "/vehicle_1/elevator/quantities", "mavhums:V5")
        np.testing.assert_array_equal(found[:, 0], whole[:, 4])
        assert static(path, "/report")["TextDocument:text"][0].startswith("# EMERGENCY: elevator: ")
    assert entities(kept) == entities(seen)


@pytest.mark.slow
def test_drawing_waits_for_a_viewer_that_hangs(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavhums.show.viewer._EVERY_S", 0.0)
    port = free_port(0)
    command = viewer_call("--serve-grpc", "--port", str(port))
    hanging = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with LiveViewer(f"rerun+http://127.0.0.1:{port}/proxy", recording_id="flight") as viewer:
            first, *rest = flight.events()
            viewer.consume([first])
            hanging.send_signal(signal.SIGSTOP)

            def draw() -> None:
                for one in rest:
                    viewer.consume([one])

            drawing = threading.Thread(target=draw, daemon=True)
            drawing.start()
            drawing.join(20.0)
            waited = drawing.is_alive()
            hanging.send_signal(signal.SIGCONT)
            drawing.join(60.0)
            assert (waited, drawing.is_alive()) == (True, False)
    finally:
        hanging.kill()
        hanging.wait()


def test_two_links_have_ports_of_their_own(tmp_path: Path) -> None:
    with LiveViewer("serve", recording_id="1") as one, LiveViewer("serve", recording_id="2") as two:
        assert one.url != two.url


@pytest.mark.skipif(sys.platform != "linux", reason="the addresses are read from /proc")
def test_only_this_machine_can_look(tmp_path: Path) -> None:
    with LiveViewer("serve", recording_id="flight") as viewer:
        port = int(viewer.url.split(":")[2].split("/")[0])
        tables = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
        local = {line.split()[1] for line in tables.splitlines()}
        assert {place for place in local if place.endswith(f":{port:04X}")} == {f"0100007F:{port:04X}"}


def test_the_web_viewer_is_served_and_stopped() -> None:
    import urllib.request

    with LiveViewer("web", recording_id="flight") as viewer:
        address = viewer.url.split("?")[0]
        end = time.monotonic() + 60
        while True:
            try:
                page = urllib.request.urlopen(address, timeout=5).read()
                break
            except OSError:
                assert time.monotonic() < end, "nothing is served"
                time.sleep(0.1)
        assert b"rerun" in page.lower()
        assert "url=rerun%2Bhttp" in viewer.url
    host, port = address.removeprefix("http://").split(":")
    with socket.socket() as probe, pytest.raises(OSError, match="refused"):
        probe.connect((host, int(port)))


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("no_screen")
def test_a_viewer_that_opens_a_file_listens_on_the_loopback_address() -> None:
    call = viewer_call("--port", "auto", "nonesuch.rrd")
    for _ in range(10):  # without a screen it may end before it says where it listens
        done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=120)
        if "connections on " in done.stdout + done.stderr:
            break
    assert "connections on 127.0.0.1:" in done.stdout + done.stderr


@pytest.mark.usefixtures("no_screen")
def test_a_viewer_that_cannot_run_is_reported(flight: Flight) -> None:
    with LiveViewer("window", recording_id="flight") as viewer:
        end = time.monotonic() + 60
        while viewer.trouble is None and time.monotonic() < end:
            viewer.consume([flight.samples("elevator", 0, 1)])
            time.sleep(0.1)
        assert "without a screen" in (viewer.trouble or "")


@pytest.mark.parametrize(("viewer", "problem"), [("vr", "no viewer 'vr'"), ("ftp://x", "ftp://x: ")])
def test_a_viewer_that_there_is_not(viewer: str, problem: str) -> None:
    with pytest.raises(MavhumsError, match=problem), LiveViewer(viewer, recording_id="flight"):
        pass
