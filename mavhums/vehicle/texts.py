"""The texts that a vehicle sends, from any message type that carries text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from mavhums.log import Table

__all__ = ["TEXT_MESSAGES", "Text", "texts"]

_FIELDS: Final = {"STATUSTEXT": "text", "MSG": "Message", "logged_string": "text"}

TEXT_MESSAGES: Final = frozenset(_FIELDS)
"""Messages that carry texts: MAVLink's, DataFlash's and ULog's."""


class Text(NamedTuple):
    """One text: its position in the log, its time in microseconds of UTC, and its sender."""

    frame: int
    time_us: int
    vehicle: int
    text: str


def texts(tables: Mapping[str, Table]) -> Iterator[Text]:
    """Yield the texts that vehicles send, each kind of message in the order of the log."""
    for name, field in _FIELDS.items():
        table = tables.get(name)
        if table is None or not table.holds_text(field):
            continue
        said = zip(
            table.frame.tolist(),
            table.time_us.tolist(),
            table.system.tolist(),
            table.texts(field),
            strict=True,
        )
        yield from (Text(*row) for row in said)
