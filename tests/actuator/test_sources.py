"""Each telemetry tier, from messages to readings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.actuator.mapping import Mapper, messages_for
from mavhums.actuator.profile import Airframe, FieldMapping, load_airframe
from mavhums.log import Decoder, Table
from mavhums.vehicle.clocks import Clocks
from mavhums_sim.esc_status import EscStatus
from tests.logs import packed

PAPER = load_airframe("paper")
ELEVATOR = PAPER.actuators[2]


def decode(*messages: Any, step_us: int = 20_000) -> dict[str, Table]:
    return Decoder().feed(packed(messages, step_us=step_us), final=True)


def elevator(tables: dict[str, Table], airframe: Airframe = PAPER) -> tuple[np.ndarray, dict[str, str]]:
    mapper = Mapper(airframe)
    parts = [part for part in mapper.feed(tables, final=True) if part.actuator.name == "elevator"]
    values = np.concatenate([part.values for part in parts]) if parts else np.empty((0, 12))
    return values, mapper.of(1, airframe.actuators[2]).provenance


@pytest.mark.parametrize(("pulse", "angle"), [(1000, -60.0), (1500, 0.0), (1750, 30.0), (2000, 60.0)])
def test_a_pulse_is_the_command(pulse: int, angle: float) -> None:
    pulses = [0, 0, pulse] + [0] * 13
    values, provenance = elevator(decode(v2.MAVLink_servo_output_raw_message(5, 0, *pulses)))
    assert values[:, 0].tolist() == [angle]
    assert np.isnan(values[:, 1:]).all()
    assert provenance == {"V1": "SERVO_OUTPUT_RAW.servo3_raw"}


def test_no_pulse_is_no_command() -> None:
    assert elevator(decode(v2.MAVLink_servo_output_raw_message(5, 0, *[0] * 16)))[0].size == 0


def test_the_pulses_clock_wraps_without_a_gap() -> None:
    times = [2**32 - 40_000, 2**32 - 20_000, 0, 20_000, 40_000]
    pulses = [0, 0, 1600] + [0] * 13
    mapper = Mapper(PAPER)
    tables = decode(*(v2.MAVLink_servo_output_raw_message(t, 0, *pulses) for t in times))
    clocks = Clocks()
    mapped = mapper.feed(clocks.feed(tables), final=True)
    (part,) = [part for part in mapped if part.actuator.name == "elevator"]
    assert np.diff(part.utc_us).tolist() == [20_000] * 4
    assert clocks.jumps() == []


def status(time_us: int, current: float, *, index: int = 0, rpm: int = 600) -> EscStatus:
    return EscStatus(index, time_us, [0, 0, rpm, 0], [0.0, 0.0, 5.0, 0.0], [0.0, 0.0, current, 0.0])


def test_esc_status_is_signed_and_completed() -> None:
    values, provenance = elevator(decode(*(status(20_000 * k, -0.25) for k in range(20))))
    ema = ELEVATOR.known_ema()
    assert values[:, 4].tolist() == pytest.approx([-0.25] * 20)
    assert values[0, 6] == 600
    assert values[0, 7] == pytest.approx(-0.25 * ema.torque_constant)
    assert values[0, 5] == pytest.approx(-1.25)
    assert values[0, 9] == pytest.approx(2.0)
    assert values[0, 8] == pytest.approx(values[0, 7] * 600 * 2 * np.pi / 60)
    assert np.diff(values[:, 1]) == pytest.approx(600 * 6 * 0.02)
    assert values[-1, 2] - values[0, 2] == pytest.approx(600 * 6 * 0.38 / 300)
    assert provenance["V5"] == "ESC_STATUS[2].current"
    assert provenance["V2"] == "derived: integral of V7, drifts"
    assert "V11" not in provenance


def test_an_actuator_without_an_esc_takes_nothing_from_escs() -> None:
    airframe = PAPER.model_copy(
        update={"actuators": tuple(a.model_copy(update={"esc": None}) for a in PAPER.actuators)}
    )
    telemetry = v2.MAVLink_esc_telemetry_1_to_4_message(
        [0] * 4, [500] * 4, [50] * 4, [0] * 4, [60] * 4, [0] * 4
    )
    assert elevator(decode(status(0, 0.1), telemetry), airframe)[0].size == 0


def test_named_values_become_quantities() -> None:
    values, provenance = elevator(
        decode(
            v2.MAVLink_named_value_float_message(100, b"S3V05", 0.5),
            v2.MAVLink_named_value_float_message(100, b"S3V07", 900.0),
            v2.MAVLink_named_value_float_message(100, b"S3V13", 9.0),
            step_us=0,
        )
    )
    assert values[:, [4, 6]].tolist() == [[0.5, 900.0]]
    assert provenance["V5"] == "NAMED_VALUE_FLOAT[S3V05].value"


def mapped(**fields: FieldMapping) -> Airframe:
    actuators = tuple(
        a.model_copy(update={"fields": fields}) if a.name == "elevator" else a for a in PAPER.actuators
    )
    return PAPER.model_copy(update={"actuators": actuators})


def test_a_profile_maps_any_field_to_any_quantity() -> None:
    airframe = mapped(
        V3=FieldMapping(
            message="NAMED_VALUE_FLOAT", field="value", where={"name": "S1Pos"}, scale=2.0, offset=1.0
        ),
        V4=FieldMapping(message="BATTERY_STATUS", field="voltages[0]", where={"id": 0}, scale=0.001),
    )
    assert "BATTERY_STATUS" in messages_for(airframe.actuators)
    tables = decode(
        v2.MAVLink_named_value_float_message(100, b"S1Pos", 10.0),
        v2.MAVLink_named_value_float_message(100, b"S1Cmd", 99.0),
        v2.MAVLink_battery_status_message(0, 0, 0, 0, [12_000] + [0] * 9, 0, 0, 0, 0),
        v2.MAVLink_named_value_float_message(120, b"S1Pos", 12.0),
        v2.MAVLink_battery_status_message(0, 0, 0, 0, [12_000] + [0] * 9, 0, 0, 0, 0),
        step_us=10_000,
    )
    values, provenance = elevator(tables, airframe)
    assert values[:, 2].tolist() == [21.0, 25.0]
    assert values[1, 3] == pytest.approx(12.0)
    assert provenance["V3"] == "NAMED_VALUE_FLOAT[S1Pos].value"
    assert provenance["V4"] == "BATTERY_STATUS[0].voltages[0]"


@pytest.mark.parametrize("field", ["nonesuch", "voltages[99]", "id[0]"])
def test_a_field_that_the_message_lacks_is_refused_at_once(field: str) -> None:
    with pytest.raises(ValueError, match="BATTERY_STATUS"):
        FieldMapping(message="BATTERY_STATUS", field=field)
