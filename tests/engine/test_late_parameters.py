"""What moves the surfaces is part of every judgement: parameters that come late, again, in part or never."""

from __future__ import annotations

import heapq
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.engine.events import Event, Notice
from mavhums.health.decision.events import ConditionChanged
from mavhums.log.mavlink.stamping import Piece
from mavhums.results.verdict import Verdict
from mavhums.vehicle import rows as kept
from mavhums_sim.perturb import (
    KINDS,
    begin_later,
    move_parameters,
    patch_parameters,
    perturb,
    repeat_parameters,
    without_parameters,
)
from tests.engine.test_axes import flown, of
from tests.engine.test_events import canonical
from tests.engine.wired import START_US
from tests.fleet_logs import records
from tests.judge import judged
from tests.live.conftest import Rig
from tests.present import present

ALARMS = ("degraded", "emergency")
FLIGHTS = {
    "healthy": flown(left=1.0),
    "a lost aileron": flown(),
    "a rudder that moves with the ailerons": flown(left=1.0, parted_s=90),
    "a rudder and a lost aileron": flown(parted_s=70),
}


def verdicts(content: bytes) -> list[Verdict]:
    return [verdict for verdict in judged(content)[0].verdicts if verdict.subject == "axis"]


def changes(events: list[Event], axis: str = "roll") -> list[tuple[str, str]]:
    return [(e.before, e.after) for e in events if isinstance(e, ConditionChanged) and e.actuator == axis]


def renamed(content: bytes, time_s: float, **functions: int) -> bytes:
    """The log with parameters ``SERVOn_FUNCTION`` in it at a time."""
    link = v2.MAVLink(None, srcSystem=1, srcComponent=1)
    time_us = START_US + round(time_s * 1e6)
    sent = [
        (time_us, bytes(v2.MAVLink_param_value_message(name.encode(), value, 6, 9, 0).pack(link)))
        for name, value in functions.items()
    ]
    together = heapq.merge(sent, records(content), key=lambda record: record[0])
    return b"".join(struct.pack(">Q", time_us) + frame for time_us, frame in together)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
@given(share=st.floats(0.02, 0.99), seed=st.integers(0, 99))
@settings(max_examples=2)
def test_when_the_parameters_come_changes_no_verdict(name: str, share: float, seed: int) -> None:
    flight = FLIGHTS[name]
    early = verdicts(flight)
    assert verdicts(move_parameters(flight, share)) == early
    assert verdicts(repeat_parameters(flight, share)) == early
    assert verdicts(patch_parameters(flight, share, np.random.default_rng(seed))) == early


def test_what_rested_on_other_outputs_is_withdrawn() -> None:
    """Servo 4 is named as the aileron; when it parts from servo 1, it looks lost. Then the names change."""
    flight = renamed(without_parameters(flown(190, left=1.0, parted_s=90)), 1.0, SERVO4_FUNCTION=4)
    alarmed = of(judged(flight)[0], "roll")
    assert alarmed.condition == "emergency"
    corrected = renamed(flight, 150.0, SERVO4_FUNCTION=21, SERVO1_FUNCTION=4)
    _, events = judged(corrected)
    roll = of(judged(corrected)[0], "roll")
    assert (roll.condition, roll.worst, roll.evidence, roll.suspects) == ("unchanged", "unchanged", (), ())
    assert roll.surfaces == ("aileron (servo 1)",)
    assert changes(events)[-1] == ("emergency", "unchanged")
    [notice] = [e for e in events if isinstance(e, Notice)]
    assert "judged anew from 0 s on" in notice.text
    assert notice.time_s == pytest.approx(160, abs=1)
    times = [e.time_s for e in events if isinstance(e, ConditionChanged)]
    assert times == sorted(times)


@pytest.mark.slow
def test_a_list_without_an_end_gathers_before_it_applies() -> None:
    """Half of a list names servo 4 alone; the rest comes within seconds."""
    flight = renamed(without_parameters(FLIGHTS["healthy"]), 100.0, SERVO4_FUNCTION=4)
    _, events = judged(renamed(flight, 106.0, SERVO1_FUNCTION=4, SERVO4_FUNCTION=21))
    assert changes(events) == [("undecided", "unchanged")]


@pytest.mark.slow
def test_inferred_outputs_that_part_are_inferred_anew() -> None:
    flight = without_parameters(FLIGHTS["a rudder that moves with the ailerons"])
    _, events = judged(flight)
    assert not [after for _, after in changes(events) if after in ALARMS]
    longer = without_parameters(flown(240, left=1.0, parted_s=90))
    roll = of(judged(longer)[0], "roll")
    assert (roll.condition, roll.worst) == ("unchanged", "unchanged")
    assert roll.surfaces == ("servo 1 (moves with roll)",)
    lost = of(judged(without_parameters(flown(300, parted_s=90, lost_s=200)))[0], "roll")
    assert lost.worst == "emergency"


@pytest.fixture
def short_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "_KEPT_S", 60)


@pytest.mark.usefixtures("short_memory")
def test_other_ranges_late_in_a_long_flight_take_nothing_away() -> None:
    flight = FLIGHTS["a lost aileron"]
    others = {f"SERVO{n}_{part}": us for n in (2, 4) for part, us in (("TRIM", 1500), ("MAX", 1900))}
    ranges = {"SERVO1_TRIM": 1510, "SERVO1_MAX": 1980, **others}
    assert verdicts(renamed(flight, 140.0, **ranges)) == verdicts(flight)


@pytest.mark.slow
@pytest.mark.usefixtures("short_memory")
def test_other_outputs_late_in_a_long_flight_say_from_when_on_it_is_judged() -> None:
    flight = renamed(flown(300, left=1.0, parted_s=0), 200.0, SERVO4_FUNCTION=4, SERVO1_FUNCTION=21)
    _, events = judged(flight)
    [notice] = [e for e in events if isinstance(e, Notice)]
    assert "judged anew from 149 s on" in notice.text
    assert changes(events)[:2] == [("undecided", "unchanged"), ("unchanged", "undecided")]


def test_a_log_that_begins_in_flight_says_so() -> None:
    roll = of(judged(FLIGHTS["healthy"])[0], "roll")
    assert roll.condition == "unchanged"
    assert roll.reason_codes == ("begins_in_flight",)


@pytest.mark.slow
@given(
    kind=st.sampled_from(sorted(KINDS)),
    seed=st.integers(0, 9999),
    piece=st.integers(500, 60_000),
    name=st.sampled_from(sorted(FLIGHTS)),
)
@example(kind="halves swapped", seed=4, piece=500, name="a rudder that moves with the ailerons")
@settings(max_examples=5)
def test_blocks_do_not_matter_whatever_happened_to_the_log(
    kind: str, seed: int, piece: int, name: str
) -> None:
    content = perturb(FLIGHTS[name], kind, seed)
    whole, events = judged(content)
    cut, pieces = judged(content, size=piece)
    assert cut.to_json() == whole.to_json()
    assert canonical(pieces) == canonical(events)


@pytest.mark.slow
def test_live_equals_replay_when_parameters_come_in_flight(tmp_path: Path) -> None:
    tlog = move_parameters(FLIGHTS["a rudder and a lost aileron"], 0.7)
    pieces = [Piece("vehicle", time_us, frame) for time_us, frame in records(tlog)]
    rig = Rig(tmp_path, start_us=pieces[0].time_us)
    rig.hear(pieces)
    found = rig.end()  # holds the verdicts against those of the recording
    assert next(v for v in found.verdicts if v.actuator == "roll").worst == "emergency"
    alerts = [alert.text for alert in rig.shown.alerts if alert.text.startswith("ROLL")]
    assert len(alerts) == len(set(alerts))


def test_nothing_is_lost_that_lies_before_the_parameters() -> None:
    """The aileron is lost at 90 s, the parameters come at 140 s: a reference of then would hide it."""
    roll = of(judged(begin_later(move_parameters(FLIGHTS["a lost aileron"], 0.93), 0.02))[0], "roll")
    assert roll.condition == "emergency"
    assert present(roll.since).flight_time_s == pytest.approx(88, abs=10)
