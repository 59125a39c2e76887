"""Reads the name of a vehicle's airframe profile from the log."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from mavhums.actuator.profile import packaged_airframes
from mavhums.log import Table

__all__ = ["Announcement", "announcements"]

_TEXT = re.compile(r"mavhums airframe=([A-Za-z0-9_.-]{1,40})")


class Announcement(NamedTuple):
    """A STATUSTEXT ``mavhums airframe=NAME``.

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
    """Yield what the log says of profiles, in the order of the log."""
    table = tables.get("STATUSTEXT")
    if table is None:
        return
    known = packaged_airframes()
    for k, text in enumerate(table.texts("text")):
        match = _TEXT.fullmatch(text.strip())
        if match:
            name = match[1]
            yield Announcement(
                int(table.frame[k]), int(table.time_us[k]), int(table.system[k]), name, name in known
            )
