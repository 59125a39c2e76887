"""The precedent base: labelled histories of actuators, flown and simulated (paper, section 2).

A folder of Parquet files, one per actuator and log. Every row carries its provenance, so any tool
that reads Parquet can query the base.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mavhums.core.arrays import Array, Integers
from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.output import written_whole
from mavhums.core.quantities import KEYS

if TYPE_CHECKING:
    from pyarrow import Schema

Label = Literal["normal", "emergency"]
Origin = Literal["flown", "simulated"]


class PrecedentError(MavhumsError):
    """The precedent base cannot be read or written."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """The source of a history.

    Attributes
    ----------
    log, sha256
        Name of the log and the hash of its bytes.
    vehicle, actuator, airframe
        The vehicle and actuator of the history, and the profile used.
    tier
        The telemetry tier.
    label
        The actuator's true condition.
    origin
        Whether the history is flown or simulated.
    """

    log: str
    sha256: str
    vehicle: int
    actuator: str
    airframe: str
    tier: str
    label: Label
    origin: Origin


@dataclass(frozen=True, slots=True)
class Precedent:
    """One history of the base: its file, provenance and number of samples."""

    path: Path
    provenance: Provenance
    samples: int


class PrecedentBase:
    """A folder of precedents.

    Parameters
    ----------
    folder
        Created with the first precedent.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        try:
            import pyarrow  # noqa: F401
        except ModuleNotFoundError as error:
            raise MissingExtraError("the precedent base", "train") from error
        self.folder = Path(folder)

    def add(self, provenance: Provenance, time_us: Integers, values: Array) -> Precedent:
        """Store one history; it replaces an earlier one of the same log and actuator.

        Parameters
        ----------
        provenance
            Source of the history.
        time_us
            Microseconds of UTC, shape (n,).
        values
            V1…V12, shape (n, 12); NaN where the log does not carry a quantity.

        Raises
        ------
        PrecedentError
            If the folder cannot be written.
        ValueError
            If the shapes do not fit.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        if values.shape != (len(time_us), len(KEYS)):
            raise ValueError(f"values must have the shape ({len(time_us)}, {len(KEYS)}), not {values.shape}")
        columns: list[Any] = [pa.array(time_us, type=pa.timestamp("us", tz="UTC"))]
        columns += [pa.array(values[:, place]) for place in range(len(KEYS))]
        for value in asdict(provenance).values():
            columns.append(pa.array([value] * len(time_us)).dictionary_encode())
        table = pa.table(columns, schema=_schema())
        name = f"{provenance.sha256[:16]}-{provenance.vehicle}-{provenance.actuator}.parquet"
        path = self.folder / name
        remedy = "name a folder that you may write to"
        try:
            self.folder.mkdir(0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise PrecedentError(f"cannot write {self.folder}: {error.strerror}", remedy) from error
        with written_whole(path, error=PrecedentError, remedy=remedy) as temporary:
            pq.write_table(table, temporary, compression="zstd")
        return Precedent(path, provenance, len(time_us))

    def __iter__(self) -> Iterator[Precedent]:
        """Iterate over the precedents in order of file name, without reading their samples."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        if not self.folder.is_dir():
            raise PrecedentError(
                f"{self.folder}: no precedent base there", "add to one with `mavhums precedents add`"
            )
        for path in sorted(self.folder.glob("*.parquet")):
            try:
                with pq.ParquetFile(path) as file:
                    first = next(file.iter_batches(1, columns=_PROVENANCE)).to_pylist()[0]
                    yield Precedent(path, Provenance(**first), file.metadata.num_rows)
            except (pa.ArrowException, OSError, StopIteration, TypeError) as error:
                raise PrecedentError(
                    f"{path}: not a precedent", "remove it, and add its log again"
                ) from error

    def read(self, precedent: Precedent) -> Array:
        """Return V1…V12 of a precedent, shape (n, 12)."""
        import pyarrow.parquet as pq

        table = pq.read_table(precedent.path, columns=list(KEYS), partitioning=None)
        return np.column_stack([table[key].to_numpy() for key in KEYS])


_PROVENANCE = [field.name for field in fields(Provenance)]


def _schema() -> Schema:
    import pyarrow as pa

    kinds = {"vehicle": pa.dictionary(pa.int32(), pa.int64())}
    text = pa.dictionary(pa.int32(), pa.string())
    return pa.schema(
        [
            ("time", pa.timestamp("us", tz="UTC")),
            *((key, pa.float64()) for key in KEYS),
            *((name, kinds.get(name, text)) for name in _PROVENANCE),
        ]
    )
