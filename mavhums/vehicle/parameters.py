"""The autopilot parameters in a log, as numbers.

ArduPilot sends an integer as a float of the same value; PX4 sends the integer's bits in place of the float.
PARAM_VALUE gives the type, HEARTBEAT the autopilot. On-board logs contain numbers:
ArduPilot's PARM records and ULog's parameter messages.
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

__all__ = ["PARAMETER_MESSAGES", "Parameters", "Sent", "read_parameters"]

PARAMETER_MESSAGES = frozenset({"HEARTBEAT", "PARAM_VALUE", "PARM", "parameter"})
"""Messages that tell parameters."""

_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_PX4 = 12  # MAV_AUTOPILOT_PX4
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
        heartbeats, sent = tables.get("HEARTBEAT"), tables.get("PARAM_VALUE")
        if heartbeats is not None:
            self.px4.update(heartbeats.system[heartbeats["autopilot"] == _PX4].tolist())
        if sent is not None:
            bits = np.ascontiguousarray(sent["param_value"]).view("<u4")
            rows = zip(sent.system, sent.texts("param_id"), bits, sent["param_type"], strict=True)
            for system, name, value, kind in rows:
                self.values.setdefault(int(system), {})[name] = int(value), int(kind)
        typed = tables.get("parameter")
        if typed is not None:
            self.px4.update(typed.system.tolist())
            rows = zip(typed.system, typed.texts("name"), typed.texts("type"), typed["value"], strict=True)
            for system, name, form, value in rows:
                kind, wire = (_INT32, "<i4") if form == "int32_t" else (_REAL32, "<f4")
                word = np.array(value).astype(wire).view("<u4")
                self.values.setdefault(int(system), {})[name] = int(word), kind
        logged = tables.get("PARM")
        if logged is not None:
            bits = np.ascontiguousarray(logged["Value"].astype("<f4")).view("<u4")
            for system, name, value in zip(logged.system, logged.texts("Name"), bits, strict=True):
                self.values.setdefault(int(system), {})[name] = int(value), _REAL32

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
        A ``.tlog`` file.
    vehicle
        System id; may be None if the log contains the parameters of only one vehicle.
    progress
        Called with the number of bytes read after each block.

    Raises
    ------
    UnreadableLogError
        If the file is missing or not a telemetry log.
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
