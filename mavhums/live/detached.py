"""A sink in its own thread, so that a viewer that hangs delays nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from mavhums.engine.events import Event, Samples
from mavhums.live.outlet import Outlet
from mavhums.live.session import Sink
from mavhums.report.assessment import Assessment
from mavhums.report.live import AlertObject, StaleObject, StatusObject

__all__ = ["Detached"]

_SAMPLES: Final = 100_000
"""How many samples may wait: about a minute of an aircraft with 16 actuators at 100 Hz, 10 MB."""


class Detached:
    """Passes everything to a sink in its own thread; drops items that wait too long.

    Parameters
    ----------
    sink
        The sink; from now on only the thread uses it.
    name
        Name in messages.
    release
        Called in the thread at the end.
    patience_s
        Maximum duration of the end.
    """

    def __init__(
        self, sink: Sink, name: str, release: Callable[[], object], *, patience_s: float = 1.0
    ) -> None:
        self.outlet: Outlet[Callable[[], object]] = Outlet(name, lambda call: call(), room=_SAMPLES)
        self._sink, self._release, self._patience_s = sink, release, patience_s

    def consume(self, events: Sequence[Event], faults: dict[tuple[int, str], str]) -> None:
        """Pass events to the sink."""
        samples = sum(event.time_s.size for event in events if isinstance(event, Samples))
        self.outlet.put(partial(self._sink.consume, events, faults), 1 + samples)

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Pass the state to the sink."""
        self.outlet.put(partial(self._sink.tick, status, stale))

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Pass the alerts that were sent to the sink."""
        self.outlet.put(partial(self._sink.announce, alerts))

    def close(self, assessment: Assessment) -> None:
        """Pass the verdicts to the sink."""
        self.outlet.put(partial(self._sink.close, assessment))

    def finish(self) -> bool:
        """Release the sink; return whether it was released within its time."""
        began_s = time.monotonic()
        self.outlet.put(self._release)
        return self.outlet.close(self._patience_s - (time.monotonic() - began_s))
