"""A live session's file is followed as it grows, whatever is written in it."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mavhums.results.live import ActuatorStatus, LinkStatus
from mavhums.serve.views import LiveFile
from mavhums.show.html import draw
from tests.present import present

UTC = "2026-01-01T00:00:00+00:00"
LINK = dict.fromkeys(LinkStatus.model_fields, 0) | {"age_s": 0.1, "contested": ()}


def start() -> dict[str, Any]:
    more = {"schema": "mavhums.live/1", "notice": "n", "version": "1", "links": ["udpin:1"], "airframe": None}
    return {"event": "start", "utc": UTC, **more, "record": None, "signed_only": False}


def status(uptime_s: float, condition: str = "normal") -> dict[str, Any]:
    actuator = dict.fromkeys(ActuatorStatus.model_fields) | {"vehicle": 1, "actuator": "<b>elevator"}
    actuator |= dict.fromkeys(("condition", "held", "worst"), condition)
    actuator |= {"stale": False, "rate_hz": 50.0, "suspects": [], "late": 0}
    more = {"uptime_s": uptime_s, "actuators": [actuator], "link": LINK, "record": None}
    return {"event": "status", "utc": UTC, **more}


def change(time_s: float) -> dict[str, Any]:
    more = {"vehicle": 1, "actuator": "elevator", "time_s": time_s, "since_s": 0.0, "before": "normal"}
    return {"event": "condition", "utc": UTC, **more, "after": "degraded", "fault": None, "rule": "r"}


def write(path: Path, *objects: dict[str, Any]) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.writelines(json.dumps(one) + "\n" for one in objects)


def test_the_state_follows_the_file(tmp_path: Path) -> None:
    path = tmp_path / "live.jsonl"
    file = LiveFile(path)
    assert "cannot be read" in file.seen().note
    write(path, start(), status(1.0))
    seen = file.seen()
    assert (seen.note, seen.end) == ("", None)
    assert present(seen.start).links == ("udpin:1",)
    assert present(seen.status).uptime_s == 1.0
    write(path, change(1.5), change(1.7), status(2.0, "degraded"))
    seen = file.seen()
    assert present(seen.status).actuators[0].condition == "degraded"
    assert [one.time_s for one in seen.changes if one.event == "condition"] == [1.7, 1.5]
    markup = draw(seen.blocks(), "h2")
    assert "(running)" in markup
    assert "&lt;b&gt;elevator" in markup


def test_a_line_is_taken_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "live.jsonl"
    line = json.dumps(status(3.0)).encode()
    path.write_bytes(json.dumps(start()).encode() + b"\n" + line[:50])
    file = LiveFile(path)
    assert file.seen().status is None
    with path.open("ab") as output:
        output.write(line[50:] + b"\n")
    assert present(file.seen().status).uptime_s == 3.0


def test_of_a_long_file_the_beginning_and_the_end_are_read(tmp_path: Path) -> None:
    path = tmp_path / "live.jsonl"
    write(path, start(), change(1.0), *[status(float(k)) for k in range(4000)], change(2.0))
    assert path.stat().st_size > 2 << 20
    seen = LiveFile(path).seen()
    assert seen.start
    assert present(seen.status).uptime_s == 3999.0
    assert [one.time_s for one in seen.changes if one.event == "condition"] == [2.0]


def test_a_new_session_in_the_same_file_replaces_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "live.jsonl"
    write(path, start(), status(50.0), change(3.0))
    file = LiveFile(path)
    file.seen()
    path.write_text("", encoding="utf-8")
    write(path, start())
    seen = file.seen()
    assert seen.status is None
    assert seen.changes == ()


def test_a_silent_session_is_said_to_be_silent(tmp_path: Path) -> None:
    path = tmp_path / "live.jsonl"
    write(path, start(), status(1.0))
    os.utime(path, (time.time() - 60, time.time() - 60))
    assert "no line for 6" in LiveFile(path).seen().note


@pytest.mark.skipif(sys.platform == "win32", reason="files of POSIX")
def test_a_pipe_is_refused_and_does_not_block_the_page(tmp_path: Path) -> None:
    path = tmp_path / "live.jsonl"
    os.mkfifo(path)
    notes: list[str] = []
    reading = Thread(target=lambda: notes.append(LiveFile(path).seen().note), daemon=True)
    reading.start()
    reading.join(10)
    assert "is a pipe" in notes[0]


@pytest.mark.filterwarnings("ignore")
@given(st.binary(max_size=300) | st.text(max_size=100).map(str.encode))
def test_any_content_is_survived(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("odd") / "live.jsonl"
    path.write_bytes(data + b"\n" + json.dumps(status(1.0)).encode() + b"\n")
    assert LiveFile(path).seen().status
