"""The profiles that logs name themselves, in a text ``mavhums airframe=NAME``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from mavhums.actuator.profile import packaged_airframes
from mavhums.log import Table
from mavhums.vehicle.states import texts

_TEXT: Final = re.compile(r"mavhums airframe=([A-Za-z0-9_.-]{1,40})")


class Announcement(NamedTuple):
    """A text ``mavhums airframe=NAME``.

    Attributes
    ----------
    frame
        Position of the message in the log.
    name
        The profile; a log may only name one that ships with mavhums, never a file.
    known
        Whether there is such a profile.
    """

    frame: int
    time_us: int
    vehicle: int
    name: str
    known: bool


def announcements(tables: Mapping[str, Table]) -> Iterator[Announcement]:
    """Yield the profile names in the log, in the order of the log."""
    known: list[str] | None = None
    for said in texts(tables):
        match = _TEXT.fullmatch(said.text.strip())
        if match:
            known = packaged_airframes() if known is None else known
            yield Announcement(said.frame, said.time_us, said.vehicle, match[1], match[1] in known)
