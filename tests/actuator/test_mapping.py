"""Messages to quantities: whose they are, where they came from, and by which profile."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.actuator.draft import announcements
from mavhums.actuator.history import actuators
from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import ProfileError
from mavhums.actuator.telemetry import best_tier, tiers_by_content
from mavhums.log import Log
from mavhums.log.base.decoder import Losses
from mavhums.results.reasons import Reason
from tests.actuator.mapped import PAPER, mapped, sent
from tests.strategies import START_US


def array_message(servo: int, values: list[float], *, time_us: int = 0) -> Any:
    return v2.MAVLink_debug_float_array_message(time_us, b"EMA", servo, values + [0.0] * 46)


def test_each_servo_is_its_actuators() -> None:
    numbers = enumerate((3, 1, 3, 9))
    tables = sent(*(array_message(n, [float(n)] * 12, time_us=k * 10_000) for k, n in numbers))
    found = {
        part.actuator.name: part.values[:, 0].tolist() for part in Mapper(PAPER).feed(tables, final=True)
    }
    assert found == {"aileron_left": [1.0], "elevator": [3.0, 3.0]}


def test_what_is_not_measured_is_nan_and_has_no_provenance() -> None:
    values = [np.nan] * 12
    values[4], values[6] = 0.5, np.inf
    tables = sent(array_message(3, values))
    [found], provenance, tier = mapped(tables)
    assert found[[4, 7]] == pytest.approx([0.5, 0.5 * PAPER.actuators[2].known_ema().torque_constant])
    assert np.isnan(found).tolist() == [k not in (4, 7) for k in range(12)]
    assert provenance == {"V5": "DEBUG_FLOAT_ARRAY[EMA,3].data[4]", "V8": "derived: k_t·V5"}
    assert tier == "instrumented"
    _, provenance, tier = mapped(tables, name="rudder")
    assert (provenance, tier) == ({}, None)


def test_a_vehicles_profile_serves_that_vehicle_from_its_announcement_on() -> None:
    tables = sent(*(array_message(3, [1.0] * 12, time_us=10_000 * k) for k in range(4)), system=7)
    assert Mapper(PAPER, vehicle=1).feed(tables) == []
    (part,) = Mapper(PAPER, vehicle=7, from_frame=1).feed(tables, final=True)
    assert (part.vehicle, len(part.utc_us)) == (7, 3)
    serves = [Mapper(PAPER, vehicle=7).serves(7), Mapper(PAPER, vehicle=7).serves(1), Mapper(PAPER).serves(1)]
    assert serves == [True, False, True]


def test_only_packaged_profiles_can_be_announced() -> None:
    texts = [b"mavhums airframe=paper", b"mavhums airframe=/etc/passwd", b"mavhums airframe=other", b"hello"]
    tables = sent(*(v2.MAVLink_statustext_message(6, text) for text in texts))
    assert [(said.frame, said.name, said.known) for said in announcements(tables)] == [
        (0, "paper", True),
        (2, "other", False),
    ]
    assert list(announcements({})) == []


def test_a_log_that_names_no_profile_needs_one() -> None:
    tables = sent(array_message(3, [1.0] * 12))
    log = Log(Path("x.tlog"), tables, {}, {}, Losses(), (1,), None)
    with pytest.raises(ProfileError, match=r"x\.tlog.*profile new"):
        actuators(log)
    assert list(actuators(log, "paper")) == ["elevator"]
    assert actuators(log, PAPER, vehicle=5) == {}


@pytest.mark.parametrize(
    ("messages", "marked", "tier"),
    [
        ("SERVO_OUTPUT_RAW ESC_TELEMETRY_5_TO_8", (), "esc-unsigned"),
        ("DEBUG_FLOAT_ARRAY SERVO_OUTPUT_RAW", (), "pwm"),
        ("DEBUG_FLOAT_ARRAY SERVO_OUTPUT_RAW", ("instrumented",), "instrumented"),
        ("NAMED_VALUE_FLOAT SERVO_OUTPUT_RAW", (), "pwm"),
        ("NAMED_VALUE_FLOAT", ("named",), "named"),
        ("HEARTBEAT", (), None),
    ],
)
def test_the_richest_tier_counts(messages: str, marked: tuple[str, ...], tier: str | None) -> None:
    best = best_tier(set(messages.split()), marked)
    assert (best and best.name) == tier


def test_content_shows_the_tiers_that_names_do_not() -> None:
    named = v2.MAVLink_named_value_float_message
    tables = sent(array_message(3, [1.0] * 12), named(0, b"S1Pos", 1.0))
    assert tiers_by_content(tables) == {(1, "instrumented")}
    assert tiers_by_content(sent(named(0, b"S1V05", 1.0), system=4)) == {(4, "named")}


@pytest.mark.parametrize("apart_ms", [0, 2])
@pytest.mark.parametrize("servos", [1, 2])
def test_two_servos_under_one_id_are_seen_whatever_the_cut(servos: int, apart_ms: int) -> None:
    """One servo that steps, and comes twice as over two links, is one."""
    angle = 10.0 * np.sign(np.sin(np.arange(100) / 5)) + np.random.default_rng(5).normal(0.0, 0.1, 100)
    twice = np.stack([angle, angle if servos == 1 else -angle], axis=1).ravel()
    times_us = START_US + np.arange(200) // 2 * 40_000 + np.arange(200) % 2 * apart_ms * 1000
    rows = [[np.nan] * 2 + [one] + [np.nan] * 9 for one in twice.tolist()]
    tables = sent(
        *(array_message(3, row, time_us=at) for row, at in zip(rows, times_us.tolist(), strict=True))
    )
    for cut in (200, 7):
        mapper = Mapper(PAPER)
        for at in range(0, 200, cut):
            part = np.arange(at, min(at + cut, 200))
            mapper.feed({name: table.select(part) for name, table in tables.items()})
        assert mapper.of(1, PAPER.actuators[2]).obstacle == (Reason("shared_id") if servos == 2 else None)
