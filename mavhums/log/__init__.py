"""Converts the bytes of a log to tables of messages, independently of servos."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mavhums.core.startup import lazy_exports

if TYPE_CHECKING:
    from mavhums.log.base.decoder import LogDecoder as LogDecoder
    from mavhums.log.base.decoder import Table as Table
    from mavhums.log.formats import Decoder as Decoder
    from mavhums.log.reader import Log as Log
    from mavhums.log.reader import decode_blocks as decode_blocks
    from mavhums.log.reader import read_blocks as read_blocks
    from mavhums.log.reader import read_log as read_log

# Lazy, so that the list of formats is read without numba.
__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "base.decoder": "LogDecoder Table",
        "formats": "Decoder",
        "reader": "Log decode_blocks read_blocks read_log",
    },
)
