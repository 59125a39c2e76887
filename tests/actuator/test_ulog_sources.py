"""What a ULog carries of actuators, from its bytes to quantities."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.actuator.telemetry import tiers_by_content
from mavhums.log import Decoder, Table
from tests.conftest import Run
from tests.log.ulog import writer

PAPER = load_airframe("paper")
START = 5_000_000
DEBUG = "uint64_t timestamp;uint16_t id;float[58] data;char[10] name;uint8_t[4] _padding0;"
KEY_VALUE = "uint64_t timestamp;char[10] key;uint8_t[2] _padding0;float value;"


def tables_of(*messages: bytes) -> dict[str, Table]:
    return Decoder().feed(writer.header(START) + b"".join(messages), final=True)


def mapped(
    tables: dict[str, Table], name: str, airframe: Airframe = PAPER
) -> tuple[np.ndarray, dict[str, str]]:
    mapper = Mapper(airframe)
    parts = [part for part in mapper.feed(tables, final=True) if part.actuator.name == name]
    values = np.concatenate([part.values for part in parts]) if parts else np.empty((0, 12))
    return values, mapper.of(1, next(a for a in airframe.actuators if a.name == name)).provenance


def instrumented(seconds: float = 1.0, name: bytes = b"EMA") -> bytes:
    parts = [writer.form("debug_array", DEBUG), writer.subscribe(1, "debug_array")]
    for k in range(int(seconds * 50)):
        values = [(column + 1) / 4 + k / 64 for column in range(12)] + [0.0] * 46
        parts.append(writer.data(1, struct.pack("<QH58f10s", START + 20_000 * k, 3, *values, name)))
    return b"".join(parts)


def test_a_debug_array_named_ema_is_all_twelve() -> None:
    tables = tables_of(instrumented())
    values, provenance = mapped(tables, "elevator")
    assert values[5, :5].tolist() == [(column + 1) / 4 + 5 / 64 for column in range(5)]
    assert provenance["V5"] == "debug_array[EMA,3].data[4]"
    assert tiers_by_content(tables) == {(1, "instrumented")}


def test_another_debug_array_is_none() -> None:
    tables = tables_of(instrumented(name=b"other"))
    assert mapped(tables, "elevator")[0].size == 0
    assert tiers_by_content(tables) == set()


def test_a_debug_key_value_with_a_quantitys_name_is_that_quantity() -> None:
    said = [writer.data(1, struct.pack("<Q10s2xf", START + k, b"S3V05", 1.5)) for k in range(3)]
    tables = tables_of(
        writer.form("debug_key_value", KEY_VALUE), writer.subscribe(1, "debug_key_value"), *said
    )
    values, provenance = mapped(tables, "elevator")
    assert values[:, 4].tolist() == [1.5] * 3
    assert provenance["V5"] == "debug_key_value[S3V05].value"
    assert tiers_by_content(tables) == {(1, "named")}


def test_escs_give_signed_voltage_current_and_speed() -> None:
    tables = Decoder().feed(writer.flight(1.0, vehicle=1), final=True)
    values, provenance = mapped(tables, "elevator")
    assert provenance["V7"] == "esc_status[2].esc_rpm"
    assert provenance["V4"] == "esc_status[2].esc_voltage"
    rows = values[np.isfinite(values[:, 6])]
    assert rows[0, [3, 4, 6]].tolist() == [24.0, 3.0, 200.0]


def test_an_instrumented_ulog_is_judged(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(writer.header(START) + writer.text("mavhums airframe=paper", START) + instrumented(5.0))
    outcome = run("inspect", path)
    assert "airframe paper" in outcome.out
    assert "instrumented" in outcome.out
    assert "debug_array[EMA,3]" in outcome.out
