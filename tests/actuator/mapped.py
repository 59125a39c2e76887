"""What a mapper makes of the messages of a log, for one actuator of a profile."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mavhums.actuator.mapping import Mapper
from mavhums.actuator.profile import Airframe, load_airframe
from mavhums.core.arrays import Array
from mavhums.log import Decoder, Table
from tests.logs import packed

PAPER = load_airframe("paper")


class Mapped(NamedTuple):
    """V1…V12 of an actuator, shape (n, 12), where each comes from, and the tier."""

    values: Array
    provenance: dict[str, str]
    tier: str | None


def mapped(tables: dict[str, Table], airframe: Airframe = PAPER, name: str = "elevator") -> Mapped:
    mapper = Mapper(airframe)
    parts = [part.values for part in mapper.feed(tables, final=True) if part.actuator.name == name]
    own = mapper.of(1, next(one for one in airframe.actuators if one.name == name))
    return Mapped(np.concatenate([np.empty((0, 12)), *parts]), own.provenance, own.tier)


def sent(*messages: Any, system: int = 1, step_us: int = 10_000) -> dict[str, Table]:
    """Return the tables of a telemetry log."""
    return Decoder().feed(packed(messages, system=system, step_us=step_us), final=True)
