"""A live session goes on, whatever its senders send: a time that cannot be, any field of any message."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

import mavhums
from mavhums.engine.engine import Engine
from mavhums.log.mavlink.stamping import Piece
from mavhums_sim.link import EPOCH_US
from tests.live.attacks import random_message
from tests.live.conftest import RIGHT, Rig, conditions


@pytest.mark.slow
def test_an_error_in_the_assessment_is_shown_and_the_session_goes_on(
    rig: Rig, worn_pieces: list[Piece], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, feed = Engine.assessment, Engine.feed
    calls = {"assessment": 0, "feed": 0}

    def failing(self: Engine, *given: object, **named: object) -> object:
        calls["assessment"] += 1
        if calls["assessment"] in (3, 5):
            raise ZeroDivisionError("as no one expected")
        return whole(self, *given, **named)  # type: ignore[arg-type]

    def failing_feed(self: Engine, block: bytes) -> object:
        calls["feed"] += 1
        if calls["feed"] == 7:
            raise ZeroDivisionError("as no one expected")
        return feed(self, block)

    monkeypatch.setattr(Engine, "assessment", failing)
    monkeypatch.setattr(Engine, "feed", failing_feed)
    rig.hear(worn_pieces)
    ended = rig.session.close()
    assert conditions(ended) == RIGHT
    [notice] = [said for said in ended.log.notices if "failed" in said]
    assert "3 times" in notice
    monkeypatch.undo()
    assert conditions(mavhums.analyse(rig.recorder.path)) == RIGHT, "the recording is whole"


@pytest.mark.slow
def test_random_messages_of_valid_checksum(tmp_path: Path) -> None:
    """``MESSAGES=450000`` is the gate; each message has random fields and a right checksum."""
    rng, rig = random.Random(48), Rig(tmp_path)
    count = int(os.environ.get("MESSAGES", "20000"))
    rig.hear(Piece("forger", EPOCH_US + 300 * k, random_message(rng, k)) for k in range(count))
    assert rig.session._failures == 0
    rig.end()  # compares with the replay
