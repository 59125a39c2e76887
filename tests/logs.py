"""Small logs, message by message."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as v2

from tests.strategies import START_US


def packed(messages: Iterable[Any], *, system: int = 1, component: int = 1, step_us: int = 10_000) -> bytes:
    """Return a log of messages from one sender."""
    link = v2.MAVLink(None, srcSystem=system, srcComponent=component)
    stamped = enumerate(bytes(message.pack(link)) for message in messages)
    return b"".join(struct.pack(">Q", START_US + step_us * k) + frame for k, frame in stamped)


def write_log(path: Path, messages: Sequence[Any], *, system: int = 1, step_us: int = 10_000) -> Path:
    """Append messages to a log, from one sender."""
    with path.open("ab") as file:
        file.write(packed(messages, system=system, step_us=step_us))
    return path


def heartbeat(autopilot: int) -> Any:
    return v2.MAVLink_heartbeat_message(1, autopilot, 0, 0, 4, 3)
