"""The parts of a session: addresses, recorder, what is remembered, the view, the lines."""

from __future__ import annotations

import io
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from mavhums.live.links import Address, AddressError
from mavhums.live.outlet import TlogRecorder
from mavhums.live.setup import SeenSignatures
from mavhums.live.sinks import DrawingSink, JsonLines, PlainLines, View
from mavhums.log.mavlink.stamping import Piece
from mavhums.results import live as objects
from mavhums.results.assessment import json_schema
from mavhums.show.now import status_blocks
from mavhums.show.terminal import plain
from mavhums_sim.link import EPOCH_US
from tests.live.conftest import Rig


@pytest.mark.parametrize(
    ("url", "meant", "exposed"),
    [
        ("udpin:14550", "udpin:127.0.0.1:14550", False),
        ("udpin::14550", "udpin:127.0.0.1:14550", False),
        ("udpin:[::1]:14550", "udpin:[::1]:14550", False),
        ("udpin:0.0.0.0:14550", "udpin:0.0.0.0:14550", True),
        ("udpin:companion.local:14550", "udpin:companion.local:14550", True),
        ("serial:/dev/ttyACM0:115200", "serial:/dev/ttyACM0:115200", False),
        ("/dev/ttyUSB0,921600", "serial:/dev/ttyUSB0:921600", False),
        ("tcp:host:1", "tcp:host:1", False),
        ("udpout:host:65535", "udpout:host:65535", False),
    ],
)
def test_addresses_mean_what_they_say(url: str, meant: str, exposed: bool) -> None:
    address = Address.parse(url)
    assert str(address) == meant
    assert address.exposed is exposed
    assert Address.parse(meant) == address


@given(st.text(max_size=30))
def test_any_text_is_an_address_or_a_clear_error(text: str) -> None:
    try:
        address = Address.parse(text)
    except AddressError:
        return
    assert Address.parse(str(address)) == address


@pytest.mark.parametrize("url", ["udpin:65536", "tcp:host:65536", "udpout:host:0", "tcp:5760", "udpout::1"])
def test_an_address_without_a_host_or_port_is_refused(url: str) -> None:
    with pytest.raises(AddressError):
        Address.parse(url)


def wait_for(ready: Callable[[], object]) -> None:
    until = time.monotonic() + 60
    while not ready() and time.monotonic() < until:
        time.sleep(0.01)


def test_records_are_on_the_disk_within_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The data reach the operating system at once, and the disk in a second."""
    synced: list[int] = []
    monkeypatch.setattr("mavhums.live.outlet._SYNC_S", 0.02)
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_size))
    recorder = TlogRecorder(tmp_path / "a.tlog")
    recorder.write(b"12345678", 1)
    assert recorder.path.read_bytes() == b"12345678"
    wait_for(lambda: synced)
    assert synced == [8]
    recorder.close()
    assert synced == [8], "nothing new, nothing to do"


def test_a_disk_that_fails_is_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    recorder = TlogRecorder(tmp_path / "a.tlog")

    def fail(*_: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as broken:
        for call in ("write", "ftruncate", "fsync"):
            broken.setattr(os, call, fail)
        recorder.write(b"lost", 3)
        recorder.write(b"lost", 3)
        recorder._synced = -1
        recorder._sync()
    assert recorder.lost_frames == 6
    recorder.write(b"kept", 1)
    recorder.close()
    assert recorder.path.read_bytes() == b"kept"
    messages = [record.message for record in caplog.records]
    assert len(messages) == 3
    assert messages[0].endswith("No space left on device; the flight is judged, but not recorded")
    assert messages[2].endswith("written again; 6 frames are missing")


def test_what_was_seen_is_remembered(tmp_path: Path) -> None:
    key = tmp_path / "key"
    assert SeenSignatures(key).load() == {}
    kept, file = SeenSignatures(key), tmp_path / "key.seen"
    kept.save({(0, 1, 1): 5, (3, 2, 1): 7})
    again = SeenSignatures(key)
    latest = again.load()
    assert latest == {(0, 1, 1): 5, (3, 2, 1): 7}
    file.unlink()
    for seen in (kept, again):
        seen.save(latest)
        assert not file.exists(), "nothing new is not written"
    latest[0, 1, 1] = 6
    again.save(latest)
    assert SeenSignatures(key).load() == latest


@pytest.mark.parametrize("content", ["", "7", "[]", '{"0/1": 5}', '{"0/1/1": "x"}', '{"0/1/1": null}'])
def test_damaged_memory_is_said(tmp_path: Path, content: str, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "key.seen").write_text(content)
    assert SeenSignatures(tmp_path / "key").load() == {}
    assert "replays of former sessions cannot be recognised" in caplog.text


def test_memory_that_cannot_be_written_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    seen = SeenSignatures(tmp_path / "nonesuch" / "key")
    seen.save({(0, 1, 1): 5})
    seen.save({(0, 1, 1): 6})
    assert caplog.text.count("will not be recognised by the next") == 1


def test_the_schema_file_is_generated_from_the_classes() -> None:
    assert objects._generate_schema() == json_schema("live-1")


def flown(rig: Rig, worn_pieces: list[Piece]) -> Rig:
    rig.hear([piece for piece in worn_pieces if piece.time_us < EPOCH_US + 20_000_000])
    rig.wait_until(EPOCH_US + 21_000_000)
    return rig


def text_of(rig: Rig, notices: tuple[str, ...] = ()) -> str:
    return plain(status_blocks(rig.shown.statuses[-1], "udpin:14550", notices))


@pytest.mark.slow
def test_the_view_shows_verdicts_rates_ages_losses_and_silence(rig: Rig, worn_pieces: list[Piece]) -> None:
    flown(rig, worn_pieces)
    shown = text_of(rig, ("16.0s  elevator: \x1b[31mnormal",))
    row = next(line for line in shown.splitlines() if line.split()[1:2] == ["elevator"])
    assert "EMERGENCY: friction" in row
    assert "1.1 s" in row  # an eighth of a second later than the link: what is settled goes by such steps
    for part in ("lost or refused: nothing", "last data 1.0 s ago", "recording "):
        assert part in shown
    assert "elevator: �[31mnormal" in shown, "what comes from outside is not obeyed"
    rig.wait_until(EPOCH_US + 25_000_000)
    silent = text_of(rig)
    assert "STALE, was normal" in silent
    assert not any(line.split()[2:3] == ["normal"] for line in silent.splitlines())


def test_the_view_shows_what_is_refused_and_not_recorded(rig: Rig, worn_pieces: list[Piece]) -> None:
    rig.hear([Piece("noise", EPOCH_US + 1000, b"noise" * 9), *worn_pieces[:500:3]])
    rig.recorder.error, rig.recorder.lost_frames = "No space left on device", 1234
    rig.wait_until(EPOCH_US + 2_000_000)
    shown = text_of(rig)
    assert "45 bytes skipped" in shown
    assert "missing by sequence number" in shown
    assert "NOT RECORDED: No space left on device; 1,234 frames lost" in shown


@pytest.mark.slow
def test_the_view_stays_in_place_and_leaves_nothing(rig: Rig, worn_pieces: list[Piece]) -> None:
    screen = io.StringIO()
    view = View(Console(file=screen, force_terminal=True, width=100), "udpin:14550")
    flown(rig, worn_pieces)
    view.consume(rig.shown.events)
    view.announce(rig.shown.alerts)
    view.tick(rig.shown.statuses[-1], [])
    view.close(rig.session.close())
    assert "elevator: undecided → emergency (friction)" in screen.getvalue()
    assert "sent to the ground station: elevator EMERGENCY: friction, land now" in screen.getvalue()


class Failing:
    """Raises as a viewer does that was closed."""

    trouble = None

    def consume(self, events: object) -> None:
        raise RuntimeError("the viewer is gone")

    close = consume


@pytest.mark.slow
def test_lines_hold_all_by_the_schema_and_plainly_though_a_viewer_fails(
    rig: Rig, worn_pieces: list[Piece], caplog: pytest.LogCaptureFixture
) -> None:
    lines: list[str] = []
    plainly: list[str] = []
    drawn = DrawingSink(Failing(), "viewer", list, patience_s=30)  # type: ignore[arg-type]
    written = JsonLines(lines.append, rig.clock.now_us, rig.session.status)
    written.start(["udpin:127.0.0.1:14550"], airframe=None, signed_only=False)
    rig.session.sinks += [drawn, written, PlainLines(plainly.append)]
    flown(rig, worn_pieces).wait_until(EPOCH_US + 25_000_000)
    rig.end()
    assert drawn.finish()
    assert caplog.text.count("viewer: the viewer is gone; its output is dropped") == 1
    assert sum("elevator: undecided → emergency (friction)" in line for line in plainly) == 1
    assert sum("stale, silent for 3." in line for line in plainly) == 4
    objects = [json.loads(line) for line in lines]
    schema = jsonschema.Draft202012Validator(json_schema("live-1"))
    for one in objects:
        schema.validate(one)
    kinds = [one["event"] for one in objects]
    once = {"start", "airframe", "end"}
    assert {*kinds} == once | {"notice", "window", "condition", "alert", "stale", "status"}
    assert (kinds[0], kinds[-1]) == ("start", "end")
    assert objects[-1]["record"]["bytes"] == rig.recorder.bytes
