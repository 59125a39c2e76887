"""One actuator's part of a recording: buffers that are written out a chunk at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mavhums.actuator.profile import Limits
from mavhums.assessment import Condition
from mavhums.events import ConditionChanged, Samples, Window
from mavhums.quantities import KEYS
from mavhums.show._words import COLOURS

__all__ = ["ARCHETYPE", "TIMELINE", "Texts", "Track", "actuator_path", "nanoseconds"]

TIMELINE: Final = "flight_time"
ARCHETYPE: Final = "mavhums"

_ROWS_PER_CHUNK = 4096
_BLUE, _PALE = (86, 180, 233), (60, 110, 145)
_STYLES: Final = {
    "friction": rr.SeriesLines(
        names=["friction", "low (95 %)", "high (95 %)"], colors=[_BLUE, _PALE, _PALE], widths=[2.5, 1, 1]
    ),
    "network": rr.SeriesLines(names="probability of emergency", colors=_BLUE, widths=2.5),
}

_Rows = NDArray[np.float64]


def nanoseconds(time_s: _Rows | Sequence[float]) -> NDArray[np.timedelta64]:
    """Return flight times as Rerun's durations."""
    rounded = np.rint(np.asarray(time_s, dtype=np.float64) * 1e9)
    return rounded.astype(np.int64).astype("timedelta64[ns]")


def actuator_path(vehicle: int | None, actuator: str) -> str:
    """Return the entity path under which all of an actuator lies."""
    return rr.new_entity_path(["no_vehicle" if vehicle is None else f"vehicle_{vehicle}", actuator])


def _index(time_s: _Rows | Sequence[float]) -> list[rr.TimeColumn]:
    return [rr.TimeColumn(TIMELINE, duration=nanoseconds(time_s))]


class Track:
    """Writes what the engine says of one actuator.

    Parameters
    ----------
    stream
        The recording.
    vehicle, actuator
        Whose track it is; the entities lie under :func:`actuator_path`.

    Attributes
    ----------
    root
        The entity path of the actuator.
    present
        The quantities that the log carries at all, and ``friction`` and ``network`` where ever estimated.
    """

    def __init__(self, stream: rr.RecordingStream, vehicle: int | None, actuator: str) -> None:
        self.root = actuator_path(vehicle, actuator)
        self.present: set[str] = set()
        self._stream = stream
        self._blocks: list[Samples] = []
        self._waiting = 0
        self._windows: list[Window] = []
        self._states: list[tuple[float, str]] = []
        self._first_s = np.inf
        self._last_s = -np.inf
        self._state_s: float | None = None
        self._held: Condition = "undecided"
        states = rr.StateConfiguration(
            values=list(COLOURS), labels=list(COLOURS), colors=[(*rgb, 255) for rgb in COLOURS.values()]
        )
        stream.log(self.root, states, static=True)

    def samples(self, event: Samples) -> None:
        """Take samples, and write them when a chunk is full."""
        if not event.time_s.size:
            return
        self._seen(float(event.time_s.min()), float(event.time_s.max()))
        self._blocks.append(event)
        self._waiting += event.time_s.size
        if self._waiting >= _ROWS_PER_CHUNK:
            self._flush_samples()

    def window(self, event: Window) -> None:
        """Take what a window shows."""
        self._seen(event.start_s, event.end_s)
        self._held = event.condition
        self._windows.append(event)
        if len(self._windows) >= _ROWS_PER_CHUNK:
            self._flush_windows()

    def changed(self, event: ConditionChanged) -> None:
        """Take a change of condition; the timeline shows it where it happened, not where it was certain."""
        if self._state_s is None and event.since_s > self._first_s:
            self._state(self._first_s, event.before)
        self._state(event.since_s, event.after)
        self._held = event.after

    def limits(self, limits: Limits, start_s: float) -> None:
        """Draw the limits from a time to the last that was seen."""
        style = rr.SeriesLines(
            names=[f"normal up to {limits.normal:g}", f"emergency from {limits.emergency:g}"],
            colors=[COLOURS["degraded"], COLOURS["emergency"]],
            widths=[2, 2],
        )
        self._stream.log(f"{self.root}/limits", style, static=True)
        rows = np.tile([limits.normal, limits.emergency], (2, 1))
        self._send("limits", [start_s, max(start_s, self._last_s)], rr.Scalars.columns(scalars=rows))

    def finish(self) -> None:
        """Write what is still waiting."""
        if self._state_s is None:
            self._state(self._first_s if np.isfinite(self._first_s) else 0.0, self._held)
        self._flush_samples()
        self._flush_windows()
        self._flush_states()

    def _seen(self, first_s: float, last_s: float) -> None:
        self._first_s, self._last_s = min(self._first_s, first_s), max(self._last_s, last_s)

    def _state(self, time_s: float, condition: Condition) -> None:
        """Add a state; one found later is never drawn below one found earlier."""
        self._state_s = time_s if self._state_s is None else max(time_s, self._state_s + 1e-6)
        self._states.append((self._state_s, condition))
        if len(self._states) >= _ROWS_PER_CHUNK:
            self._flush_states()

    def _flush_samples(self) -> None:
        blocks, self._blocks, self._waiting = self._blocks, [], 0
        if not blocks:
            return
        time = np.concatenate([block.time_s for block in blocks])
        values = np.concatenate([block.values for block in blocks])
        for start in range(0, time.size, _ROWS_PER_CHUNK):
            rows = values[start : start + _ROWS_PER_CHUNK]
            self.present |= {
                key for key, lost in zip(KEYS, np.isnan(rows).all(axis=0), strict=True) if not lost
            }
            columns = {
                key: rr.components.ScalarBatch(rows[:, place])
                for place, key in enumerate(KEYS)
                if key in self.present
            }
            if columns:
                content = rr.DynamicArchetype.columns(ARCHETYPE, components=columns)
                self._send("quantities", time[start : start + _ROWS_PER_CHUNK], content)

    def _flush_windows(self) -> None:
        windows, self._windows = self._windows, []
        if not windows:
            return
        time = [window.end_s for window in windows]
        friction = [
            (found.estimate, found.low, found.high) if (found := window.friction_nm) else (np.nan,) * 3
            for window in windows
        ]
        votes = [np.nan if window.p_emergency is None else window.p_emergency for window in windows]
        for leaf, rows in (("friction", np.array(friction)), ("network", np.array(votes))):
            if leaf not in self.present and np.isnan(rows).all():
                continue
            if leaf not in self.present:
                self.present.add(leaf)
                self._stream.log(f"{self.root}/{leaf}", _STYLES[leaf], static=True)
            self._send(leaf, time, rr.Scalars.columns(scalars=rows))

    def _flush_states(self) -> None:
        states, self._states = self._states, []
        if states:
            content = rr.StateChange.columns(state=[condition for _, condition in states])
            self._send("", [time_s for time_s, _ in states], content)

    def _send(self, leaf: str, time_s: _Rows | Sequence[float], content: rr.ComponentColumnList) -> None:
        path = f"{self.root}/{leaf}" if leaf else self.root
        self._stream.send_columns(path, indexes=_index(time_s), columns=content, strict=True)


class Texts:
    """The log of what happened, as texts with a level."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._rows: list[tuple[float, str, str]] = []

    def add(self, time_s: float, level: str, text: str) -> None:
        """Take one line."""
        self._rows.append((time_s, level, text))
        if len(self._rows) >= _ROWS_PER_CHUNK:
            self.flush()

    def flush(self) -> None:
        """Write what is waiting."""
        rows, self._rows = self._rows, []
        if rows:
            content = rr.TextLog.columns(text=[row[2] for row in rows], level=[row[1] for row in rows])
            index = _index([row[0] for row in rows])
            self._stream.send_columns("/events", indexes=index, columns=content, strict=True)
