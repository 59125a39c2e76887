"""Faults that devices report: what counts, what is damage, and that blocks do not matter."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavutil

from mavhums.health.verdict import with_advice, with_supply
from mavhums.log import Table, read_log
from mavhums.results.sections import FlightEvent
from mavhums.results.verdict import Candidate, Evidence, Verdict
from mavhums.show.event_words import event_words
from mavhums.show.headline import headline
from mavhums.vehicle.events import FlightEvents
from mavhums.vehicle.formats import messages_of
from mavhums.vehicle.reported import Sag, ServoRail
from tests.conftest import carried_logs, real_logs
from tests.judge import judged
from tests.strategies import cuts
from tests.vehicle.tables import table_of

DATA = Path(__file__).parents[1] / "data"


def table(name: str, rows: Sequence[dict[str, Any]], kinds: dict[str, str]) -> Table:
    """Return a table of one row a second."""
    wire = [(field, kind, np.shape(rows[0][field])) for field, kind in kinds.items()]
    return table_of(name, np.array([tuple(row[field] for field in kinds) for row in rows], dtype=wire))


def heard(*tables: Table, parts: Sequence[int] = ()) -> tuple[FlightEvent, ...]:
    """Return the events of these tables, each cut after these rows; each was said once, as it came."""
    events, news = FlightEvents(), list[tuple[int, float, str]]()
    for one in tables:
        for rows in np.split(np.arange(len(one)), parts):
            news += events.feed({one.name: one.select(rows)}, 0, lambda _: True)
    found = events.gathered(frozenset())[0]
    first = [(event.vehicle, event.time_s, event_words(event)) for event in found]
    assert sorted(news) == sorted((who, at, re.split(" by |, ", words)[0]) for who, at, words in first)
    return found


def said(*tables: Table, parts: Sequence[int] = ()) -> list[str]:
    """Return the same in words with their seconds."""
    return [f"{event.time_s:.0f}: {event_words(event)}" for event in heard(*tables, parts=parts)]


def escs(errors: Sequence[int], flags: Sequence[int], index: int = 4) -> Table:
    """Return ESC_INFO of four ESCs of which the third one has these errors and flags."""
    rows = [
        {"error_count": [0, 0, e, 9], "failure_flags": [0, 0, f, 0], "index": index}
        for e, f in zip(errors, flags, strict=True)
    ]
    return table("ESC_INFO", rows, {"error_count": "<u4", "failure_flags": "<u2", "index": "u1"})


@pytest.mark.parametrize(
    ("errors", "flags", "expected"),
    [
        ([5] * 6, [0] * 6, []),
        ([5, 5, 7, 7, 12, 12], [0] * 6, ["2: the error count of ESC 7 grows by 7"]),
        ([5, 5, 5000, 5, 5, 5], [0] * 6, []),  # damage
        ([5, 5, 0, 5, 5, 5], [0] * 6, []),
        ([9, 9, 0, 2, 2, 2], [0] * 6, ["2: the error count of ESC 7 grows by 2"]),  # it restarted
        ([254, 254, 255, 1, 1, 1], [0] * 6, ["3: the error count of ESC 7 grows by 1"]),  # at least
        ([5, 5, 5, 5, 5, 9], [0] * 6, []),  # not confirmed
        ([0] * 6, [1] * 6, ["1: ESC 7 reports over-current"]),
        ([0] * 6, [0, 0, 33, 33, 32, 0], ["2: ESC 7 reports a stuck motor", "2: ESC 7 reports over-current"]),
        ([0] * 6, [0, 1, 0, 0, 0, 0], []),  # damage
        ([0] * 6, [1, 1, 0, 0, 0, 1], ["1: ESC 7 reports over-current"]),
        ([0] * 7, [1, 1, 0, 0, 1, 1, 1], ["1: ESC 7 reports over-current, 2 times"]),
    ],
)
def test_of_a_count_its_growth_is_said_and_of_a_flag_what_two_of_three_readings_have(
    errors: list[int], flags: list[int], expected: list[str]
) -> None:
    assert sorted(said(escs(errors, flags))) == expected


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ([7] * 6, []),
        ([0b11001] * 6, []),  # pins that no board drives are as they are
        ([7, 7, 5, 5, 5, 5], ["2: the autopilot reports loss of the servo rail's supply"]),
        ([7, 7, 0, 7, 7, 7], []),
        ([3, 3, 11, 11, 3, 3], ["2: the autopilot reports over-current of its peripherals"]),
    ],
)
def test_of_a_supply_only_what_changes_in_the_log_is_said(flags: list[int], expected: list[str]) -> None:
    for name, field in (("POWER_STATUS", "flags"), ("POWR", "Flags")):
        assert said(table(name, [{field: flag} for flag in flags], {field: "<u2"})) == expected


def test_servo_records_have_the_number_of_their_output() -> None:
    rows = [{"Id": 2, "Err": 4 * (k > 2), "PosCmd": 1.0} for k in range(8)]
    kinds = {"Id": "u1", "Err": "u1", "PosCmd": "<f4"}
    assert said(table("CSRV", rows, kinds)) == ["3: servo 3 reports error flag 0x04"]
    on_bus = [row | {"PosCmd": np.nan} for row in rows]
    assert said(table("CSRV", on_bus, kinds)) == ["3: servo 2 reports error flag 0x04"]


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        (True, "Potential Thrust Loss (2)"),
        (True, "ESC 3: over temperature"),
        (True, "Motor failure detected"),
        (False, "PreArm: Motors: ESC 3 error"),
        (False, "Arming motors"),
        (False, "Disarming motors"),
        (False, "[sensors] Accel #0 fail:  TIMEOUT!"),
        (False, "[health_and_arming_checks] Preflight Fail: Motor 1 lost"),
        (False, "Throttle failsafe off"),
    ],
)
def test_a_text_is_quoted_and_counted(counts: bool, text: str) -> None:
    events = FlightEvents()
    for time_s in (7.0, 9.0):
        events.of(1).hear_text(time_s, text)
    found = [event for event in events.gathered(frozenset())[0] if event.kind == "fault"]
    fields = {"vehicle": 1, "time_s": 7.0, "subject": "the autopilot", "said": f'"{text}"', "value": 2}
    assert [one.model_dump(exclude_none=True) for one in found] == [{"kind": "fault", **fields}] * counts


NUMBERS = st.lists(st.integers(0, 2**16 - 1), min_size=3, max_size=40)


@given(NUMBERS, st.data())
def test_blocks_do_not_matter(numbers: list[int], data: st.DataObject) -> None:
    """Any readings, in any blocks: what is said is the same, and its counts are those of a plain loop."""
    one = escs(numbers, [n & 0x7F for n in numbers], index=0)
    whole = said(one)
    assert said(one, parts=data.draw(cuts(len(numbers)))) == whole
    triples = [numbers[k : k + 3] for k in range(len(numbers) - 2)]
    grown = sum(b - a if b >= a else b for a, b in pairwise(sorted(three)[1] for three in triples))
    assert any(line.endswith(f"of ESC 3 grows by {grown}") for line in whole) == (grown > 0)
    votes = [sum(n >> 5 & 1 for n in three) > 1 for three in triples]
    rises = sum(b > a for a, b in pairwise([False, *votes]))
    times = f", {rises} times" if rises > 1 else ""
    assert any(line.endswith(f"ESC 3 reports a stuck motor{times}") for line in whole) == (rises > 0)


FIELDS = {
    "ESC": ("Instance", "Err"),
    "EDT2": ("Instance", "Status"),
    "CESC": ("Id", "ECnt"),
    "CSRV": ("Id", "Err", "PosCmd"),
    "POWR": ("Flags",),
    "system_power": ("brick_valid", "periph_5v_oc"),
    "esc_status": ("esc_count", "esc_online_flags", "esc[0].failures", "esc[3].esc_errorcount"),
    "failure_detector_status": ("fd_arm_escs", "fd_imbalanced_prop", "fd_motor", "motor_failure_mask"),
}


@given(
    st.sampled_from([*FIELDS]), st.sampled_from(["u1", "<i2", "<u4", "<f4", "<f8", "<i8", "<u8"]), st.binary()
)
def test_any_bytes_and_any_definition_end_in_words(name: str, kind: str, noise: bytes) -> None:
    """A self-describing log may define a field as any number, and a damaged one may hold any."""
    wire = np.dtype([(field, kind) for field in FIELDS[name]])
    fields = np.frombuffer(noise[: len(noise) // wire.itemsize * wire.itemsize], dtype=wire)
    if len(fields):
        said(table_of(name, fields))


LOGS = [path for path in (*carried_logs(), *real_logs()) if path.suffix in (".tlog", ".BIN")]


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.name)
def test_against_pymavlink_on_logs_that_others_flew(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of supplies and of motor outputs exactly what a plain loop over its messages finds."""
    monkeypatch.setenv("MAVLINK20", "1")
    connection = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    flags: dict[tuple[int, int, int], list[int]] = {}
    while (message := connection.recv_match(type=["POWER_STATUS", "SYS_STATUS", "POWR"])) is not None:
        logged = message.get_type() == "POWR"
        who = (0, 0) if logged else (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "SYS_STATUS":
            ill = message.onboard_control_sensors_enabled & ~message.onboard_control_sensors_health
            flags.setdefault((*who, 4), []).append(ill >> 15 & 1)
            continue
        supply = message.Flags if logged else message.flags
        for bit, invert in ((0, 1), (1, 1), (3, 0), (4, 0)):
            flags.setdefault((*who, bit - 9), []).append(supply >> bit & 1 ^ invert)
    connection.close()
    rises = 0
    for (_, _, bit), values in flags.items():
        votes = [sum(values[k : k + 3]) > 1 for k in range(len(values) - 2)]
        rises += sum(b > a for a, b in pairwise([*(votes[:1] if bit < 0 else [False]), *votes]))
    facts = "supply faults", "autopilot faults"
    tables = read_log(path, messages=sorted(messages_of(*facts))).tables
    assert sum(event.value or 0 for event in heard(*tables.values())) == rises


TIME_S = np.arange(600) / 10
VOLTS = 5.1 + 0.1 * np.sin(TIME_S)
VOLTS[300:360] = 3.2
VOLTS[100] = 0.0  # one reading is noise


@pytest.mark.parametrize("cuts", [[], [1], [300], [301, 302, 330, 360], list(range(1, 600))])
def test_a_rail_that_sags_is_found_whatever_the_blocks(cuts: list[int]) -> None:
    rail, begun = ServoRail(), list[Sag]()
    for rows in np.split(np.arange(600), cuts):
        begun += rail.feed(TIME_S[rows], VOLTS[rows])
    assert [sag.start_s for sag in begun] == [30.0]
    (only,) = rail.sags
    assert tuple(only)[:3] == pytest.approx((30.0, 35.9, 3.2))


@pytest.mark.parametrize(("alarm_s", "first"), [(31.0, "servo rail"), (20.0, "elevator")])
def test_a_rail_that_sags_comes_before_the_surfaces_that_it_feeds(alarm_s: float, first: str) -> None:
    found = Evidence(kind="tracking", start_s=alarm_s, end_s=alarm_s + 4.0, value=9.0, rule="emergency: away")
    axis = Verdict(
        subject="axis", vehicle=1, actuator="pitch", condition="emergency", worst="emergency",
        evidence=(found,), candidates=(Candidate(surface="elevator", servo=2),),
    )  # fmt: skip
    verdict = with_advice(with_supply(axis, [Sag(12.0, 13.0, 3.1, 5.1), Sag(30.0, 36.0, 3.2, 5.1)]))
    assert verdict.candidates[0].surface == first
    assert ("servo rail first" in (verdict.advice or "")) == (first == "servo rail")


def test_a_rail_that_sags_in_flight_leads_the_answer() -> None:
    """All surfaces are weak at once, which no verdict on one of them says."""
    link, log = mavutil.mavlink.MAVLink(None), (DATA / "healthy.tlog").read_bytes()
    out, at, second, start_us = bytearray(), 0, 0, int.from_bytes(log[:8], "big")
    while at < len(log):
        while int.from_bytes(log[at : at + 8], "big") >= start_us + second * 1_000_000:
            sent = link.power_status_encode(5000, 3200 if 60 <= second < 66 else 5100, 0).pack(link)
            out += (start_us + second * 1_000_000).to_bytes(8, "big") + sent
            second += 1
        end = at + 8 + log[at + 9] + (12 if log[at + 8] == 0xFD else 8)
        out += log[at:end]
        at = end
    shown = headline(judged(bytes(out))[0])
    assert shown.word == "supply"
    assert "fell to 3.2 V at 1m00s" in shown.text
    assert shown.todo.startswith("inspect the BEC")
