"""Presentation of results: Rerun recording, report and terminal tables.

This package does not judge. Importing it loads neither rerun nor rich; each name loads what it needs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.show.blueprint import layout
    from mavhums.show.markdown_report import markdown
    from mavhums.show.recording import Recorder
    from mavhums.show.terminal import render
    from mavhums.show.viewer import LiveViewer

__all__ = ["LiveViewer", "Recorder", "layout", "markdown", "render"]

__getattr__, __dir__ = lazy_exports(
    __name__,
    {
        "LiveViewer": "viewer",
        "Recorder": "recording",
        "layout": "blueprint",
        "markdown": "markdown_report",
        "render": "terminal",
    },
)
