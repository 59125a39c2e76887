"""Health and usage monitoring of UAV servo actuators from MAVLink telemetry logs.

>>> import mavhums
>>> assessment = mavhums.analyse("flight.tlog")
>>> assessment.ranked()[0].actuator, assessment.ranked()[0].condition
('elevator', 'emergency')
>>> mavhums.record(assessment, "flight.rrd")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mavhums.actuator import actuators, load_airframe
    from mavhums.analysis import analyse, record
    from mavhums.assessment import Assessment, Verdict
    from mavhums.engine import Engine
    from mavhums.errors import MavhumsError
    from mavhums.log import read_log
    from mavhums.trends import trend

__version__ = "0.1.0"

__all__ = [
    "Assessment",
    "Engine",
    "MavhumsError",
    "Verdict",
    "actuators",
    "analyse",
    "load_airframe",
    "read_log",
    "record",
    "trend",
]

_HOMES = {
    "Assessment": "assessment",
    "Engine": "engine",
    "MavhumsError": "errors",
    "Verdict": "assessment",
    "actuators": "actuator",
    "analyse": "analysis",
    "load_airframe": "actuator",
    "read_log": "log",
    "record": "analysis",
    "trend": "trends",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"mavhums.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
