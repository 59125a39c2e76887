"""The autopilot parameters in a log, as numbers.

ArduPilot sends an integer as a float of the same value; PX4 sends the integer's bits in place of the float.
Which of the two it is follows from the autopilot. On-board logs contain numbers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np

from mavhums.core.errors import MavhumsError
from mavhums.log import Decoder, Table, decode_blocks
from mavhums.log.base.tables import text_of
from mavhums.vehicle.facts import PX4
from mavhums.vehicle.formats import messages_of, reports
from mavhums.vehicle.formats.base import Report

__all__ = ["PARAMETER_MESSAGES", "Parameters", "Sent", "read_parameters"]

PARAMETER_MESSAGES = messages_of("autopilot", "parameter")
"""What :class:`Sent` reads."""

_INTEGERS = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4"}  # MAV_PARAM_TYPE


@dataclass(frozen=True, slots=True)
class Parameters:
    """The parameters of one vehicle, by name, each with its last value."""

    vehicle: int
    is_px4: bool
    values: Mapping[str, float]


@dataclass(slots=True)
class Sent:
    """The parameters that vehicles sent, as (bits of the float, type) by name, and the vehicles with PX4."""

    values: dict[int, dict[str, tuple[int, int]]] = field(default_factory=dict)
    px4: set[int] = field(default_factory=set)

    def take(self, tables: Mapping[str, Table]) -> None:
        """Take the parameters, and the autopilots, of these tables."""
        self.take_autopilots(tables)
        for report in reports(tables, "parameter"):
            self.take_parameters(report)

    def take_autopilots(self, tables: Mapping[str, Table], before: int | None = None) -> None:
        """Take the autopilots of these tables, up to a place in the log if one is given.

        What the bits of an integer parameter mean depends on the autopilot that was known when they came.
        """
        for report in reports(tables, "autopilot"):
            chosen = report.values[:, 1] == PX4
            if before is not None:
                chosen &= report.table.frame < before
            self.px4.update(report.table.system[chosen].tolist())

    def take_parameters(self, report: Report) -> None:
        """Take the rows of a report of the fact ``parameter``."""
        if report.format.AUTOPILOT == PX4:
            self.px4.update(report.table.system.tolist())
        values = report.values
        names = map(text_of, values["name"].tolist())
        rows = zip(
            report.table.system.tolist(), names, values["bits"].tolist(), values["type"].tolist(), strict=True
        )
        for system, name, bits, kind in rows:
            self.values.setdefault(system, {})[name] = bits, kind

    def of(self, vehicle: int) -> Parameters:
        """Return the parameters that a vehicle sent so far."""
        is_px4 = vehicle in self.px4
        sent = self.values.get(vehicle, {})
        values = {name: _number(*value, is_px4=is_px4) for name, value in sent.items()}
        return Parameters(vehicle, is_px4, {name: value for name, value in values.items() if isfinite(value)})


def read_parameters(
    path: str | os.PathLike[str],
    *,
    vehicle: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Parameters:
    """Read a vehicle's parameters from a log.

    Parameters
    ----------
    path
        A log.
    vehicle
        System id; may be None if the log contains the parameters of only one vehicle.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a log.
    MavhumsError
        If the log contains no parameters, none of the vehicle, or those of several vehicles.
    """
    sent = Sent()
    for tables, size, _ in decode_blocks(path, Decoder(PARAMETER_MESSAGES)):
        sent.take(tables)
        if progress:
            progress(size)
    vehicle = _choose(Path(path), vehicle, sorted(sent.values))
    return sent.of(vehicle)


def _choose(path: Path, vehicle: int | None, there: list[int]) -> int:
    if not there:
        remedy = "let the ground station download them while it records (a refresh of its parameter list)"
        raise MavhumsError(f"{path}: holds no parameters", remedy)
    known = ", ".join(map(str, there))
    if vehicle is None and len(there) > 1:
        raise MavhumsError(f"{path}: holds the parameters of vehicles {known}", "choose one with --vehicle")
    if vehicle is not None and vehicle not in there:
        raise MavhumsError(f"{path}: holds no parameters of vehicle {vehicle}", f"it holds those of {known}")
    return there[0] if vehicle is None else vehicle


def _number(bits: int, kind: int, *, is_px4: bool) -> float:
    """Return a parameter's value from the bits of its float.

    Examples
    --------
    >>> _number(1000, 6, is_px4=True)
    1000.0
    """
    word = np.array(bits, dtype="<u4")
    integer = _INTEGERS.get(kind) if is_px4 else None
    return float(word.view("<f4") if integer is None else word.astype(integer))
