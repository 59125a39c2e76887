"""Health and usage monitoring of UAV servo actuators from MAVLink telemetry logs.

>>> import mavhums
>>> assessment = mavhums.analyse("flight.tlog")
>>> assessment.ranked()[0].actuator, assessment.ranked()[0].condition
('elevator', 'emergency')
>>> mavhums.record(assessment, "flight.rrd")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.lazy import lazy_exports

if TYPE_CHECKING:
    from mavhums.actuator import actuators, load_airframe
    from mavhums.app.analysis import analyse, record
    from mavhums.app.options import Options
    from mavhums.core.errors import MavhumsError
    from mavhums.engine.engine import Engine
    from mavhums.engine.options import EngineOptions
    from mavhums.history.trends import trend
    from mavhums.log import read_log
    from mavhums.report.assessment import Assessment, Verdict

__version__ = "0.1.0"

__all__ = [
    "Assessment",
    "Engine",
    "EngineOptions",
    "MavhumsError",
    "Options",
    "Verdict",
    "actuators",
    "analyse",
    "load_airframe",
    "read_log",
    "record",
    "trend",
]

__getattr__, __dir__ = lazy_exports(
    __name__,
    {
        "Assessment": "report.assessment",
        "Engine": "engine.engine",
        "EngineOptions": "engine.options",
        "MavhumsError": "core.errors",
        "Options": "app.options",
        "Verdict": "report.assessment",
        "actuators": "actuator",
        "analyse": "app.analysis",
        "load_airframe": "actuator",
        "read_log": "log",
        "record": "app.analysis",
        "trend": "history.trends",
    },
)
