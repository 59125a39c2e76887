"""Named values: who sent which, how often, and that their number is bounded."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

from mavhums.log import Decoder
from mavhums.vehicle.usage import NAMED_MESSAGES, NamedValues
from tests.conftest import Run


def log(names: list[str], seconds: int = 10) -> bytes:
    """Return a telemetry log in which each name comes once a second, beside one debug array."""
    out = bytearray()
    sender = dialect.MAVLink(None, srcSystem=7, srcComponent=1)
    for k in range(seconds):
        stamp = (1_700_000_000_000_000 + 1_000_000 * k).to_bytes(8, "big")
        for name in names:
            message = dialect.MAVLink_named_value_float_message(1000 * k, name.encode(), 1.5)
            out += stamp + message.pack(sender)
        array = dialect.MAVLink_debug_float_array_message(1_000_000 * k, b"EMA", 2, [0.0] * 58)
        out += stamp + array.pack(sender)
    return bytes(out)


def counted(data: bytes) -> NamedValues:
    named, decoder = NamedValues(), Decoder(NAMED_MESSAGES)
    for cut in range(0, len(data), 4096):
        named.feed(decoder.feed(data[cut : cut + 4096]))
    named.feed(decoder.feed(b"", final=True))
    return named


def test_names_are_counted_by_vehicle_and_message() -> None:
    assert counted(log(["S1Pos", "S1Cmd"])).counts == {
        (7, "NAMED_VALUE_FLOAT", "S1Pos"): 10,
        (7, "NAMED_VALUE_FLOAT", "S1Cmd"): 10,
        (7, "DEBUG_FLOAT_ARRAY", "EMA"): 10,
    }


def test_a_log_with_ever_new_names_is_bounded() -> None:
    named = counted(log([f"n{k}" for k in range(1500)], seconds=2))
    assert len(named.counts) == 1000
    assert set(named.counts.values()) <= {1, 2}


@pytest.mark.parametrize("name", ["S1Pos", "[red]"])
def test_inspect_lists_them_with_their_rate(run: Run, tmp_path: Path, name: str) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(log([name], seconds=21))
    told = json.loads(run("inspect", path, "--json").out)
    assert {"system": 7, "message": "NAMED_VALUE_FLOAT", "name": name, "count": 21, "rate_hz": 1.05} in told[
        "named"
    ]
    shown = run("inspect", path, "--messages").out
    assert name in shown
    assert "named value" in shown
