"""Simulator of electromechanical actuators, the aircraft that carries them and the MAVLink log they leave.

It knows nothing of mavhums: it writes logs as an aircraft would, and stays an independent witness.
"""

from __future__ import annotations

from mavhums_sim.dataflash import write_dataflash
from mavhums_sim.ema import DataSheet, EmaParameters, Gearbox
from mavhums_sim.flight import ActuatorRecord, Flight, FlightRecord, fly
from mavhums_sim.motion import Degradation, Motion, simulate
from mavhums_sim.telemetry import write_tlog

__all__ = [
    "ActuatorRecord",
    "DataSheet",
    "Degradation",
    "EmaParameters",
    "Flight",
    "FlightRecord",
    "Gearbox",
    "Motion",
    "fly",
    "simulate",
    "write_dataflash",
    "write_tlog",
]
