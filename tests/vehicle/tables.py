"""Tables of messages, without a log around them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mavhums.log.base.decoder import Table


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
