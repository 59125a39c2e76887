"""The engine fed from links: the same verdicts while the aircraft flies.

Nothing here judges. What a link brings becomes the records of a telemetry log, which the engine
takes and the recorder keeps, so a session and its recording give the same verdicts.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mavhums.live.address import Address
    from mavhums.live.session import Session
    from mavhums.live.setup import Options, prepare

__all__ = ["Address", "Options", "Session", "prepare"]

_HOMES = {"Address": "address", "Options": "setup", "Session": "session", "prepare": "setup"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
