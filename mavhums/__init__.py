"""Health and usage monitoring of UAV servo actuators from MAVLink telemetry logs.

Examples
--------
>>> import mavhums
>>> assessment = mavhums.analyse("flight.tlog")
>>> assessment.ranked()[0].actuator, assessment.ranked()[0].condition
('elevator', 'emergency')
>>> mavhums.record(assessment, "flight.rrd")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.about import __version__ as __version__
from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.actuator import actuators, load_airframe
    from mavhums.actuator.profile import ProfileError
    from mavhums.app.analysis import analyse, record
    from mavhums.app.many import analyse_many
    from mavhums.app.settings import Options
    from mavhums.core.errors import MavhumsError, MissingExtraError, UnreadableLogError
    from mavhums.core.packed import ArchiveError
    from mavhums.engine.engine import Engine
    from mavhums.engine.options import EngineOptions
    from mavhums.flights.aircraft import AircraftTableError, UnnamedAircraftError
    from mavhums.flights.history import UndatedError
    from mavhums.flights.reports import trend
    from mavhums.learn.model import ModelError, load_model, models
    from mavhums.learn.precedents import PrecedentError
    from mavhums.live.links import AddressError
    from mavhums.log import read_log
    from mavhums.log.mavlink.dialect import DialectError
    from mavhums.log.mavlink.signing import KeyFileError
    from mavhums.results.assessment import Assessment
    from mavhums.results.verdict import Verdict

__all__ = [
    "AddressError",
    "AircraftTableError",
    "ArchiveError",
    "Assessment",
    "DialectError",
    "Engine",
    "EngineOptions",
    "KeyFileError",
    "MavhumsError",
    "MissingExtraError",
    "ModelError",
    "Options",
    "PrecedentError",
    "ProfileError",
    "UndatedError",
    "UnnamedAircraftError",
    "UnreadableLogError",
    "Verdict",
    "actuators",
    "analyse",
    "analyse_many",
    "load_airframe",
    "load_model",
    "models",
    "read_log",
    "record",
    "trend",
]

__getattr__, __dir__ = lazy_exports(
    __name__,
    {
        "AddressError": "live.links",
        "AircraftTableError": "flights.aircraft",
        "ArchiveError": "core.packed",
        "UnnamedAircraftError": "flights.aircraft",
        "Assessment": "results.assessment",
        "DialectError": "log.mavlink.dialect",
        "Engine": "engine.engine",
        "EngineOptions": "engine.options",
        "KeyFileError": "log.mavlink.signing",
        "MavhumsError": "core.errors",
        "MissingExtraError": "core.errors",
        "ModelError": "learn.model",
        "Options": "app.settings",
        "PrecedentError": "learn.precedents",
        "ProfileError": "actuator.profile",
        "UndatedError": "flights.history",
        "UnreadableLogError": "core.errors",
        "Verdict": "results.verdict",
        "actuators": "actuator",
        "analyse": "app.analysis",
        "analyse_many": "app.many",
        "load_airframe": "actuator",
        "load_model": "learn.model",
        "models": "learn.model",
        "read_log": "log",
        "record": "app.analysis",
        "trend": "flights.reports",
    },
)
