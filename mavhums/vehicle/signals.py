"""Reads the signals of every vehicle from the tables of any format, block by block.

If several messages of a vehicle give a continuous signal, each is a stream of its own, among which the grid
chooses; of other signals the first message received is used. If several components send a signal, the first
sender is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.log import Table
from mavhums.vehicle.facts import SIGNALS, STEPPED, Signal
from mavhums.vehicle.formats import each, messages_of, reports
from mavhums.vehicle.formats.base import Report, Source, wide
from mavhums.vehicle.states import kind_named, texts

__all__ = ["SIGNAL_MESSAGES", "SignalReader", "all_outputs"]

SIGNAL_MESSAGES: Final = messages_of(*SIGNALS, "armed", "mode", "text", "parameter")
"""Messages of any format that carry signals, or what they depend on."""


class SignalReader:
    """Reads signals from tables, block by block."""

    def __init__(self) -> None:
        self._chosen: dict[tuple[int, str], tuple[Source, int]] = {}
        self._kinds: dict[int, tuple[int, float]] = {}
        self._modes: dict[int, float] = {}

    def read(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the signals of these tables."""
        yield from self._joined_states(tables)
        parts = [
            (report, vehicle, report.table if isinstance(rows, slice) else report.table.select(rows))
            for report in reports(tables, *SIGNALS)
            for vehicle, rows in each(report.table.system)
        ]
        self._choose(parts)
        for report, vehicle, table in parts:
            first, component = self._chosen[vehicle, report.source.fact]
            source, rank = report.source, report.rank
            if source is not first and source.fact in STEPPED:
                continue
            own = table if source.all_components else table.select(table.component == component)
            if len(own):
                values, stamped = source.values(own), report.format.is_stamped(own)
                times = own.frame, own.time_us
                yield Signal(vehicle, source.fact, source.message, *times, values, stamped, rank)

    def _choose(self, parts: list[tuple[Report, int, Table]]) -> None:
        """Choose for each signal the message and its sender that came first, whatever block they came in."""
        firsts: dict[tuple[int, str], int] = {}
        for report, vehicle, table in parts:
            key, first = (vehicle, report.source.fact), int(table.frame[0])
            if first < firsts.get(key, 1 << 62) and (key in firsts or key not in self._chosen):
                firsts[key] = first
                self._chosen[key] = report.source, int(table.component[0])

    def _joined_states(self, tables: Mapping[str, Table]) -> Iterator[Signal]:
        """Yield the states of a format that records kind, arming and mode apart, whenever arming comes."""
        for said in texts(tables):
            kind = kind_named(said.text)
            if kind is not None:
                self._kinds.setdefault(said.vehicle, (said.frame, float(kind)))
        modes = [*reports(tables, "mode")]
        for report in reports(tables, "armed"):
            for vehicle, rows in each(report.table.system):
                part = report if isinstance(rows, slice) else report.select(rows)
                yield self._state(vehicle, part, modes)
        for report in modes:
            for vehicle, number in zip(report.table.system.tolist(), report.values[:, 3], strict=True):
                self._modes[vehicle] = float(number)

    def _state(self, vehicle: int, armed: Report, modes: list[Report]) -> Signal:
        frame = armed.table.frame
        since, kind = self._kinds.get(vehicle, (0, np.nan))
        frames, numbers = [np.array([-1])], [np.array([self._modes.get(vehicle, np.nan)])]
        for report in modes:
            own = report.select(report.table.system == vehicle)
            frames.append(own.table.frame)
            numbers.append(own.values[:, 3].astype(np.float64))
        mode = np.concatenate(numbers)[np.searchsorted(np.concatenate(frames), frame) - 1]
        kinds = np.where(frame > since, kind, np.nan)
        values = np.column_stack([kinds, armed.values, mode])
        return Signal(vehicle, "state", armed.source.message, frame, armed.table.time_us, values)


def all_outputs(signals: Mapping[str, Array]) -> Array:
    """Return the pulses of all outputs, (n, ALL_OUTPUTS), from the signals on a common grid."""
    pulses = wide(signals["outputs"], 0)
    for name in ("outputs_2", "outputs_3"):
        np.copyto(pulses, signals[name], where=np.isfinite(signals[name]))
    return pulses
