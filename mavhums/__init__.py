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
    from mavhums.app.analysis import analyse, record
    from mavhums.core.errors import MavhumsError
    from mavhums.engine.engine import Engine
    from mavhums.history.trends import trend
    from mavhums.log import read_log
    from mavhums.report.assessment import Assessment, Verdict

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
    "Assessment": "report.assessment",
    "Engine": "engine.engine",
    "MavhumsError": "core.errors",
    "Verdict": "report.assessment",
    "actuators": "actuator",
    "analyse": "app.analysis",
    "load_airframe": "actuator",
    "read_log": "log",
    "record": "app.analysis",
    "trend": "history.trends",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"mavhums.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
