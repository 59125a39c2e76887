"""Feeds the engine from links: the verdicts in flight are those of the log.

Nothing here judges. Received data become the records of a telemetry log. The engine processes them and
the recorder stores them, so a session and its recording give the same verdicts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.live.links import Address
    from mavhums.live.session import Session
    from mavhums.live.setup import LiveOptions, prepare

__all__ = ["Address", "LiveOptions", "Session", "prepare"]

__getattr__, __dir__ = lazy_exports(
    __name__,
    {"Address": "links", "LiveOptions": "setup", "Session": "session", "prepare": "setup"},
)
