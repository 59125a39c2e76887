"""Message rates of the aircraft."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Rates:
    """Messages per second of each stream, with jitter up to ±20 % of a period; 0 disables a stream.

    Attributes
    ----------
    attitude, air_data, battery, servo_output, esc, gps, status
        Rates of ATTITUDE, VFR_HUD, BATTERY_STATUS, SERVO_OUTPUT_RAW, the ESC messages, GPS_RAW_INT and
        SYS_STATUS.
        ``Flight.rate_hz`` is the rate of the actuator's own telemetry.

    Raises
    ------
    ValueError
        If a rate is negative or above 500 Hz.
    """

    attitude: float = 25.0
    air_data: float = 10.0
    battery: float = 2.0
    servo_output: float = 50.0
    esc: float = 20.0
    gps: float = 5.0
    status: float = 2.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not 0.0 <= getattr(self, name) <= 500.0:
                raise ValueError(f"rate of {name} must be 0…500 Hz")
