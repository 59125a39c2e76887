"""Small logs, message by message."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as v2

from tests.strategies import START_US


def write_log(path: Path, messages: Sequence[Any], *, system: int = 1, step_us: int = 10_000) -> Path:
    """Append messages to a log, from one sender."""
    link = v2.MAVLink(None, srcSystem=system, srcComponent=1)
    with path.open("ab") as file:
        for k, message in enumerate(messages):
            file.write(struct.pack(">Q", START_US + step_us * k) + bytes(message.pack(link)))
    return path


def heartbeat(autopilot: int) -> Any:
    return v2.MAVLink_heartbeat_message(1, autopilot, 0, 0, 4, 3)
