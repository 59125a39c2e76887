"""The interface of every format's package and of its decoder, and the losses that a decoder reports."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple, Protocol

from mavhums.core.models import Contract
from mavhums.log.base.tables import Table


class Region(Contract):
    """Damaged bytes between two frames: where they begin in the log, and how many they are."""

    offset: int
    size: int


class SequenceLoss(Contract):
    """What the sequence numbers of one sender say: frames that never reached the log.

    ``missing`` counts modulo 256 where a link was silent for long, so it is a lower bound.
    """

    system: int
    component: int
    frames: int
    missing: int
    gaps: int
    reordered: int
    duplicated: int


class Losses(Contract):
    """What could not be read, and what was odd.

    ``regions`` lists the first hundred of ``damaged_regions``. ``padded_frames`` had their zeros
    trimmed after the CRC was computed and were accepted with the zeros put back; at most
    ``padded_false_bound`` of them are expected to be accepted by chance. ``line_ends_restored``
    counts the carriage returns that a conversion to text had put in. Where only frames signed with a
    key are read, those without a signature, with a wrong one and with an old one were left out.
    ``logger_dropped`` counts what an on-board logger says that it could not write: records, or pauses
    where the format counts those. Four counts by message, of all vehicles: ``late_samples`` came after
    their second was settled or behind their own stream, ``same_time_samples`` have the time of an earlier
    one, ``broken_stamps`` a time that no clock of their sender explains, and ``copies`` had arrived before,
    as over several routes.
    """

    bytes_skipped: int = 0
    damaged_regions: int = 0
    bad_crc_frames: int = 0
    unknown_frames: int = 0
    implausible_times: int = 0
    cut_end_bytes: int = 0
    regions: tuple[Region, ...] = ()
    bad_crc_by_message: dict[str, int] = {}
    padded_frames: int = 0
    padded_false_bound: float = 0.0
    trailing_zeros: int = 0
    line_ends_restored: int = 0
    time_jumps: int = 0
    time_rewinds: int = 0
    sequence: tuple[SequenceLoss, ...] = ()
    unsigned_frames: int = 0
    bad_signatures: int = 0
    replayed_frames: int = 0
    logger_dropped: int = 0
    late_samples: dict[str, int] = {}
    same_time_samples: dict[str, int] = {}
    broken_stamps: dict[str, int] = {}
    copies: dict[str, int] = {}

    @property
    def any(self) -> bool:
        """Whether anything that the log held is gone or in doubt.

        Frames of a foreign dialect and frames that never reached the log are not, nor is a last frame that
        was not finished: so ends every log that ends with the power.
        """
        return bool(
            self.bytes_skipped
            or self.bad_crc_frames
            or self.implausible_times
            or self.padded_frames
            or self.bad_signatures
        )


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

    @property
    def ahead_us(self) -> int:
        """What is added to the times for UTC, where the clock that dates them was set while it recorded."""
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
