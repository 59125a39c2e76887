"""Shows the session in a Rerun viewer, in a recording, or in both; an error there never ends the session."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from mavhums.engine.events import Event
from mavhums.report.assessment import Assessment
from mavhums.report.live import AlertObject, StaleObject, StatusObject
from mavhums.show.live import LiveViewer
from mavhums.show.recording import Recorder

__all__ = ["MODES", "Drawn"]

_LOG = logging.getLogger(__name__)
MODES = ("window", "browser", "web", "serve")


class Drawn:
    """Passes events to a viewer or a recorder until it fails; the failure is reported once.

    Parameters
    ----------
    drawing
        An open drawing; its owner closes it.
    """

    def __init__(self, drawing: LiveViewer | Recorder) -> None:
        self._drawing = drawing
        self._failed = False

    def consume(self, events: Sequence[Event], faults: dict[tuple[int, str], str]) -> None:
        """Draw events."""
        self._try(lambda: self._drawing.consume(events))

    def tick(self, status: StatusObject, stale: Sequence[StaleObject]) -> None:
        """Check whether the viewer still runs."""
        trouble = self._drawing.trouble if isinstance(self._drawing, LiveViewer) else None
        if trouble and not self._failed:
            self._failed = True
            _LOG.error("%s", trouble)

    def announce(self, alerts: Sequence[AlertObject]) -> None:
        """Draw nothing: the change was already drawn."""

    def close(self, assessment: Assessment) -> None:
        """Draw the verdicts."""
        self._try(lambda: self._drawing.close(assessment))

    def _try(self, draw: Callable[[], object]) -> None:
        try:
            draw()
        except Exception as error:
            if not self._failed:
                self._failed = True
                _LOG.error("nothing is drawn any more: %s", error, exc_info=_LOG.isEnabledFor(logging.DEBUG))
