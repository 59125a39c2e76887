"""The meaning of message ids: the subscriptions of a log, and their layouts."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mavhums.log.ulog._headers import TOPIC, UNKNOWN, UNUSED
from mavhums.log.ulog.layouts import Formats, Layout
from mavhums.log.ulog.messages import RESERVED

__all__ = ["Topics"]

_IDS = 1 << 16
_TOPIC = re.compile(r"[A-Za-z][A-Za-z0-9_\-/]{0,254}")
_OF_OTHERS = re.compile("[A-Z0-9_]+")
"""Names as of MAVLink messages and DataFlash records: what reads those must not take a topic for one."""

_F, _A, _R = b"FAR"


class Topics:
    """Tracks formats and subscriptions.

    Attributes
    ----------
    ids
        Shape (65536,) of `TOPIC`, by message id, for the scan kernel.
    layouts
        Layouts of the subscribed topics, one for each name.
    """

    def __init__(self) -> None:
        self.ids: NDArray[np.void] = np.zeros(_IDS, dtype=TOPIC)
        self.ids["definition"] = UNUSED
        self.layouts: list[Layout] = []
        self._formats = Formats()
        self._numbers: dict[str, int] = {}

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records by message id that have no layout."""
        counts = self.ids["unknown"]
        return {int(number): int(counts[number]) for number in np.flatnonzero(counts)}

    def take(self, kind: int, body: bytes) -> None:
        """Process a format, a subscription, or its end."""
        if kind == _F:
            self._formats.add(body)
        elif kind == _A:
            self._subscribe(body[0], int.from_bytes(body[1:3], "little"), body[3:].decode("utf-8", "replace"))
        elif kind == _R:
            self.ids[int.from_bytes(body[:2], "little")]["definition"] = UNKNOWN

    def _subscribe(self, instance: int, number: int, name: str) -> None:
        layout = self._formats.layout(name) if _TOPIC.fullmatch(name) and name not in RESERVED else None
        topic = self.ids[number]
        topic["instance"] = instance
        if layout is None:
            topic["definition"], topic["least"], topic["most"] = UNKNOWN, 0, _IDS
            return
        if _OF_OTHERS.fullmatch(name):
            name = f"ulog_{name}"
            layout = replace(layout, name=name)
        if name not in self._numbers:
            self._numbers[name] = len(self.layouts)
            self.layouts.append(layout)
        topic["definition"] = self._numbers[name]
        topic["least"], topic["most"], topic["stamp"] = layout.wire.itemsize, layout.most, layout.stamp
