"""What is known of an aircraft's flights as bytes: numbers are preserved exactly."""

from __future__ import annotations

import zlib
from dataclasses import replace
from datetime import datetime
from functools import cache
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.core.errors import MavhumsError
from mavhums.flights.duplicates import Recording
from mavhums.flights.history import PastFlight
from mavhums.report.assessment import Assessment

__all__ = ["State", "unpacked_state"]

_LARGEST: Final = 1 << 30
_Key = tuple[str | None, int | None, str, str, datetime | None]


class _Flight(NamedTuple):
    assessment: Assessment
    recordings: tuple[Recording, ...]


class _Stored(NamedTuple):
    references: tuple[_Flight, ...]
    open: tuple[tuple[tuple[_Flight, ...], bool], ...]
    counts: tuple[tuple[_Key, int], ...]
    slim: tuple[_Flight, ...] | None


class State(NamedTuple):
    """The content of :class:`mavhums.flights.checkpoint.Known`.

    Attributes
    ----------
    references
        Flights that can be references.
    open
        Groups of recordings of one flight to which others may come, and whether they can be references.
    counts
        Number of references of each indicator of an actuator, with the date from which they count.
    slim
        All flights with their own-scale records; None if they were not kept.
    """

    references: tuple[PastFlight, ...]
    open: tuple[tuple[tuple[PastFlight, ...], bool], ...]
    counts: tuple[tuple[_Key, int], ...]
    slim: tuple[PastFlight, ...] | None

    def packed(self) -> bytes:
        """Return it as bytes that :func:`unpacked_state` reads."""
        content = _Stored(
            _told(self.references),
            tuple((_told(flights), wanted) for flights, wanted in self.open),
            self.counts,
            None if self.slim is None else _told(self.slim),
        )
        return zlib.compress(_adapter().dump_json(content, by_alias=True), 1)


def unpacked_state(data: bytes) -> State:
    """Return the state in the bytes of :meth:`State.packed`.

    Raises
    ------
    MavhumsError
        If the bytes are damaged, or from another version.
    """
    try:
        content: Any = _adapter().validate_json(zlib.decompressobj().decompress(data, _LARGEST))
    except (zlib.error, ValidationError) as error:
        raise MavhumsError("a store's table 'settled' is damaged", "remove it, and scan again") from error
    return State(
        _flights(content.references),
        tuple((_flights(flights), wanted) for flights, wanted in content.open),
        content.counts,
        None if content.slim is None else _flights(content.slim),
    )


def _told(flights: tuple[PastFlight, ...]) -> tuple[_Flight, ...]:
    return tuple(_Flight(flight.assessment, flight.recordings) for flight in flights)


def _flights(told: tuple[_Flight, ...]) -> tuple[PastFlight, ...]:
    return tuple(replace(PastFlight.of(flight.assessment), recordings=flight.recordings) for flight in told)


@cache
def _adapter() -> TypeAdapter[_Stored]:
    return TypeAdapter(_Stored)
