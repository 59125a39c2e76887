"""A log's bytes, judged block by block."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mavhums.engine.engine import Engine
from mavhums.engine.events import Event
from mavhums.engine.options import EngineOptions
from mavhums.results.assessment import Assessment


def judged(
    log: bytes | Iterable[bytes], *, size: int = 1 << 22, **options: Any
) -> tuple[Assessment, list[Event]]:
    """Return what the engine says of a log, and its events; the log is cut into blocks or comes in some."""
    engine = Engine(EngineOptions(**options))
    blocks = [log[at : at + size] for at in range(0, len(log), size)] if isinstance(log, bytes) else log
    events = [*(event for block in blocks for event in engine.feed(block)), *engine.finish()]
    return engine.assessment(), events
