"""Each telemetry tier of each format, from its messages to quantities."""

from __future__ import annotations

import struct
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.actuator.mapping import messages_for
from mavhums.actuator.profile import Airframe, FieldMapping
from mavhums.actuator.telemetry import tiers_by_content
from mavhums.core.quantities import column
from mavhums.log import Decoder, Table
from mavhums_sim.esc_status import EscStatus
from tests.actuator.mapped import PAPER, mapped, sent
from tests.conftest import Run
from tests.log.dataflash.synthetic import definition, fmt_of_fmt, record
from tests.log.ulog import writer

START = 5_000_000
LAYOUTS = {
    "debug_array": "uint64_t timestamp;uint16_t id;float[58] data;char[10] name;uint8_t[4] _padding0;",
    "debug_key_value": "uint64_t timestamp;char[10] key;uint8_t[2] _padding0;float value;",
}
Tables = dict[str, Table]


def ulog(topic: str, wire: str, *rows: tuple[Any, ...]) -> bytes:
    """Return a ULog of one topic, a row each 20 ms."""
    said = [struct.pack(wire, START + 20_000 * k, *row) for k, row in enumerate(rows)]
    head = writer.header(START) + writer.text("mavhums airframe=paper", START)
    return b"".join(
        [
            head,
            writer.form(topic, LAYOUTS[topic]),
            writer.subscribe(1, topic),
            *(writer.data(1, s) for s in said),
        ]
    )


def of_ulog(*messages: Any) -> Tables:
    return Decoder().feed(ulog(*messages), final=True)


def of_dataflash(name: str, letters: str, columns: str, *rows: tuple[Any, ...]) -> Tables:
    """Return the tables of an on-board log of ArduPilot of one message, a record each 10 ms."""
    head = fmt_of_fmt() + definition(5, name, letters, columns)
    records = [record(5, letters, [10_000 * k, *row]) for k, row in enumerate(rows, start=1)]
    return Decoder().feed(head + b"".join(records), final=True)


@pytest.mark.parametrize(
    ("pulse", "angle"), [(1000, [-60.0]), (1500, [0.0]), (1750, [30.0]), (2000, [60.0]), (0, [])]
)
def test_a_pulse_is_the_command_and_none_is_no_command(pulse: int, angle: list[float]) -> None:
    found = mapped(sent(v2.MAVLink_servo_output_raw_message(5, 0, 0, 0, pulse, *[0] * 13)))
    assert found.values[:, 0].tolist() == angle
    assert np.isnan(found.values[:, 1:]).all()
    assert found.provenance == ({"V1": "SERVO_OUTPUT_RAW.servo3_raw"} if angle else {})


def status(time_us: int, current: float) -> EscStatus:
    return EscStatus(0, time_us, [0, 0, 600, 0], [0.0, 0.0, 5.0, 0.0], [0.0, 0.0, current, 0.0])


def test_esc_status_is_signed_and_completed() -> None:
    values, provenance, _ = mapped(sent(*(status(20_000 * k, -0.25) for k in range(20)), step_us=20_000))
    ema = PAPER.actuators[2].known_ema()
    assert values[:, 4].tolist() == pytest.approx([-0.25] * 20)
    torque, power = -0.25 * ema.torque_constant, -0.25 * ema.torque_constant * 600 * 2 * np.pi / 60
    assert values[0, 5:10] == pytest.approx([-1.25, 600, torque, power, 2.0])
    assert np.diff(values[:, 1]) == pytest.approx(600 * 6 * 0.02)
    assert values[-1, 2] - values[0, 2] == pytest.approx(600 * 6 * 0.38 / 300)
    assert provenance["V5"] == "ESC_STATUS[2].current"
    assert provenance["V2"] == "derived: integral of V7, drifts"
    assert "V11" not in provenance


def test_an_actuator_without_an_esc_takes_nothing_from_escs() -> None:
    actuators = tuple(one.model_copy(update={"esc": None}) for one in PAPER.actuators)
    zeros = [0] * 4
    telemetry = v2.MAVLink_esc_telemetry_1_to_4_message(zeros, [500] * 4, [50] * 4, zeros, [60] * 4, zeros)
    airframe = PAPER.model_copy(update={"actuators": actuators})
    assert mapped(sent(status(0, 0.1), telemetry), airframe).values.size == 0


def test_escs_of_px4_give_signed_voltage_current_and_speed() -> None:
    values, provenance, _ = mapped(Decoder().feed(writer.flight(1.0, vehicle=1), final=True))
    fields = {"V4": "esc_voltage", "V5": "esc_current", "V7": "esc_rpm"}
    assert (
        fields.items()
        <= {key: name.removeprefix("esc_status[2].") for key, name in provenance.items()}.items()
    )
    assert values[np.isfinite(values[:, 6])][0, [3, 4, 6]].tolist() == [24.0, 3.0, 200.0]


def test_a_servo_on_dronecan_is_counted_from_one_and_reports_its_speed() -> None:
    letters, columns = "QBfffBfffffB", "TimeUS,Id,Pos,Force,Speed,Pow,PosCmd,V,A,MotT,PCBT,Err"
    tables = of_dataflash("CSRV", letters, columns, (3, 12.0, 0.5, 60.0, 40, *[nan] * 5, 0))
    values, provenance, _ = mapped(tables)
    [found] = values
    assert found[[column("V10"), column("V7")]] == pytest.approx([10.0, 3000.0])
    assert np.isnan(found[column("V11")])  # a Force is a load only where a profile maps it
    assert provenance["V7"] == "derived: V10·N"
    assert not mapped(tables, name="rudder").values.size


def array_of_mavlink(name: bytes, values: list[float]) -> Tables:
    return sent(*(v2.MAVLink_debug_float_array_message(20_000 * k, name, 3, values) for k in range(3)))


def array_of_px4(name: bytes, values: list[float]) -> Tables:
    return of_ulog("debug_array", "<QH58f10s", *[(3, *values, name)] * 3)


@pytest.mark.parametrize(
    ("array", "message"), [(array_of_mavlink, "DEBUG_FLOAT_ARRAY"), (array_of_px4, "debug_array")]
)
def test_an_array_named_ema_is_all_twelve_and_another_is_none(
    array: Callable[[bytes, list[float]], Tables], message: str
) -> None:
    values = [(k + 1) / 1024 for k in range(12)] + [0.0] * 46
    tables = array(b"EMA", values)
    found = mapped(tables)
    assert found.values.tolist() == [values[:12]] * 3
    assert (found.provenance["V5"], found.tier) == (f"{message}[EMA,3].data[4]", "instrumented")
    assert tiers_by_content(tables) == {(1, "instrumented")}
    other = array(b"EMAX", values)
    assert mapped(other).values.size == 0
    assert tiers_by_content(other) == set()


named = v2.MAVLink_named_value_float_message
NAMED = [(b"S3V05", 0.75), (b"S3V07", 900.0), (b"S3V13", 9.0), (b"S3Pos", 1.0)] * 3


@pytest.mark.parametrize(
    ("tables", "source"),
    [
        (sent(*(named(100, *one) for one in NAMED)), "NAMED_VALUE_FLOAT[S3V05].value"),
        (of_ulog("debug_key_value", "<Q10s2xf", *NAMED), "debug_key_value[S3V05].value"),
        (of_dataflash("NVF", "QNf", "TimeUS,Name,Value", *NAMED), "NVF[S3V05].Value"),
    ],
    ids=["MAVLink", "PX4", "ArduPilot"],
)  # fmt: skip
def test_a_named_value_with_a_quantitys_name_is_that_quantity(tables: Tables, source: str) -> None:
    values, provenance, tier = mapped(tables)
    assert [np.unique(one[np.isfinite(one)]).tolist() for one in values.T[[4, 6]]] == [[0.75], [900.0]]
    assert {key for key, name in provenance.items() if "derived" not in name} == {"V5", "V7"}
    assert (provenance["V5"], tier) == (source, "named")
    assert tiers_by_content(tables) == {(1, "named")}


def test_a_profile_maps_any_field_to_any_quantity() -> None:
    where: dict[str, str | int] = {"name": "S1Pos"}
    fields = {
        "V3": FieldMapping(message="NAMED_VALUE_FLOAT", field="value", where=where, scale=2.0, offset=1.0),
        "V4": FieldMapping(message="BATTERY_STATUS", field="voltages[0]", where={"id": 0}, scale=0.001),
    }
    elevator = PAPER.actuators[2].model_copy(update={"fields": fields})
    assert "BATTERY_STATUS" in messages_for((elevator,))
    battery = v2.MAVLink_battery_status_message(0, 0, 0, 0, [12_000] + [0] * 9, 0, 0, 0, 0)
    said = [
        named(at_ms, name, value)
        for at_ms, name, value in ((100, b"S1Pos", 10.0), (100, b"S1Cmd", 99.0), (120, b"S1Pos", 12.0))
    ]
    airframe = Airframe(name="mine", actuators=(elevator,))
    values, provenance, _ = mapped(sent(*said[:2], battery, said[2], battery), airframe)
    assert values[:, 2].tolist() == [21.0, 25.0]
    assert values[1, 3] == pytest.approx(12.0)
    assert (provenance["V3"], provenance["V4"]) == (
        "NAMED_VALUE_FLOAT[S1Pos].value",
        "BATTERY_STATUS[0].voltages[0]",
    )


@pytest.mark.parametrize("field", ["nonesuch", "voltages[99]", "id[0]"])
def test_a_field_that_the_message_lacks_is_refused_at_once(field: str) -> None:
    with pytest.raises(ValueError, match="BATTERY_STATUS"):
        FieldMapping(message="BATTERY_STATUS", field=field)


def test_an_instrumented_ulog_is_judged(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulog("debug_array", "<QH58f10s", *[(3, *[0.25] * 58, b"EMA")] * 250))
    outcome = run("inspect", path)
    for word in ("airframe paper", "instrumented", "debug_array[EMA,3]"):
        assert word in outcome.out
