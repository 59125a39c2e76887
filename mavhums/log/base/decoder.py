"""The interface of every format's package and of its decoder."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple, Protocol

from mavhums.log.base.losses import Losses
from mavhums.log.base.tables import Table

__all__ = ["PIECE", "FormatPackage", "LogDecoder", "Refusal", "join_tables"]

PIECE = 1 << 16
"""Bytes of a log's beginning that are read at a time, until a frame or definition settles what the log is."""


class LogDecoder(Protocol):
    """Converts blocks of a log's bytes to tables of messages, in bounded memory.

    Names of messages and fields are the format's own. The tables do not depend on where
    blocks end; an unfinished record waits for the next block.
    """

    @property
    def format(self) -> str:
        """Name of the format, as in `mavhums.log.formats`."""
        ...

    @property
    def counts(self) -> dict[tuple[int, int, str], int]:
        """Number of intact messages by (system, component, name), wanted or not.

        ``system`` is the vehicle's id; ``component`` distinguishes instances if the format has them.
        """
        ...

    @property
    def vehicles(self) -> tuple[int, ...]:
        """Ids of the vehicles, increasing."""
        ...

    @property
    def unknown(self) -> dict[int, int]:
        """Number of records with an undefined message id, by id."""
        ...

    @property
    def losses(self) -> Losses:
        """Losses so far: unreadable data, and data that the vehicle reports as not recorded."""
        ...

    @property
    def first_time_us(self) -> int | None:
        """Time of the first message, microseconds of UTC; None before it."""
        ...

    @property
    def last_time_us(self) -> int | None:
        """Time of the latest message, microseconds of UTC; None before the first."""
        ...

    @property
    def undated(self) -> bool:
        """Whether the log contains no date, so that times count from the vehicle's boot."""
        ...

    def feed(self, block: bytes, *, final: bool = False) -> dict[str, Table]:
        """Return the messages that ``block`` completes, by name; ``final`` says that nothing follows."""
        ...


class Refusal(NamedTuple):
    """The reason why a log cannot be read, formatted to follow "FILE: ", and the remedy."""

    problem: str
    remedy: str


class FormatPackage(Protocol):
    """What the package of a format exports."""

    def decoder(self, messages: Collection[str] | None) -> LogDecoder:
        """Return a new decoder of the wanted message types, all if None."""
        ...

    def refusal(self, head: bytes) -> Refusal | None:
        """Return why a log that begins with ``head`` (up to 1 MB) cannot be read; None if it can."""
        ...


def join_tables(parts: list[Table]) -> dict[str, Table]:
    """Return the tables by name, those of one name joined in order."""
    by_name: dict[str, list[Table]] = {}
    for part in parts:
        by_name.setdefault(part.name, []).append(part)
    return {name: Table.concatenate(tables) for name, tables in by_name.items()}
