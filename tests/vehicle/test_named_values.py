"""Named values: who sent which, how often, and that their number is bounded."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

from mavhums.log import Decoder
from mavhums.vehicle.usage import NAMED_MESSAGES, NamedValues
from tests.conftest import Run
from tests.logs import packed


def log(names: list[str], seconds: int = 10) -> bytes:
    """Return a telemetry log in which each name comes once a second, beside one debug array."""
    array = dialect.MAVLink_debug_float_array_message(0, b"EMA", 2, [0.0] * 58)
    said = [dialect.MAVLink_named_value_float_message(0, name.encode(), 1.5) for name in names]
    return packed([*said, array] * seconds, system=7, step_us=1_000_000 // (1 + len(names)))


def counted(data: bytes) -> NamedValues:
    named, decoder = NamedValues(), Decoder(NAMED_MESSAGES)
    for cut in range(0, len(data), 4096):
        named.feed(decoder.feed(data[cut : cut + 4096]))
    named.feed(decoder.feed(b"", final=True))
    return named


def test_names_are_counted_by_vehicle_and_message() -> None:
    names = ("NAMED_VALUE_FLOAT", "S1Pos"), ("NAMED_VALUE_FLOAT", "S1Cmd"), ("DEBUG_FLOAT_ARRAY", "EMA")
    assert counted(log(["S1Pos", "S1Cmd"])).counts == {(7, *name): 10 for name in names}


def test_a_log_with_ever_new_names_is_bounded() -> None:
    named = counted(log([f"n{k}" for k in range(1500)], seconds=2))
    assert len(named.counts) == 1000
    assert set(named.counts.values()) <= {1, 2}


@pytest.mark.parametrize("name", ["S1Pos", "[red]"])
def test_inspect_lists_them_with_their_rate(run: Run, tmp_path: Path, name: str) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(log([name], seconds=21))
    inspection = json.loads(run("inspect", path, "--json").out)
    expected = {
        "system": 7,
        "message": "NAMED_VALUE_FLOAT",
        "name": name,
        "count": 21,
        "rate_hz": round(21 / 20.5, 2),
    }
    assert expected in inspection["named"]
    shown = run("inspect", path, "--messages").out
    assert name in shown
    assert "named value" in shown
