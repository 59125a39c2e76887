"""Sources of quantities: one telemetry tier per module, discovered automatically.

A source is a module with ``MESSAGES``, the message types that it reads, and
``read(tables, actuators)``, which yields a :class:`~mavhums.actuator.readings.Reading` for
each vehicle and actuator. The sources are ordered by trust, best first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading
from mavhums.actuator.sources import (
    actuator_outputs,
    configured,
    csrv,
    esc_record,
    esc_signed,
    esc_topic,
    esc_unsigned,
    instrumented,
    named,
    pwm,
    rcou,
)
from mavhums.log import Table

__all__ = ["SOURCES", "Source"]


class Source(Protocol):
    """The interface of the modules of this package."""

    MESSAGES: frozenset[str]

    def read(self, tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
        """Yield the readings of the actuators in these messages."""
        ...


SOURCES: tuple[Source, ...] = (
    configured,
    instrumented,
    csrv,
    esc_signed,
    esc_topic,
    named,
    esc_unsigned,
    esc_record,
    pwm,
    rcou,
    actuator_outputs,
)
