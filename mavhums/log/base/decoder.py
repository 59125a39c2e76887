"""The interface of every format's decoder: tables of messages, and the losses that it reports."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Bytes, Integers, Records
from mavhums.core.models import Contract

if TYPE_CHECKING:
    import pandas as pd


MAVLINK1 = 1
SIGNED = 2
"""The frame has a signature, which was not verified."""
PADDED = 4
"""The CRC matched only with restored zeros, which the sender trimmed after it computed the CRC."""
ODD_TIME = 8
"""The time stamp was damaged; the time is that of a neighbouring record."""
LOOSE_TIME = 16
"""The message has no stamp, and its sender's stamped ones arrive with latencies more than 0.5 s apart."""

C_NUMBERS: Final = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
}
"""Numpy's types of numbers under their names in C, by which MAVLink and ULog define fields."""

_PARTS = ("frame", "time_us", "system", "component", "sequence", "flags", "fields")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Messages of one type in the order of the log; every array has n rows.

    Attributes
    ----------
    name
        Message name, as in its definition.
    frame
        Position of each message among all intact records of the log.
    time_us
        Time of reception, microseconds of UTC since 1970.
    system, component, sequence
        From the frame's header.
    flags
        How the frame was received: the bits of this module.
    fields
        Record array as in the log: ``fields["voltage"]`` is a column, of shape (n,) or (n, k).
    divisors
        Divisor of a field's raw number, if the format's type defines one; ``table["Lat"]`` and
        every conversion apply it.
    """

    name: str
    frame: Integers
    time_us: Integers
    system: Bytes
    component: Bytes
    sequence: Bytes
    flags: Bytes
    fields: Records
    divisors: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, field: str) -> NDArray[Any]:
        values = self.fields[field]
        divisor = self.divisors.get(field)
        return values if divisor is None else values / divisor

    def holds(self, widths: Mapping[str, int]) -> bool:
        """Return whether the numeric fields exist with these numbers of elements, 1 for a scalar.

        The definitions in a self-describing log may be arbitrary.
        """
        wire = self.fields.dtype
        for name, width in widths.items():
            if name not in (wire.names or ()):
                return False
            form, shape = wire[name].base, wire[name].shape
            if form.kind not in "iuf" or shape != ((width,) if width > 1 else ()):
                return False
        return True

    def numbers(self, field: str) -> Array:
        """Return a numeric field, (n,); NaN if the log defines it otherwise.

        The one way to read what a definition may lack: a damaged one is a quantity that was not measured.
        """
        if not self.holds({field: 1}):
            return np.full(len(self), np.nan)
        return self[field].astype(np.float64)

    def holds_text(self, name: str) -> bool:
        """Return whether there is a field of characters with this name."""
        wire = self.fields.dtype
        return name in (wire.names or ()) and wire[name].kind == "S"

    def select(self, rows: NDArray[Any]) -> Table:
        """Return the rows that a mask or an index array selects."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        parts: dict[str, Any] = {part: getattr(self, part)[rows] for part in _PARTS}
        return replace(self, **parts)

    @classmethod
    def concatenate(cls, tables: list[Table]) -> Table:
        """Join tables of one message type, in order."""
        if len(tables) == 1:
            return tables[0]
        parts = {part: [getattr(table, part) for table in tables] for part in _PARTS}
        wire = tables[0].fields.dtype
        parts["fields"] = [np.ascontiguousarray(rows).view(np.uint8) for rows in parts["fields"]]
        joined: dict[str, Any] = {part: np.concatenate(rows) for part, rows in parts.items()}
        return replace(tables[0], **joined | {"fields": joined["fields"].view(wire)})

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame indexed by time of reception (UTC).

        An array field of k elements becomes k columns, ``data[0]`` … ``data[k-1]``.
        """
        import pandas as pd

        columns: dict[str, Any] = {
            "system": self.system,
            "component": self.component,
            "sequence": self.sequence,
        }
        for name in self.fields.dtype.names or ():
            values = self[name]
            if values.dtype.kind == "S":
                columns[name] = _as_text(values)
            elif values.ndim == 1:
                columns[name] = np.ascontiguousarray(values)
            else:
                columns |= {
                    f"{name}[{k}]": np.ascontiguousarray(values[:, k]) for k in range(values.shape[1])
                }
        index = pd.DatetimeIndex(self.time_us.view("M8[us]"), name="time").tz_localize("UTC")
        return pd.DataFrame(columns, index=index, copy=False)


def _as_text(values: NDArray[Any]) -> Any:
    """Return chars as pandas' text, each distinct value decoded once."""
    import pandas as pd

    numbers: dict[bytes, int] = {}
    codes = [numbers.setdefault(value, len(numbers)) for value in values.tolist()]
    return pd.array([text_of(value) for value in numbers], dtype="str").take(np.array(codes, dtype=np.int64))


def text_of(value: bytes) -> str:
    """Return a char field as text, cut at the first NUL."""
    return value.split(b"\0")[0].decode("utf-8", "replace")


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
