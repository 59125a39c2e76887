"""Tables of messages, without a log around them."""

from __future__ import annotations

from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as v2

from mavhums.log.base.decoder import Table
from mavhums.vehicle.facts import CONTINUOUS, STEPPED
from mavhums.vehicle.grid import RATE_HZ, Seconds


def table_of(name: str, fields: Any, *, frame: Any = None, time_us: Any = None, **bytes_: Any) -> Table:
    """Return a table of records of system 1, one a second; ``bytes_`` are columns of the frame's header."""
    count = np.arange(len(fields), dtype=np.int64)
    frame = count if frame is None else np.asarray(frame, dtype=np.int64)
    header = {"system": 1, "component": 1, "sequence": 0, "flags": 0} | bytes_
    columns: dict[str, Any] = {
        part: np.broadcast_to(value, count.shape).astype(np.uint8) for part, value in header.items()
    }
    at = 1_000_000 * count if time_us is None else np.asarray(time_us, dtype=np.int64)
    return Table(name, frame, at, fields=fields, **columns)


def version(number: int = 0, uid: int = 0, uid2: bytes = b"") -> Any:
    """Return an AUTOPILOT_VERSION of a firmware and of either id of the board."""
    custom, uid2 = [[0] * 8] * 3, uid2.ljust(18, b"\0")
    return v2.MAVLink_autopilot_version_message(0, number, 0, 0, 0, *custom, 0, 0, uid, list(uid2))


def seconds_of(count: int, first: int = 0, **values: Any) -> Seconds:
    """Return seconds with these signals, each a value, a row, or what fits; the others are not known."""
    signals = {
        name: np.array(np.broadcast_to(values.get(name, np.nan), (count, RATE_HZ, width)), dtype=np.float64)
        for name, width in {**CONTINUOUS, **STEPPED}.items()
    }
    signals |= {f"{name}_spacing": np.full((count, RATE_HZ, 1), 0.1) for name in CONTINUOUS}
    ranks = {name: np.zeros(count, dtype=np.int64) for name in ("altitude", "rates", "force")}
    return Seconds(np.arange(first, first + count), signals, ranks)
