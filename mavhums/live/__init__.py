"""The engine fed from links: the same verdicts while the aircraft flies.

Nothing here judges. What a link brings becomes the records of a telemetry log, which the engine
takes and the recorder keeps, so a session and its recording give the same verdicts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.lazy import lazy_exports

if TYPE_CHECKING:
    from mavhums.live.address import Address
    from mavhums.live.session import Session
    from mavhums.live.setup import Options, prepare

__all__ = ["Address", "Options", "Session", "prepare"]

__getattr__, __dir__ = lazy_exports(
    __name__,
    {"Address": "address", "Options": "setup", "Session": "session", "prepare": "setup"},
)
