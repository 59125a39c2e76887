"""Compares a flight that was judged alone with the earlier flights of its own aircraft."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from functools import partial

from mavhums.app.options import Options
from mavhums.core.errors import MavhumsError
from mavhums.history.aircraft import latest
from mavhums.history.belonging import held_own
from mavhums.history.comparison import LoneFlight, compared
from mavhums.history.flights import Since
from mavhums.history.repeated import with_copies
from mavhums.log import Decoder, read_blocks
from mavhums.report.assessment import Assessment
from mavhums.vehicle.identity import FLIGHT_MESSAGES, RecordedFlights

__all__ = ["among_own", "compared_with_own", "swapped"]


def compared_with_own(flight: LoneFlight, options: Options) -> Assessment:
    """Return the assessment of a flight, compared with the earlier flights of its aircraft.

    Parameters
    ----------
    flight
        The flight, judged alone.
    options
        The history, the dates from which its flights count, and the operator's table or rule.

    Raises
    ------
    OtherAircraftError
        If the history is of another aircraft.
    """
    assessment = among_own(flight.assessment, options)
    history = options.flights()
    since = latest(options.since, options.whose().since(assessment))
    own = flight._replace(assessment=assessment)
    return compared(own, partial(history.baselines, since=since), partial(history.past, since=since))


def among_own(assessment: Assessment, options: Options) -> Assessment:
    """Return the assessment with names of aircraft and with other recordings of its flights.

    Raises
    ------
    OtherAircraftError
        If the history is of another aircraft.
    """
    whose, history = options.whose(), options.flights()
    return with_copies(held_own(whose.named(assessment), history, whose.table), history)


def swapped(path: str | os.PathLike[str], options: Options) -> Since:
    """Return when the actuators of a log's aircraft were last swapped, from the messages that identify it.

    Raises
    ------
    MavhumsError
        If the log can be read only once.
    """
    whose = options.whose()
    if not whose.table.installed:
        return {}
    if str(path) == "-":
        raise MavhumsError("-: an aircraft table needs a file that can be read twice", "save the log first")
    decoder, recorded = Decoder(FLIGHT_MESSAGES, dialect=options.dialect), RecordedFlights()
    for block in read_blocks(path, dialect=options.dialect):
        recorded.feed(decoder.feed(block))
    recorded.feed(decoder.feed(b"", final=True))
    if decoder.first_time_us is None or decoder.undated:
        return {}
    start = datetime.fromtimestamp(decoder.first_time_us / 1e6, UTC)
    names = {whose.name(str(path), recorded.of(each).board, start.isoformat()) for each in decoder.vehicles}
    return whose.table.since(names.pop(), start) if len(names) == 1 else {}
