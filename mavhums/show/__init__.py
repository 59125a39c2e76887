"""What mavhums found, made visible: a Rerun recording, a report, a table on the terminal.

Nothing here judges. Importing the room loads neither rerun nor rich; each name loads what it needs.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mavhums.show.blueprint import layout
    from mavhums.show.live import LiveViewer
    from mavhums.show.recording import Recorder
    from mavhums.show.report import markdown
    from mavhums.show.terminal import render
    from mavhums.show.trend_recording import record_trend

__all__ = ["LiveViewer", "Recorder", "layout", "markdown", "record_trend", "render"]

_HOMES = {
    "LiveViewer": "live",
    "Recorder": "recording",
    "layout": "blueprint",
    "markdown": "report",
    "record_trend": "trend_recording",
    "render": "terminal",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
