"""Converts messages to the paper's quantities V1–V12 of each actuator, without judging them."""

from __future__ import annotations

from mavhums.actuator.mapping import MappedSamples, Mapper, messages_for
from mavhums.actuator.profile import Actuator, Airframe, Ema, Limits, load_airframe, packaged_airframes
from mavhums.actuator.vehicle_mappers import History, actuators

__all__ = [
    "Actuator",
    "Airframe",
    "Ema",
    "History",
    "Limits",
    "MappedSamples",
    "Mapper",
    "actuators",
    "load_airframe",
    "messages_for",
    "packaged_airframes",
]
