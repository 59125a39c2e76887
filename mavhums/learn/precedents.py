"""The precedent base: labelled histories of actuators, flown and simulated (paper, section 2).

A folder of Parquet files, one per actuator and log. Every row carries its provenance, so any tool
that reads Parquet can query the base.
"""

from __future__ import annotations

import csv
import os
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np

from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.output import written_whole
from mavhums.core.quantities import KEYS

Label = Literal[
    "normal",
    "friction_degraded",
    "friction_emergency",
    "winding_resistance",
    "torque_constant",
    "backlash",
    "supply_sag",
    "sensor_bias",
    "jam",
]
LABELS: Final[tuple[Label, ...]] = get_args(Label)
"""The conditions that a label names: the classes of the network of windows."""
Origin = Literal["flown", "simulated"]


class PrecedentError(MavhumsError):
    """The precedent base or a table of labels cannot be read or written."""


def label_of(text: str) -> Label:
    """Return the condition that a text names; ``emergency``, the paper's class, is that of the friction.

    Raises
    ------
    PrecedentError
        If it names none.

    Examples
    --------
    >>> label_of("emergency")
    'friction_emergency'
    """
    name = text.strip()
    for label in LABELS:
        if name == label or (name == "emergency" and label == "friction_emergency"):
            return label
    raise PrecedentError(f"no condition is named {name[:40]!r}", f"name one of: {', '.join(LABELS)}")


_EXAMPLE = "write a CSV table with the columns log, actuator and label: worn.tlog,rudder,friction_emergency"


def read_labels(path: str | os.PathLike[str]) -> dict[str, dict[str, Label]]:
    """Return the labels of a table, by log and actuator; the actuator "" is every other one of its log.

    Parameters
    ----------
    path
        A CSV file with the columns ``log``, the log's name without its folder, ``actuator``, which may be
        empty or missing, and ``label``.

    Raises
    ------
    PrecedentError
        If it cannot be read, lacks a column, contradicts itself, or has a label that is no condition.
    """
    found: dict[str, dict[str, Label]] = defaultdict(dict)
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, strict=True, skipinitialspace=True)
            for row in rows:
                where = f"{path}:{rows.line_num}"
                if not row.get("log") or not row.get("label"):
                    raise PrecedentError(f"{where}: names no log or no label", _EXAMPLE)
                try:
                    label = label_of(row["label"])
                except PrecedentError as error:
                    raise PrecedentError(f"{where}: {error.problem}", error.remedy) from error
                log, actuator = Path(row["log"].strip()).name, (row.get("actuator") or "").strip()
                if found[log].setdefault(actuator, label) != label:
                    raise PrecedentError(
                        f"{where}: another row labels {actuator or log} differently", _EXAMPLE
                    )
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise PrecedentError(f"{path}: no readable table: {error}", _EXAMPLE) from error
    return dict(found)


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

    def add(self, provenance: Provenance, time_us: Integers, values: Array, measured: Flags) -> Precedent:
        """Store one history; it replaces an earlier one of the same log and actuator.

        Parameters
        ----------
        provenance
            Source of the history.
        time_us
            Microseconds of UTC, shape (n,).
        values
            V1…V12, shape (n, 12); NaN where the log does not carry a quantity.
        measured
            Which of them the log carries, as opposed to derived ones, shape (n, 12).

        Raises
        ------
        PrecedentError
            If the folder cannot be written.
        ValueError
            If the shapes do not fit.
        """
        import pandas as pd

        for given in (values, measured):
            if given.shape != (len(time_us), len(KEYS)):
                raise ValueError(f"the shape must be ({len(time_us)}, {len(KEYS)}), not {given.shape}")
        table = pd.DataFrame(values, columns=list(KEYS))
        table[_MEASURED] = measured
        table.insert(0, "time", pd.DatetimeIndex(time_us.astype("datetime64[us]"), tz="UTC"))
        for name, value in asdict(provenance).items():
            table[name] = pd.Categorical([value]).repeat(len(table))
        path = self.folder / f"{provenance.sha256[:16]}-{provenance.vehicle}-{provenance.actuator}.parquet"
        remedy = "name a folder that you may write to"
        try:
            self.folder.mkdir(0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise PrecedentError(f"cannot write {self.folder}: {error.strerror}", remedy) from error
        with written_whole(path, error=PrecedentError, remedy=remedy) as temporary:
            table.to_parquet(temporary, compression="zstd", index=False)
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
                    if not {*_MEASURED} <= {*file.schema_arrow.names}:
                        raise TypeError("it does not say what is measured")
                    first = next(file.iter_batches(1, columns=_PROVENANCE)).to_pylist()[0]
                    said = Provenance(**first | {"label": label_of(first["label"])})
                    yield Precedent(path, said, file.metadata.num_rows)
            except (pa.ArrowException, OSError, StopIteration, TypeError, PrecedentError) as error:
                raise PrecedentError(
                    f"{path}: not a precedent", "remove it, and add its log again"
                ) from error

    def read(self, precedent: Precedent) -> tuple[Array, Array, Flags]:
        """Return times, s from the first sample, (n,); V1…V12, and which of them are measured, (n, 12)."""
        import pandas as pd

        table = pd.read_parquet(precedent.path, columns=["time", *KEYS, *_MEASURED], partitioning=None)
        time_us = table.pop("time").to_numpy("datetime64[us]").astype(np.int64)
        time_s = np.asarray((time_us - time_us[:1]) * 1e-6, dtype=np.float64)
        values = np.ascontiguousarray(table[[*KEYS]], dtype=np.float64)
        return time_s, values, table[_MEASURED].to_numpy(np.bool_)


_PROVENANCE = [field.name for field in fields(Provenance)]
_MEASURED = [f"{key}_measured" for key in KEYS]
