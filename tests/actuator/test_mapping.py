"""Messages to quantities: whose they are, where they came from, and by which profile."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.actuator.draft import announcements
from mavhums.actuator.mapping import Mapper, actuators
from mavhums.actuator.profile import ProfileError, load_airframe
from mavhums.actuator.telemetry import best_tier, tiers_by_content
from mavhums.log import Decoder, Log, Table
from mavhums.results.reasons import Reason
from mavhums.vehicle.clocks import Clocks
from tests.logs import packed
from tests.strategies import START_US


def array_message(servo: int, values: list[float], *, name: bytes = b"EMA", time_us: int = 0) -> Any:
    return v2.MAVLink_debug_float_array_message(time_us, name, servo, values + [0.0] * 46)


def decode(*messages: Any, system: int = 1) -> dict[str, Table]:
    return Decoder().feed(packed(messages, system=system), final=True)


def test_each_servo_is_its_actuators() -> None:
    tables = decode(
        *(array_message(s, [float(s)] * 12, time_us=k * 10_000) for k, s in enumerate((3, 1, 3, 9)))
    )
    mapped = Mapper(load_airframe("paper")).feed(tables, final=True)
    assert {part.actuator.name: part.values[:, 0].tolist() for part in mapped} == {
        "aileron_left": [1.0],
        "elevator": [3.0, 3.0],
    }


def test_what_is_not_measured_is_nan_and_has_no_provenance() -> None:
    mapper = Mapper(load_airframe("paper"))
    values = [float("nan")] * 12
    values[4] = 0.5
    values[6] = float("inf")
    (mapped,) = mapper.feed(decode(array_message(3, values)), final=True)
    k_t = mapped.actuator.known_ema().torque_constant
    assert mapped.values[0, [4, 7]] == pytest.approx([0.5, 0.5 * k_t])
    assert np.isnan(mapped.values[0]).tolist() == [k not in (4, 7) for k in range(12)]
    assert mapper.of(1, mapped.actuator).provenance == {
        "V5": "DEBUG_FLOAT_ARRAY[EMA,3].data[4]",
        "V8": "derived: k_t·V5",
    }
    assert mapper.of(1, mapped.actuator).tier == "instrumented"
    assert mapper.of(2, mapped.actuator).provenance == {}
    assert mapper.of(2, mapped.actuator).tier is None


def test_other_float_arrays_are_not_actuator_telemetry() -> None:
    mapper = Mapper(load_airframe("paper"))
    assert mapper.feed(decode(array_message(3, [1.0] * 12, name=b"EMAX"))) == []
    assert mapper.feed(decode(v2.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3))) == []


def test_a_vehicles_profile_serves_that_vehicle_from_its_announcement_on() -> None:
    airframe = load_airframe("paper")
    tables = decode(*(array_message(3, [1.0] * 12, time_us=10_000 * k) for k in range(4)), system=7)
    assert Mapper(airframe, vehicle=1).feed(tables) == []
    (mapped,) = Mapper(airframe, vehicle=7, from_frame=1).feed(tables, final=True)
    assert mapped.vehicle == 7
    assert len(mapped.utc_us) == 3
    assert Mapper(airframe, vehicle=7).serves(7)
    assert not Mapper(airframe, vehicle=7).serves(1)
    assert Mapper(airframe).serves(1)


def test_a_clock_that_jumps_is_told_once_and_where_it_did() -> None:
    clocks = Clocks()
    times = [10_000 * k for k in range(8)] + [90_000_000 + 10_000 * k for k in range(8)]
    tables = decode(*(array_message(3, [1.0] * 12, time_us=t) for t in times), system=7)
    timed = clocks.feed(tables)
    assert len(timed["DEBUG_FLOAT_ARRAY"]) == 14
    # three samples in a row confirm it: the third is where the new segment begins
    assert clocks.jumps() == [(7, int(tables["DEBUG_FLOAT_ARRAY"].time_us[10]))]
    assert clocks.jumps() == []


def test_only_packaged_profiles_can_be_announced() -> None:
    texts = [b"mavhums airframe=paper", b"mavhums airframe=/etc/passwd", b"mavhums airframe=other", b"hello"]
    tables = decode(*(v2.MAVLink_statustext_message(6, text) for text in texts))
    assert [(said.frame, said.name, said.known) for said in announcements(tables)] == [
        (0, "paper", True),
        (2, "other", False),
    ]
    assert list(announcements({})) == []


def test_a_log_that_names_no_profile_needs_one() -> None:
    from pathlib import Path

    from mavhums.log.base.decoder import Losses

    tables = decode(array_message(3, [1.0] * 12))
    log = Log(Path("x.tlog"), tables, {}, {}, Losses(), (1,), None)
    with pytest.raises(ProfileError, match=r"x\.tlog.*profile new"):
        actuators(log)
    assert list(actuators(log, "paper")) == ["elevator"]
    assert actuators(log, load_airframe("paper"), vehicle=5) == {}


def test_the_richest_tier_counts() -> None:
    def tier(*messages: str, marked: tuple[str, ...] = ()) -> str | None:
        best = best_tier(set(messages), marked)
        return best.name if best else None

    assert tier("SERVO_OUTPUT_RAW", "ESC_TELEMETRY_5_TO_8") == "esc-unsigned"
    assert tier("DEBUG_FLOAT_ARRAY", "SERVO_OUTPUT_RAW") == "pwm"
    assert tier("DEBUG_FLOAT_ARRAY", "SERVO_OUTPUT_RAW", marked=("instrumented",)) == "instrumented"
    assert tier("NAMED_VALUE_FLOAT", "SERVO_OUTPUT_RAW") == "pwm"
    assert tier("NAMED_VALUE_FLOAT", marked=("named",)) == "named"
    assert tier("HEARTBEAT") is None


def test_content_tells_the_tiers_that_names_do_not() -> None:
    tables = decode(
        array_message(3, [1.0] * 12),
        v2.MAVLink_named_value_float_message(0, b"S1Pos", 1.0),
    )
    assert tiers_by_content(tables) == {(1, "instrumented")}
    tables = decode(v2.MAVLink_named_value_float_message(0, b"S1V05", 1.0), system=4)
    assert tiers_by_content(tables) == {(4, "named")}


@pytest.mark.parametrize("apart_ms", [0, 2])
@pytest.mark.parametrize("servos", [1, 2])
def test_two_servos_under_one_id_are_seen_whatever_the_cut(servos: int, apart_ms: int) -> None:
    """One servo that steps, and comes twice as over two links, is one."""
    rng = np.random.default_rng(5)
    angle = np.repeat(10.0 * np.sign(np.sin(np.arange(100) / 5)), 2) + rng.normal(0.0, 0.1, 200)
    if servos == 1:
        angle[1::2] = angle[::2]
    else:
        angle[1::2] *= -1.0
    times_us = np.arange(200) // 2 * 40_000 + np.arange(200) % 2 * apart_ms * 1000
    values = [[np.nan] * 2 + [float(one)] for one in angle]
    tables = decode(
        *(
            array_message(3, [*value, *[np.nan] * 9], time_us=START_US + int(at))
            for value, at in zip(values, times_us, strict=True)
        )
    )
    for cut in (200, 7):
        mapper = Mapper(load_airframe("paper"))
        for at in range(0, 200, cut):
            mapper.feed(
                {name: table.select(np.arange(at, min(at + cut, 200))) for name, table in tables.items()}
            )
        (elevator,) = [one for one in mapper.airframe.actuators if one.servo == 3]
        assert mapper.of(1, elevator).obstacle == (Reason("shared_id") if servos == 2 else None)
