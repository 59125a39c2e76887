"""One actuator's part of a recording: its condition, its evidence, its quantities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr

from mavhums.actuator.profile import Limits
from mavhums.assessment import Condition
from mavhums.events import ConditionChanged, Samples, Window
from mavhums.quantities import KEYS
from mavhums.show._stream import Times, send
from mavhums.show._words import COLOURS

__all__ = ["ARCHETYPE", "STALE_S", "Track", "actuator_path"]

ARCHETYPE: Final = "mavhums"

STALE_S: Final = 3.0
"""An actuator that is silent for longer is stale: what was held of it is no longer shown as true."""

_REACHED: Final[tuple[Condition, ...]] = ("undecided", "normal", "degraded", "emergency")
_ROWS_PER_CHUNK = 4096
_STALE, _STALE_COLOUR = "stale", (60, 60, 66)
_BLUE, _PALE = (86, 180, 233), (60, 110, 145)
_STYLES: Final = {
    "friction": rr.SeriesLines(
        names=["friction", "low (95 %)", "high (95 %)"], colors=[_BLUE, _PALE, _PALE], widths=[2.5, 1, 1]
    ),
    "network": rr.SeriesLines(names="probability of emergency", colors=_BLUE, widths=2.5),
}


def actuator_path(vehicle: int | None, actuator: str) -> str:
    """Return the entity path under which all of an actuator lies."""
    return rr.new_entity_path(["no_vehicle" if vehicle is None else f"vehicle_{vehicle}", actuator])


class Track:
    """Draws what the engine says of one actuator.

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
    held
        The condition that it is held to be in.
    worst
        The worst that it was held to be in.
    since_s
        Where it came into that condition; None before it was ever decided.
    latest
        The latest window in which something could be judged.
    last_s
        Until when it was heard of.
    present
        The quantities that the log carries at all, and ``friction`` and ``network`` where ever estimated.
    limits
        Of its friction, and from which flight time on they are known.
    """

    def __init__(self, stream: rr.RecordingStream, vehicle: int | None, actuator: str) -> None:
        self.vehicle, self.actuator = vehicle, actuator
        self.root = actuator_path(vehicle, actuator)
        self.held: Condition = "undecided"
        self.worst: Condition = "undecided"
        self.since_s: float | None = None
        self.latest: Window | None = None
        self.present: set[str] = set()
        self.limits: tuple[Limits, float] | None = None
        self.stale = False
        self._stream = stream
        self._blocks: list[Samples] = []
        self._waiting = 0
        self._windows: list[Window] = []
        self._states: list[tuple[float, str]] = []
        self._first_s = np.inf
        self.last_s = 0.0
        self._state_s: float | None = None
        self._limits_s: float | None = None
        states = rr.StateConfiguration(
            values=[*COLOURS, _STALE],
            labels=[*COLOURS, "stale: no data"],
            colors=[(*rgb, 255) for rgb in (*COLOURS.values(), _STALE_COLOUR)],
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
        self.held = event.condition
        if event.friction_nm is not None or event.p_emergency is not None:
            self.latest = event
        self._windows.append(event)
        if len(self._windows) >= _ROWS_PER_CHUNK:
            self._flush_windows()

    def changed(self, event: ConditionChanged) -> None:
        """Take a change of condition; the timeline shows it where it happened, not where it was certain."""
        if self._state_s is None and event.since_s > self._first_s:
            self._state(self._first_s, event.before)
        self._state(event.since_s, event.after)
        self.held, self.since_s = event.after, event.since_s
        self.worst = max(self.worst, event.after, key=_REACHED.index)

    def flush(self) -> None:
        """Write what is waiting."""
        if self._state_s is None and np.isfinite(self._first_s):
            self._state(self._first_s, self.held)
        self._flush_samples()
        self._flush_windows()
        self._flush_states()
        self._flush_limits()

    def finish(self) -> None:
        """Write what is still waiting, and a state even of an actuator that was never heard."""
        if self._state_s is None:
            self._state(self._first_s if np.isfinite(self._first_s) else 0.0, self.held)
        self.flush()

    def _seen(self, first_s: float, last_s: float) -> None:
        self._first_s, self.last_s = min(self._first_s, first_s), max(self.last_s, last_s)

    def _state(self, time_s: float, state: str) -> None:
        """Add a state; one found later is never drawn below one found earlier."""
        self._state_s = time_s if self._state_s is None else max(time_s, self._state_s + 1e-6)
        self._states.append((self._state_s, state))
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
        """Write windows at their middle, for that is when what they show was true."""
        windows, self._windows = self._windows, []
        if not windows:
            return
        time = [(window.start_s + window.end_s) / 2 for window in windows]
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
            content = rr.StateChange.columns(state=[state for _, state in states])
            self._send("", [time_s for time_s, _ in states], content)

    def _flush_limits(self) -> None:
        """Draw the limits up to the last that was seen."""
        if self.limits is None:
            return
        limits, start_s = self.limits
        times = [max(start_s, self.last_s)]
        if self._limits_s is None:
            style = rr.SeriesLines(
                names=[f"normal up to {limits.normal:g}", f"emergency from {limits.emergency:g}"],
                colors=[COLOURS["degraded"], COLOURS["emergency"]],
                widths=[2, 2],
            )
            self._stream.log(f"{self.root}/limits", style, static=True)
            times.insert(0, start_s)
        elif times[0] <= self._limits_s:
            return
        self._limits_s = times[-1]
        rows = np.tile([limits.normal, limits.emergency], (len(times), 1))
        self._send("limits", times, rr.Scalars.columns(scalars=rows))

    def _send(self, leaf: str, time_s: Times | Sequence[float], content: rr.ComponentColumnList) -> None:
        send(self._stream, f"{self.root}/{leaf}" if leaf else self.root, time_s, content)
