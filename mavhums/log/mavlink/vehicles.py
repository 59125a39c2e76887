"""Distinguishes vehicles from ground stations and other senders."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["VEHICLE_MESSAGES", "vehicles_of"]

VEHICLE_MESSAGES = frozenset(
    {
        "ACTUATOR_OUTPUT_STATUS",
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "GLOBAL_POSITION_INT",
        "GPS_RAW_INT",
        "SERVO_OUTPUT_RAW",
        "SYS_STATUS",
        "VFR_HUD",
        "DEBUG_FLOAT_ARRAY",
    }
)


def vehicles_of(counts: Mapping[tuple[int, int, str], int]) -> tuple[int, ...]:
    """Return the system ids that sent messages of vehicles; a heartbeat alone is not sufficient.

    Examples
    --------
    >>> vehicles_of({(255, 190, "HEARTBEAT"): 9, (1, 1, "ATTITUDE"): 5})
    (1,)
    """
    return tuple(sorted({system for system, _, name in counts if name in VEHICLE_MESSAGES}))
