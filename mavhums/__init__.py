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
    from mavhums.actuator.history import actuators as actuators
    from mavhums.actuator.profile import ProfileError as ProfileError
    from mavhums.actuator.profile import load_airframe as load_airframe
    from mavhums.app.analysis import analyse as analyse
    from mavhums.app.analysis import analyse_many as analyse_many
    from mavhums.app.analysis import record as record
    from mavhums.app.settings import Options as Options
    from mavhums.core.errors import MavhumsError as MavhumsError
    from mavhums.core.errors import MissingExtraError as MissingExtraError
    from mavhums.core.errors import UnreadableLogError as UnreadableLogError
    from mavhums.core.packed import ArchiveError as ArchiveError
    from mavhums.engine.engine import Engine as Engine
    from mavhums.engine.options import EngineOptions as EngineOptions
    from mavhums.flights.aircraft import AircraftTableError as AircraftTableError
    from mavhums.flights.aircraft import UnnamedAircraftError as UnnamedAircraftError
    from mavhums.flights.history import UndatedError as UndatedError
    from mavhums.flights.reports import trend as trend
    from mavhums.learn.model import ModelError as ModelError
    from mavhums.learn.model import load_model as load_model
    from mavhums.learn.model import models as models
    from mavhums.learn.precedents import PrecedentError as PrecedentError
    from mavhums.live.links import AddressError as AddressError
    from mavhums.log import read_log as read_log
    from mavhums.log.mavlink.dialect import DialectError as DialectError
    from mavhums.log.mavlink.signing import KeyFileError as KeyFileError
    from mavhums.results.assessment import Assessment as Assessment
    from mavhums.results.verdict import Verdict as Verdict

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "actuator.profile": "ProfileError load_airframe",
        "actuator.history": "actuators",
        "app.analysis": "analyse analyse_many record",
        "app.settings": "Options",
        "core.errors": "MavhumsError MissingExtraError UnreadableLogError",
        "core.packed": "ArchiveError",
        "engine.engine": "Engine",
        "engine.options": "EngineOptions",
        "flights.aircraft": "AircraftTableError UnnamedAircraftError",
        "flights.history": "UndatedError",
        "flights.reports": "trend",
        "learn.model": "ModelError load_model models",
        "learn.precedents": "PrecedentError",
        "live.links": "AddressError",
        "log": "read_log",
        "log.mavlink.dialect": "DialectError",
        "log.mavlink.signing": "KeyFileError",
        "results.assessment": "Assessment",
        "results.verdict": "Verdict",
    },
)
